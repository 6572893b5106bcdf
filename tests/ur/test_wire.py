"""Every port of the served robot, in bytes: what clients send, and what nobody should."""

import contextlib
import importlib.util
import json
import multiprocessing
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from polish_sim.errors import InputError
from polish_sim.experiments import default_scenario
from polish_sim.log import PROCESS_PHASE
from polish_sim.scenario_file import override
from polish_sim.ur.controller import Link, RobotController
from polish_sim.ur.ports import answer
from polish_sim.ur.server import DASHBOARD, PRIMARY, REALTIME, RTDE, SECONDARY, Server
from tests.cli.conftest import UNPROVEN, Started, ran, undrawn
from tests.kept import plate_file
from tests.test_workers import until

ADDRESS = "127.0.0.1"


def loop(*before):
    """A programme that reads a register for ever, after some lines."""
    head = "".join(f"  {line}\n" for line in before)
    loop = "  while True:\n    x = read_input_integer_register(0)\n    sync()\n  end\n"
    return f"def prog():\n{head}{loop}end\n".encode()


class Served:
    def __init__(self, robot, real_time):
        self.controller, self.robot, self._ended = RobotController(robot, "5.11"), robot, False
        for self.offset in range(1000 + os.getpid() % 1000, 30000, 997):
            with contextlib.suppress(InputError):
                self.server = Server(self.controller, ADDRESS, real_time, self.offset)
                break
        self.thread = threading.Thread(target=self.server.run, args=(lambda: self._ended,), daemon=True)
        self.thread.start()

    def end(self):
        self._ended = True
        self.thread.join(20.0)
        assert not self.thread.is_alive()
        self.server.close()

    def connect(self, port):
        return socket.create_connection((ADDRESS, port + self.offset), 20.0)

    def until(self, done):
        until(lambda: done() or not self.thread.is_alive())
        assert self.thread.is_alive()


@pytest.fixture
def served(build):
    it = Served(build(), True)
    yield it
    it.end()


class Rtde:
    def __init__(self, served):
        self._socket = served.connect(RTDE)
        self._stream = self._socket.makefile("rb")
        assert self.ask(b"V", struct.pack(">H", 2)) == b"\1"

    def close(self):
        self._stream.close()
        self._socket.close()

    def outputs(self, hertz, names):
        return self.ask(b"O", struct.pack(">d", hertz) + names)

    def ask(self, kind, body, answer=b""):
        self.send(kind, body)
        while True:
            found, data = self.read()
            if found == (answer or kind):
                return data

    def send(self, kind, body):
        self._socket.sendall(struct.pack(">HB", 3 + len(body), kind[0]) + body)

    def read(self):
        size, kind = struct.unpack(">HB", self._stream.read(3))
        return bytes([kind]), self._stream.read(size - 3)

    def data(self):
        """The next package of outputs."""
        while (package := self.read())[0] != b"U":
            pass
        return package[1]


def lines(connection, *sent):
    stream = connection.makefile("rw", newline="\n")
    said = []
    for line in sent:
        stream.write(line + "\n")
        stream.flush()
        said.append(stream.readline().strip())
    return said


def test_rtde_negotiates_and_sends_what_was_asked(served):
    client = Rtde(served)
    assert client.ask(b"V", struct.pack(">H", 3)) == b"\0"
    assert struct.unpack(">4I", client.ask(b"v", b""))[:2] == (5, 11)
    assert client.outputs(500.0, b"timestamp,no_such_field") == b"\0DOUBLE,NOT_FOUND"
    assert client.outputs(500.0, b"timestamp,actual_TCP_pose") == b"\1DOUBLE,VECTOR6D"
    assert client.ask(b"I", b"input_int_register_0") == b"\1INT32"
    other = Rtde(served)
    assert other.ask(b"I", b"input_int_register_0,input_int_register_1") == b"\0IN_USE,INT32"
    assert client.ask(b"S", b"") == b"\1"
    times = [struct.unpack(">Bd6d", client.data())[1] for _ in range(200)]
    assert times[0] > 42.0
    assert np.diff(times) == pytest.approx(np.full(199, 0.002), abs=1e-6)
    client.send(b"U", struct.pack(">Bi", 1, 7))
    served.until(lambda: served.robot.signals["input_int_register"][0] == 7)
    # Two bytes short, as setExternalForceTorque of ur_rtde 1.6.5 is four: ignored, and the client stays.
    assert b"2 bytes for input recipe 1 of 4" in client.ask(b"U", struct.pack(">Bh", 1, 8), b"M")
    client.send(b"U", struct.pack(">Bi", 1, 9))
    served.until(lambda: served.robot.signals["input_int_register"][0] == 9)
    # What drivers take for the robot's speed is the product of the slider and the limiter.
    client.outputs(500.0, b"speed_scaling,target_speed_fraction")
    served.connect(SECONDARY).sendall(loop())
    served.until(lambda: served.controller.machine is not None)
    served.robot.set_speed_fraction(0.5)
    client.ask(b"S", b"")
    while (data := client.data())[:1] != b"\2":
        pass
    assert struct.unpack(">B2d", data)[1:] == (1.0, 0.5)
    client.close()
    served.until(lambda: not served.controller.claimed)
    assert other.ask(b"I", b"input_int_register_0") == b"\1INT32"


