"""URScript: what a programme computes, how its threads take turns, what is refused and where."""

import marshal
import random
import socket
import struct
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.ur.fake_robot import MOVE_STEPS, FakeRobot, Notes

pytest.importorskip("lark")

from polish_sim.ur.script import Machine, ScriptError, values
from polish_sim.ur.script.translate import translate
from polish_sim.ur.script.values import Pose


def calls_of_a_tick(machine, robot):
    """How many functions a robot's cycle calls; unlike its time, the same on every machine."""
    calls = 0

    def count(_frame, event, _detail):
        nonlocal calls
        calls += event.endswith("call")

    sys.setprofile(count)
    machine.tick(robot)
    sys.setprofile(None)
    return calls


def run(body, ticks=20, robot=None):
    robot, notes = robot or FakeRobot(), Notes()
    text = body if body.startswith(("def f():", "sec ")) else f"def f():\n{body}\nend\n"
    machine = Machine(translate(text), notes)
    for _ in range(ticks):
        machine.tick(robot)
        robot.step()
    return robot, notes, machine


VALUES = {
    "1 + 2 * 3": "7", "7 / 2": "3.5", "-7 % 3": "-1", "2 - 3 - 4": "-5", "1e-3": "0.001",
    "(1 < 2) and not (3 <= 2)": "True", "True xor True": "False", "1 == 1 or 1 / 0 == 1": "True",
    "[1, 2] * 2 + [1, 1]": "[3, 5]", "2 * p[1, 0, 0, 0, 0, 0]": "p[2, 0, 0, 0, 0, 0]",
    "[[1, 2], [3, 4]][1, 0]": "3", "get_list_length([1, 2, 3])": "3",
    'str_cat("a", str_cat(1.5, True))': "a1.5True", 'to_num("12") + 0x10': "28",
    "norm([3, 4])": "5", "norm(-2)": "2", "pow(2, 10)": "1024", "r2d(atan2(1, 1))": "45",
    "log(10, 1000)": "3",
}  # fmt: skip


def test_pose_algebra_is_that_of_rigid_transforms():
    rng = np.random.default_rng(1)
    for _ in range(50):
        a, b = (Pose(row.tolist()) for row in rng.uniform(-2.0, 2.0, (2, 6)))
        R_a, R_b = Rotation.from_rotvec(a[3:]), Rotation.from_rotvec(b[3:])
        product = values.pose_trans(a, b)
        assert product[:3] == pytest.approx(a[:3] + R_a.apply(b[:3]))
        assert (Rotation.from_rotvec(product[3:]).inv() * R_a * R_b).magnitude() < 1e-9
        assert values.pose_trans(a, values.pose_inv(a)) == pytest.approx((0.0,) * 6, abs=1e-9)
        assert values.pose_add(values.pose_sub(a, b), b)[:3] == pytest.approx(a[:3])
        rpy = values.rotvec2rpy(a[3:])
        assert (Rotation.from_euler("xyz", rpy).inv() * R_a).magnitude() < 1e-9
        assert values.rpy2rotvec(rpy) == pytest.approx(R_a.as_rotvec(), abs=1e-9)


def test_expressions_have_their_value_lists_are_copied_and_lines_go_on_behind_operators():
    _, notes, _ = run("\n".join(f"textmsg({expression})" for expression in VALUES))
    assert dict(zip(VALUES, notes.texts, strict=True)) == VALUES
    body = """      a = [1,
  2, 3]   # a list
b = a
   b[1] = 9
if a[1] == 2 and
b[1] == 9:
 textmsg(b)
  end"""
    assert run(body)[1].texts == ["[1, 9, 3]"]


FUNCTIONS = """
scale = 10
global counted = 0
def f2(a, b=2, c=3):
  local d = a + b
  counted = counted + 1
  mine = 5
  return scale * d + c
end
textmsg(f2(1))
mine = 1
textmsg(f2(1, c=0))
textmsg(counted)
textmsg(mine)
i = 0
while True:
  i = i + 1
  if i == 2:
    continue
  elif i > 3:
    break
  end
  textmsg(i)
end
"""


def test_functions_take_defaults_and_names_and_keep_variables_to_themselves_unless_global():
    assert run(FUNCTIONS)[1].texts == ["33", "30", "2", "1", "1", "3"]