def test_a_client_s_sensor_has_to_be_fed_or_the_programme_pauses(served):
    client, dashboard = Rtde(served), served.connect(DASHBOARD)
    dashboard.recv(200)
    assert client.ask(b"I", b"external_force_torque") == b"\1VECTOR6D"
    served.connect(PRIMARY).sendall(loop("ft_rtde_input_enable(True)"))
    served.until(lambda: served.controller.machine is not None)
    begun = served.robot.ticks
    while served.robot.ticks < begun + 200:
        client.send(b"U", struct.pack(">B6d", 1, 1.0, 2.0, 3.0, 0.0, 0.0, 0.5))
        time.sleep(0.01)
        assert lines(dashboard, "programState") == ["PLAYING prog"]
    assert served.robot.tcp_force.tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.5]
    fed = served.robot.ticks
    served.until(lambda: lines(dashboard, "programState") == ["PAUSED prog"])
    assert (served.robot.ticks - fed) * 0.002 < 0.3
    assert lines(dashboard, "play", "programState") == ["Starting program", "PLAYING prog"]


def test_the_dashboard_says_what_the_robot_does(served):
    connection = served.connect(DASHBOARD)
    assert connection.recv(200).startswith(b"Connected: Universal Robots Dashboard Server")
    assert lines(connection, "robotmode", "programState") == ["Robotmode: RUNNING", "STOPPED null"]
    assert lines(connection, "nonsense") == ["could not understand: 'nonsense'"]
    script = served.connect(SECONDARY)
    script.sendall(loop())
    served.until(lambda: served.controller.program == "prog")
    assert lines(connection, "running", "pause") == ["Program running: true", "Pausing program"]
    assert lines(connection, "programState", "play") == ["PAUSED prog", "Starting program"]
    assert lines(connection, "stop", "running") == ["Stopped", "Program running: false"]
    assert lines(connection, "power off", "robotmode") == ["Powering off", "Robotmode: POWER_OFF"]
    script.sendall(loop())
    served.until(lambda: "not started" in " ".join(served.controller.log))
    assert lines(connection, "brake release", "robotmode") == ["Brake releasing", "Robotmode: RUNNING"]


def test_a_watchdog_stops_a_silent_client_s_programme_and_the_dashboard_unlocks_a_stop_after_5_s(robot):
    controller = RobotController(robot, "5.11")
    controller.run(loop('rtde_set_watchdog("input_int_register_0", 10, "stop")').decode(), "")
    while controller.machine is not None and robot.ticks < 200:
        controller.tick()
    assert any("watchdog" in line for line in controller.log)
    assert robot.ticks * 0.002 == pytest.approx(0.1, abs=0.02)
    assert robot.steady()
    controller = RobotController(robot, "5.11")
    controller.run("def stops():\n  protective_stop()\n  sync()\nend\n", "")
    controller.tick()
    stopped, unlock = robot.ticks, "unlock protective stop"
    assert answer(controller, "safetymode") == "Safetymode: PROTECTIVE_STOP"
    assert answer(controller, unlock).startswith("Cannot unlock protective stop until 5s")
    while answer(controller, unlock) != "Protective stop releasing":
        controller.tick()
    assert (robot.ticks - stopped) * 0.002 == pytest.approx(5.0, abs=0.01)
    assert answer(controller, "safetymode") == "Safetymode: NORMAL"
    controller.run('def asks():\n  popup("on?", blocking=True)\nend\n', "")
    controller.tick()
    assert controller.machine is not None
    assert answer(controller, "close popup") == "closing popup"
    controller.tick()
    assert controller.machine is None


def test_the_robot_stops_when_the_client_of_its_programme_dies(served):
    client = Rtde(served)
    client.ask(b"I", b"input_int_register_0")
    rises = ("thread m():", "  speedl([0,0,0.02,0,0,0], 0.5, 20)", "end", "run m()")
    served.connect(PRIMARY).sendall(loop(*rises))
    served.until(lambda: abs(served.robot.actual_tcp_speed[2]) > 0.01)
    died = served.robot.ticks
    client.close()
    served.until(lambda: served.controller.machine is None)
    assert (served.robot.ticks - died) * 0.002 < 0.4 + 0.1
    served.until(served.robot.steady)


def messages(connection, kind):
    """Bodies of the robot messages of a kind, as they come on the primary port; states are passed over."""
    stream = connection.makefile("rb")
    while True:
        size, package = struct.unpack(">IB", stream.read(5))
        body = stream.read(size - 5)
        if package == 20 and body[9] == kind:
            yield body[10:]


def test_the_primary_port_tells_of_stops_and_unknown_names_as_a_robot_does(served):
    primary = served.connect(PRIMARY)
    primary.sendall(b"def bad():\n  no_such_function(1)\nend\n")
    line, column = struct.unpack(">ii", (text := next(messages(primary, 10)))[:8])
    assert (line, column, text[8:]) == (2, 3, b"compile_error_name_not_found:no_such_function:")
    modes, errors = (messages(served.connect(PRIMARY), kind) for kind in (5, 6))
    served.until(lambda: len(served.server._clients) == 3)
    primary.sendall(b"sec stops():\n  protective_stop()\nend\n")
    assert struct.unpack(">iiBII", next(modes)) == (0, 0, 3, 0, 0)
    assert struct.unpack(">iiiII", next(errors)[:20])[:3] == (209, 0, 2)
    primary.sendall(b"set unlock protective stop\n")
    assert struct.unpack(">iiBII", next(modes))[2] == 1  # a second later: what was asked for too soon waits


def test_the_line_falls_silent_now_and_then_and_loses_nothing():
    gappy = ["robot.real.missed_every_s=0.2", "robot.real.missed_s=0.0056"]
    scenario = override(default_scenario("surface"), gappy)
    link, came, silent = Link(scenario.robot, 0), list[int](), list[bool]()
    for tick in range(50_000):
        link.advance(tick)
        silent.append(link.silent)
        link.take(partial(came.append, tick))
    gaps = np.flatnonzero(np.diff(np.array(silent, dtype=int)) == 1)
    assert len(gaps) == pytest.approx(50_000 * 0.002 / 0.2, rel=0.2)
    assert np.sum(silent) == 3 * len(gaps)
    assert came == list(range(len(came)))
    assert len(came) >= 50_000 - 10
    ideal = Link(override(scenario, ["robot.arm=ideal"]).robot, 0)
    for tick in range(1000):
        ideal.advance(tick)
        assert not ideal.silent


def test_a_long_programme_is_read_while_the_clock_goes_on(robot):
    reader = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
    controller = RobotController(robot, "5.11", reader)
    source = "def long():\n" + "  x = 7 * (2 + [1, 2][1])\n" * 1000 + "  sleep(9)\nend\n"
    controller.run(source, "")
    controller.tick()
    assert controller.machine is None
    until(lambda: controller.tick() or controller.machine is not None)
    assert controller.program == "long"
    assert robot.ticks > 20
    controller.run("def bad():\n  nothing()\nend\n", "")
    unknown = "line 2, column 3: compile_error_name_not_found:nothing:"
    until(lambda: controller.tick() or unknown in controller.log[-1])
    controller.run(source + "#\n", "")
    controller.stop("by the test")
    reader.shutdown()
    for _ in range(20):
        controller.tick()
    assert controller.machine is None


def test_bytes_that_nobody_should_send_do_no_harm(served):
    rng = np.random.default_rng(500)
    for number in range(300):
        port = (DASHBOARD, PRIMARY, SECONDARY, REALTIME, RTDE)[number % 5]
        with contextlib.suppress(OSError), served.connect(port) as connection:
            data = rng.bytes(int(rng.integers(1, 400)))
            if port == RTDE and number % 2:
                kind = int(rng.choice(list(b"VvOISPUM")))
                data = struct.pack(">HB", 3 + len(data), kind) + data
            connection.sendall(data)
    with served.connect(RTDE) as connection:
        connection.sendall(struct.pack(">HB", 3, ord("Z")))
        assert connection.recv(1) == b""  # dropped
    served.until(lambda: len(served.server._clients) == 0)
    assert served.controller.claimed == {}
    connection = served.connect(DASHBOARD)
    connection.recv(200)
    assert lines(connection, "safetymode") == ["Safetymode: NORMAL"]


def test_twenty_clients_and_one_that_never_reads(served):
    idle = served.connect(REALTIME)
    clients = [Rtde(served) for _ in range(20)]
    for client in clients:
        client.outputs(125.0, b"timestamp,actual_q")
        client.ask(b"S", b"")
    for client in clients:
        assert len([client.data() for _ in range(50)]) == 50
    idle.close()