THREADS = """
thread other(n):
  i = 0
  while i < n:
    textmsg("other")
    sync()
    enter_critical
    i = i + 1
    exit_critical
  end
end
t = run other(2)
textmsg("main")
join t
textmsg("joined")
"""


def test_sleep_takes_its_time_and_a_move_waits_for_the_robot():
    body = 'movej([0, 0, 0, 0, 0, 0], a=1, v=2)\ntextmsg("there")\nsleep(0.02)\ntextmsg("late")'
    seen = [len(run(body, ticks)[1].texts) for ticks in range(1, 20)]
    assert seen.index(1) == MOVE_STEPS
    assert seen.index(2) - seen.index(1) == 10


GOES = "thread go():\n movel(p[0.1, 0, 0, 0, 0, 0])\nend\nt = run go()\nsync()\nsync()\n"


def test_threads_take_turns_join_and_are_killed_with_their_moves_of_which_there_is_one_at_a_time():
    assert run(THREADS)[1].texts == ["main", "other", "other", "joined"]
    robot, notes, _ = run(GOES + "kill t\nstopl(3)")
    assert robot.names()[:3] == ["movel", "stopj", "stopl"]
    assert notes.events[-1] == ("stopped", "f")
    _, notes, machine = run(GOES + "movej([0,0,0,0,0,0])")
    assert notes.events[1][:3] == ("exception", 8, 1)
    assert "another thread" in notes.events[1][3]
    assert not machine.running


def test_a_programme_ends_force_mode_and_motion_and_a_popup_holds_it_until_it_is_closed():
    robot, notes, _ = run(f"force_mode({SIX}, {SIX}, {SIX}, 2, {SIX})\nhalt\nsync()")
    assert robot.names() == ["force_mode", "end_force_mode", "stopj"]
    assert notes.events == [("started", "f"), ("stopped", "f")]
    robot, notes, machine = run('popup("look", blocking=True)\ntextmsg("on")')
    assert notes.texts == []
    machine.close_popup()
    machine.tick(robot)
    assert notes.texts == ["on"]
    robot, notes, machine = run("sec s():\n set_standard_digital_out(3, True)\nend\n")
    assert robot.signals["standard_digital_out", 3] == 1.0
    assert (notes.events, machine.running) == ([], False)
    robot, notes, machine = run("sec s():\n sync()\nend\n")
    assert "may not wait" in notes.events[0][-1]
    assert not machine.running


@pytest.mark.parametrize(
    ("body", "line", "column", "words"),
    [
        ("x = = 1", 2, 5, "unexpected"), ("if True:\n x = 1", 4, 1, "unexpected"),
        ("setpayload(1)", 2, 1, "Did you mean 'set_payload'"), ("[3]", 2, 1, "a value alone"),
        ("movej([0,0,0,0,0,0], speed=1)", 2, 1, "movej takes"), ("pause", 2, 1, "not served"),
        ("movej()", 2, 1, "movej takes"), ("servoj(t=1)", 2, 1, "servoj takes"),
        ("x = y + 1", 2, 5, "'y' is never given a value"), ("1 = 2", 2, 1, "only a variable"),
        ("def g(a):\nend\ng()", 4, 1, "g takes (a)"),
        ("end\nif True:\n g()", 3, 1, "one programme at a time"),
    ],
)  # fmt: skip
def test_a_programme_is_refused_with_line_and_column(body, line, column, words):
    with pytest.raises(ScriptError) as refused:
        Machine(translate(f"def f():\n{body}\nend\n"), Notes())
    assert words in refused.value.text
    assert (refused.value.line, refused.value.column) == (line, column) or "unexpected" in words


SIX = "p[0, 0, 0, 0, 0, 0]"


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("while True:\n x = 1\nend", "endless loop"), ("def g():\n return g()\nend\ng()", "too deeply"),
        ("x = 1 / 0", "division by zero"), ("x = [1][2]", "no such element"), ('x = "a" + "b"', "wrong type"),
        ("i = -1\nx = [1, 2][i]", "no such element"), ("x = 1\nwhile True:\n x = x * 99\nend", "32-bit"),
        ('s = "ab"\nwhile True:\n s = str_cat(s, s)\nend', "text of more"),
        ("movej([0, 0, 0])", "6 numbers are needed"), ('socket_open("10.0.0.1", 80)', "reach the sender"),
        ("q = get_inverse_kin(p[2, 0, 0, 0, 0, 0])", "no inverse kinematics"),
        ("thread g():\n while True:\n  sync()\n end\nend\nwhile True:\n t = run g()\nend", "64 threads"),
        ("if False:\n y = 1\nend\nx = y", "no value yet"), ("x = 1\ndef g(a=x):\nend", "no value yet"),
        ("x = read_input_float_register(-1)", "no such element"),
        ("x = pose_inv(p[1e300, 0, 0, 1, 0, 1e300])", "finite number"),
        ("x = pose_add(p[1e308, 0, 0, 0, 0, 0], p[1e308, 0, 0, 0, 0, 0])", "finite number"),
        ("x = wrench_trans(p[0, 0, 0, 1e300, 0, 0], p[0, 0, 1, 0, 0, 0])", "finite number"),
        ("x = rotvec2rpy([1e300, 0, 0])", "finite number"),
        ('servoj([0, 0, 0, 0, 0, 0], gain="high")', "finite number"),
        ("servoj([0, 0, 0, 0, 0, 0], lookahead_time=[0.1])", "finite number"),
        (f"force_mode({SIX}, {SIX}, {SIX}, [2], {SIX})", "finite number"),
        (f"force_mode(p[0, 0, 0, 1e200, 0, 0], {SIX}, {SIX}, 2, {SIX})", "finite number up to 1e+12"),
        ("set_tcp(p[1e300, 0, 0, 0, 0, 0])", "finite number up to 1e+12"),
        ('ft_rtde_input_enable("True")', "finite number"),
        ("ft_rtde_input_enable(True, 0.5, [0, 0], [0, 0, 0])", "3 numbers are needed"),
    ],
)  # fmt: skip
def test_a_failing_programme_stops_with_its_place(body, words):
    _, notes, machine = run(body)
    assert [event[0] for event in notes.events] == ["started", "exception", "stopped"]
    assert words in notes.events[1][3]
    assert 2 <= notes.events[1][1] <= 10
    assert not machine.running


@pytest.mark.parametrize(
    "text",
    [
        "__import__(1)", "x = __builtins__", "x = f.__class__", "x = open(1)", "x = spend", "b_movej(1)",
        "x = main", "x = Halt", 'exec("1")', "x = movej", "f_f()", "x = (1).real", "x = [1].append",
        "lambda: 1", "x = 1 if True else 2", "x = [y for y in [1]]", "import os", "global f = 1\nf.x = 2",
        "x = g_y", "raise Halt", "x = yield", "del x", "x = 1; y = 2", "x := 1", "movej.__globals__[0]",
        "x = {1: 2}", "x = *[1]", "movej([0,0,0,0,0,0], **a)", 'socket_open("a", 1, self=1)',
        "set_tcp(self=1)", "x = 1e999",
        "(" * 5000, "x=" + "-" * 5000 + "1", "def g():\n" * 3000, "x=" + "1+" * 3000 + "1",
    ],
)  # fmt: skip
def test_nothing_of_python_can_be_reached_and_no_depth_is_too_much(text):
    with pytest.raises(ScriptError):
        translate(f"def f():\n{text}\nend\n")


def test_a_programme_compiles_to_its_own_names_and_ours_only():
    """Whatever a programme is called and says, its code names nothing but what it was given."""
    words = (
        "__class__", "__globals__", "gi_frame", "f_back", "eval", "os", "main", "spend", "List", "Halt",
        "self",
    )  # fmt: skip
    body = "".join(f"{word} = 1\ndef {word}_(a):\n local {word} = a\n return {word}\nend\n" for word in words)
    text = f"def f():\n{body}x = 'a\\\\\" + __import__(1)'\nsync()\nend\n"
    machine = Machine(translate(text), Notes())
    codes, seen = [marshal.loads(machine.program.code)], set[str]()
    while codes:
        code = codes.pop()
        seen |= set(code.co_names)
        codes += [value for value in code.co_consts if hasattr(value, "co_names")]
    known = {
        "main", "spend", "List", "checked", "pose", "add", "sub", "mul", "mod", "xor", "element", "replaced",
    }  # fmt: skip
    assert {name for name in seen if name[:2] not in ("g_", "l_", "f_", "b_")} <= known