def test_a_lock_step_client_gets_the_same_bytes_twice(build):
    """And so is what is recorded of the force it asks for, from the air to the process."""
    press = "force_mode(get_actual_tcp_pose(), [0,0,1,0,0,0], [0,0,20,0,0,0], 2, [1,1,0.02,1,1,1])"
    s = np.linspace(0.0, 0.1, 5)
    points = np.array([0.0, -0.5, 0.1]) + s[:, None] * [1, 0, 0]
    heard, recorded = [], []
    for _ in range(2):
        served = Served(build(), False)
        try:
            client = Rtde(served)
            client.outputs(500.0, b"timestamp,actual_q,actual_TCP_force")
            client.ask(b"I", b"input_int_register_0")
            served.connect(PRIMARY).sendall(loop("zero_ftsensor()", press))
            served.until(lambda served=served: served.controller.machine is not None)
            client.ask(b"S", b"")
            said = b""
            for number in range(1500):
                said += client.data()
                client.send(b"U", struct.pack(">Bi", 1, number))
            heard.append(said)
        finally:
            served.end()
        trace = served.robot.rig.result(0.0, points, s).trace
        assert {0, 1, 2} <= set(trace.phase.tolist())
        recorded.append(np.column_stack([trace.normal_force_n, trace.path_s_m, trace.phase])[:1500].tobytes())
    assert len(heard[0]) == 1500 * (1 + 13 * 8)
    assert heard[0] == heard[1]
    assert recorded[0] == recorded[1]


def test_a_server_without_its_ports_says_so_once_and_ends(polish_sim, tmp_path):
    with socket.create_server(("127.0.0.8", REALTIME)):
        code, _, err = polish_sim("serve", "--part", "plate", "--address", "127.0.0.8", "--out", "SERVED")
    assert code == 2
    assert err.count("error:") == err.count(f"port {REALTIME} of 127.0.0.8") == 1
    assert "plan" not in err  # before the cell is prepared
    assert not (tmp_path / "SERVED").exists()


def test_addresses_and_versions_that_are_none_are_refused(polish_sim):
    for words, said in (
        ("--address robot", "is no IP address"), ("--polyscope 4.0", "5.11"), ("--speed fast", "max"),
        (f"--address {ADDRESS} --address {ADDRESS}", "an address of its own"),
        ("--score nothing", "step-20"), ("--score step-20 --part plate", "--part"),
        (f"--live --live-port 8099 --address {ADDRESS} --address 127.0.0.2", "one robot"),
    ):  # fmt: skip
        code, _, err = polish_sim("serve", *words.split())
        assert (code, said in err, err.count("\n")) == (2, True, 1), err


def test_two_robots_are_served_and_the_unmodified_client_polishes_with_one(tmp_path):
    both, plate = ("127.0.0.9", "127.0.0.10"), str(plate_file())
    ran("plan", plate, "--stepover", 40, *UNPROVEN, "--out", tmp_path / "PLAN")
    words = ["serve", "--part", plate, "--path", "PLAN/path.csv", "--out", "TWO"]
    words += ["--address", both[0], "--address", both[1]]
    with (tmp_path / "said").open("w") as stream, undrawn():
        process = Started(*words, folder=tmp_path, out=stream.fileno(), err=stream.fileno())
    said = (tmp_path / "said").read_text
    try:
        until(lambda: said().count("serving") == 2 or process.poll() is not None)
        assert process.poll() is None, said()
        if polishes := importlib.util.find_spec("rtde_control") is not None:
            example = Path(__file__).parents[2] / "examples/ur_rtde_polish.py"
            client = [sys.executable, example, "PLAN/path.csv", "--seconds", "3", "--host", both[0]]
            done = subprocess.run(client, cwd=tmp_path, capture_output=True, text=True, timeout=240)
            assert done.returncode == 0, done.stdout + done.stderr
            mean = float(done.stdout.partition("mean ")[2].split(" ")[0])
            assert mean == pytest.approx(20.0, abs=0.5)
        for address in both:
            with socket.create_connection((address, DASHBOARD)) as line:
                line.recv(200)
                assert lines(line, f"addToLog this is {address}") == ["Added log message"]
        process.send_signal(signal.SIGINT)
        assert process.wait(120) == 0, said()
    finally:
        process.kill()
    for address in both:
        assert f"this is {address}" in (tmp_path / f"TWO/{address}/controller.log").read_text()
    if not polishes:
        return
    run = tmp_path / "TWO" / both[0]
    with np.load(run / "log.npz") as log:
        fed = log["phase"] == PROCESS_PHASE
        time_s, exact = log["time_s"][fed], log["normal_force_n"][fed]
    # Force mode of a UR settles within some two seconds.
    assert exact[time_s > time_s[0] + 2.0].mean() == pytest.approx(20.0, abs=1.0)
    assert json.loads((run / "metrics.json").read_text())["contact_lost_s"] == 0.0
    assert (run / "report.html").exists()