@pytest.mark.parametrize(
    "body",
    [
        "a = [1]\nb = [1]\nwhile True:\n a = [a, a]\n b = [b, b]\n c = a == b\n sync()\nend",
        "a = [1]\nwhile True:\n a[0] = a\n sync()\nend",
        "a = [" + "1," * 4999 + "1]\nb = [" + "a," * 4999 + "a]\nc = b * 2",
        "i = 1\nwhile True:\n i = i + i\nend",
        "while True:\n m = get_mass_matrix()\nend",
        "m = 1\n" + "a = [" + "1," * 4999 + "1]\n" + "b = a / 3 * a + a - a\n" * 600,
        "def g(n):\n while True:\n  m = n * [1.5,2,3]\n end\nend\nthread t(n):\n g(n)\nend\n"
        + "i = 0\nwhile i < 60:\n h = run t(i)\n i = i + 1\nend\nsync()",
    ],
)
def test_no_programme_holds_the_server_up(body):
    """Neither by time nor by memory: what would be endless is stopped within a step."""
    machine, notes, robot = Machine(translate(f"def f():\n{body}\nend\n"), Notes()), Notes(), FakeRobot()
    machine.listener, longest = notes, 0.0
    for _ in range(50):
        longest = max(longest, calls_of_a_tick(machine, robot))
    assert notes.events[0][0] == "exception"
    assert not machine.running
    assert longest < 3_000_000


def test_sockets_carry_integers_in_network_order():
    server = socket.create_server(("127.0.0.1", 0))
    body = f"""
if socket_open("127.0.0.1", {server.getsockname()[1]}, "line"):
  got = socket_read_binary_integer(2, "line", 5)
  textmsg(got)
  socket_send_int(got[1] + got[2], "line")
  textmsg(socket_read_binary_integer(1, "line", 0.01))
end
"""
    robot, notes = FakeRobot(), Notes()
    machine = Machine(translate(f"def f():\n{body}\nend\n"), notes, "127.0.0.1")
    for _ in range(5):
        machine.tick(robot)
    client = server.accept()[0]
    client.sendall(struct.pack(">ii", 40, 2))
    for _ in range(12):
        machine.tick(robot)
    assert struct.unpack(">i", client.recv(4)) == (42,)
    assert notes.texts == ["[2, 40, 2]", "[-1, 0]"]
    assert client.recv(4) == b""  # the programme has ended and closed it


def test_broken_programmes_are_refused_and_nothing_else_happens():
    """Cuts, swaps and rubbish in functions, threads, branches and moves."""
    whole = f"def f():\n{FUNCTIONS}{THREADS}{GOES}kill t\nend\n"
    rng, rubbish = random.Random(7), ("", "(", "]", "end", "\n", "=", "\0", "é", '"', "9" * 12, "while", "p[")
    refused = 0
    for _ in range(150):
        text = list(whole)
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(text))
            text[at : at + rng.choice((0, 1, 1, 3, 40))] = rng.choice(rubbish)
        try:
            run("".join(text), ticks=30)
        except ScriptError:
            refused += 1
    assert 40 < refused < 150


def test_a_control_loop_takes_few_calls_of_its_2_ms():
    """A loop as of a client's control script: registers read, 70 branches, a second thread that moves."""
    branches = "".join(f"  elif cmd == {k}:\n   textmsg({k})\n" for k in range(1, 71))
    body = f"""
thread speed():
 while True:
  speedl(goal, a=0.5, t=0.002)
 end
end
global goal = [0, 0, 0, 0, 0, 0]
t = run speed()
while True:
  cmd = read_input_integer_register(0)
  if cmd == 0:
   halt
{branches}  elif cmd == 71:
   i = 0
   while i < 6:
    goal[i] = read_input_float_register(i)
    i = i + 1
   end
  end
  sync()
end
"""
    robot = FakeRobot()
    robot.signals["input_int_register", 0] = 71
    _, notes, machine = run(body, 10, robot)
    longest = max(calls_of_a_tick(machine, robot) for _ in range(100))
    assert machine.running, notes.events
    assert longest < 400
    assert robot.names()[-1] == "speedl"
