"""Every port of the served robot, in bytes: what clients send, and what nobody should."""

from __future__ import annotations

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
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from polish_sim.cli.boundary import execute
from polish_sim.cli.main import commands
from polish_sim.errors import InputError
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.ur.controller import Controller
from polish_sim.ur.link import Link
from polish_sim.ur.robot import SimulatedRobot
from polish_sim.ur.script import Machine
from polish_sim.ur.server import DASHBOARD, PRIMARY, REALTIME, RTDE, SECONDARY, Server
from tests.cli.conftest import PROGRAM, UNPROVEN, undrawn
from tests.kept import plate_file

ADDRESS = "127.0.0.1"
LOOP = "def prog():\n  while True:\n    x = read_input_integer_register(0)\n    sync()\n  end\nend\n"


class Served:
    """A server in a thread of its own."""

    def __init__(self, robot: SimulatedRobot, real_time: bool) -> None:
        self.controller, self.robot, self._ended = Controller(robot, "5.11", Machine), robot, False
        for self.offset in range(1000 + os.getpid() % 1000, 30000, 997):
            with contextlib.suppress(InputError):
                self.server = Server(self.controller, ADDRESS, real_time, self.offset)
                break
        self.thread = threading.Thread(target=self.server.run, args=(lambda: self._ended,), daemon=True)
        self.thread.start()

    def end(self) -> None:
        self._ended = True
        self.thread.join(20.0)
        assert not self.thread.is_alive()
        self.server.close()

    def connect(self, port: int) -> socket.socket:
        return socket.create_connection((ADDRESS, port + self.offset), 20.0)

    def until(self, done: Callable[[], bool], most_s: float = 90.0) -> None:
        begun = time.monotonic()
        while not done():
            assert time.monotonic() - begun < most_s
            assert self.thread.is_alive()
            time.sleep(0.005)


@pytest.fixture
def served(build: Callable[[], SimulatedRobot]) -> Iterator[Served]:
    it = Served(build(), True)
    yield it
    it.end()


class Rtde:
    """A client of port 30004."""

    def __init__(self, served: Served) -> None:
        self.socket, self._left = served.connect(RTDE), b""

    def ask(self, kind: bytes, body: bytes, answer: bytes = b"") -> bytes:
        self.send(kind, body)
        while True:
            found, data = self.read()
            if found == (answer or kind):
                return data

    def send(self, kind: bytes, body: bytes) -> None:
        self.socket.sendall(struct.pack(">HB", 3 + len(body), kind[0]) + body)

    def read(self) -> tuple[bytes, bytes]:
        head = self._take(3)
        size, kind = struct.unpack(">HB", head)
        return bytes([kind]), self._take(size - 3)

    def _take(self, count: int) -> bytes:
        while len(self._left) < count:
            data = self.socket.recv(65536)
            if not data:
                raise EOFError
            self._left += data
        taken, self._left = self._left[:count], self._left[count:]
        return taken


def lines(connection: socket.socket, *sent: str) -> list[str]:
    stream = connection.makefile("rw", newline="\n")
    said = []
    for line in sent:
        stream.write(line + "\n")
        stream.flush()
        said.append(stream.readline().strip())
    return said


def test_rtde_negotiates_and_sends_what_was_asked(served: Served) -> None:
    client = Rtde(served)
    assert client.ask(b"V", struct.pack(">H", 3)) == b"\0"
    assert client.ask(b"V", struct.pack(">H", 2)) == b"\1"
    assert struct.unpack(">4I", client.ask(b"v", b""))[:2] == (5, 11)
    assert client.ask(b"O", struct.pack(">d", 500.0) + b"timestamp,no_such_field") == b"\0DOUBLE,NOT_FOUND"
    assert client.ask(b"O", struct.pack(">d", 500.0) + b"timestamp,actual_TCP_pose") == b"\1DOUBLE,VECTOR6D"
    assert client.ask(b"I", b"input_int_register_0") == b"\1INT32"
    other = Rtde(served)
    other.ask(b"V", struct.pack(">H", 2))
    assert other.ask(b"I", b"input_int_register_0,input_int_register_1") == b"\0IN_USE,INT32"
    assert client.ask(b"S", b"") == b"\1"
    times = []
    while len(times) < 200:
        kind, data = client.read()
        if kind == b"U":
            times.append(struct.unpack(">Bd6d", data)[1])
    assert times[0] > 42.0
    assert np.diff(times) == pytest.approx(np.full(199, 0.002), abs=1e-6)
    client.send(b"U", struct.pack(">Bi", 1, 7))
    served.until(lambda: served.robot.registers["in"]["int"][0] == 7)
    # Two bytes short, as setExternalForceTorque of ur_rtde 1.6.5 is four: ignored, and the client stays.
    assert b"2 bytes for input recipe 1 of 4" in client.ask(b"U", struct.pack(">Bh", 1, 8), b"M")
    client.send(b"U", struct.pack(">Bi", 1, 9))
    served.until(lambda: served.robot.registers["in"]["int"][0] == 9)
    # What drivers take for the robot's speed is the product of the slider and the limiter.
    client.ask(b"O", struct.pack(">d", 500.0) + b"speed_scaling,target_speed_fraction")
    served.connect(SECONDARY).sendall(LOOP.encode())
    served.until(lambda: served.controller.machine is not None)
    served.robot.set_speed_fraction(0.5)
    client.ask(b"S", b"")
    while (package := client.read())[1][:1] != b"\2":
        pass
    assert struct.unpack(">B2d", package[1])[1:] == (1.0, 0.5)
    client.socket.close()
    served.until(lambda: not served.controller.claimed)
    assert other.ask(b"I", b"input_int_register_0") == b"\1INT32"


def test_a_client_s_sensor_has_to_be_fed_or_the_programme_pauses(served: Served) -> None:
    client, dashboard = Rtde(served), served.connect(DASHBOARD)
    dashboard.recv(200)
    client.ask(b"V", struct.pack(">H", 2))
    assert client.ask(b"I", b"external_force_torque") == b"\1VECTOR6D"
    text = LOOP.replace("  while", "  ft_rtde_input_enable(True)\n  while", 1)
    served.connect(PRIMARY).sendall(text.encode())
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


def test_the_dashboard_says_what_the_robot_does(served: Served) -> None:
    connection = served.connect(DASHBOARD)
    assert connection.recv(200).startswith(b"Connected: Universal Robots Dashboard Server")
    assert lines(connection, "robotmode", "safetymode", "programState", "running", "nonsense") == [
        "Robotmode: RUNNING",
        "Safetymode: NORMAL",
        "STOPPED null",
        "Program running: false",
        "could not understand: 'nonsense'",
    ]
    script = served.connect(SECONDARY)
    script.sendall(LOOP.encode())
    served.until(lambda: served.controller.program == "prog")
    assert lines(connection, "running", "pause", "programState", "play", "stop", "running") == [
        "Program running: true",
        "Pausing program",
        "PAUSED prog",
        "Starting program",
        "Stopped",
        "Program running: false",
    ]
    assert lines(connection, "power off", "robotmode") == ["Powering off", "Robotmode: POWER_OFF"]
    script.sendall(LOOP.encode())
    served.until(lambda: "not started" in " ".join(served.controller.log))
    assert lines(connection, "brake release", "robotmode") == ["Brake releasing", "Robotmode: RUNNING"]


def test_a_stop_shows_on_every_port_and_is_unlocked_after_five_seconds(served: Served) -> None:
    connection = served.connect(DASHBOARD)
    connection.recv(200)
    served.connect(PRIMARY).sendall(b"def stops():\n  protective_stop()\n  sync()\nend\n")
    served.until(lambda: lines(connection, "safetymode") == ["Safetymode: PROTECTIVE_STOP"])
    assert lines(connection, "unlock protective stop")[0].startswith("Cannot unlock protective stop until 5s")
    served.until(lambda: lines(connection, "unlock protective stop") == ["Protective stop releasing"])
    assert lines(connection, "safetymode") == ["Safetymode: NORMAL"]


def test_the_robot_stops_when_the_client_of_its_programme_dies(served: Served) -> None:
    client = Rtde(served)
    client.ask(b"V", struct.pack(">H", 2))
    client.ask(b"I", b"input_int_register_0")
    program = LOOP.replace("  while", "  speedl([0,0,0.02,0,0,0], 0.5, 20)\n  while", 1)
    served.connect(PRIMARY).sendall(program.replace("speedl", "thread m():\n    speedl").replace(
        ", 20)\n", ", 20)\n  end\n  run m()\n", 1).encode())  # fmt: skip
    served.until(lambda: abs(served.robot.actual_tcp_speed[2]) > 0.01)
    died = served.robot.ticks
    client.socket.close()
    served.until(lambda: served.controller.machine is None)
    assert (served.robot.ticks - died) * 0.002 < 0.4 + 0.1
    served.until(served.robot.steady)


def test_a_watchdog_stops_a_programme_whose_client_is_silent(served: Served) -> None:
    text = LOOP.replace("  while", '  rtde_set_watchdog("input_int_register_0", 10, "stop")\n  while', 1)
    served.connect(PRIMARY).sendall(text.encode())
    served.until(lambda: any("watchdog" in line for line in served.controller.log))
    served.until(lambda: served.controller.machine is None)
    assert served.robot.steady()


def messages(connection: socket.socket, kind: int) -> Iterator[bytes]:
    """Bodies of the robot messages of a kind, as they come on the primary port; states are passed over."""
    stream = connection.makefile("rb")
    while True:
        size, package = struct.unpack(">IB", stream.read(5))
        body = stream.read(size - 5)
        if package == 20 and body[9] == kind:
            yield body[10:]


def test_the_primary_port_tells_of_stops_and_unknown_names_as_a_robot_does(served: Served) -> None:
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


def test_the_line_falls_silent_now_and_then_and_loses_nothing() -> None:
    scenario = override(
        default_scenario("surface"), ["robot.real.missed_every_s=0.2", "robot.real.missed_s=0.0056"]
    )
    link, came, silent = Link(scenario), list[int](), list[bool]()
    for tick in range(50_000):
        link.advance(tick)
        silent.append(link.silent)
        link.take(lambda tick=tick: came.append(tick))  # type: ignore[misc]
    gaps = np.flatnonzero(np.diff(np.array(silent, dtype=int)) == 1)
    assert len(gaps) == pytest.approx(50_000 * 0.002 / 0.2, rel=0.2)
    assert np.sum(silent) == 3 * len(gaps)
    assert came == list(range(len(came)))
    assert len(came) >= 50_000 - 10
    ideal = Link(override(scenario, ["robot.arm=ideal"]))
    for tick in range(1000):
        ideal.advance(tick)
        assert not ideal.silent


def test_a_long_programme_is_read_while_the_clock_goes_on(build: Callable[[], SimulatedRobot]) -> None:
    robot, reader = build(), ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
    controller = Controller(robot, "5.11", Machine, reader)
    source = (
        "def long():\n" + "".join(f"  x = {k} * (2 + [1, 2][1])\n" for k in range(5000)) + "  sleep(9)\nend\n"
    )
    controller.run(source, "")
    controller.tick()
    assert controller.machine is None
    begun = time.monotonic()
    while controller.machine is None and time.monotonic() - begun < 60.0:
        controller.tick()
    assert controller.program == "long"
    assert robot.ticks > 20
    controller.run("def bad():\n  nothing()\nend\n", "")
    while "line 2, column 3: compile_error_name_not_found:nothing:" not in controller.log[-1]:
        controller.tick()
    controller.run(source + "#\n", "")
    controller.stop("by the test")
    reader.shutdown()
    for _ in range(20):
        controller.tick()
    assert controller.machine is None


def test_programmes_are_refused_with_their_place(served: Served) -> None:
    primary = served.connect(PRIMARY)
    primary.sendall(b"def bad():\n  no_such_function(1)\nend\n")
    served.until(lambda: any("line 2" in line for line in served.controller.log))
    found = b""
    while b"no_such_function" not in found:
        found += primary.recv(65536)
    assert served.controller.machine is None


def test_bytes_that_nobody_should_send_do_no_harm(served: Served) -> None:
    rng = np.random.default_rng(int(time.time()))
    for number in range(600):
        port = (DASHBOARD, PRIMARY, SECONDARY, REALTIME, RTDE)[number % 5]
        with contextlib.suppress(OSError), served.connect(port) as connection:
            data = rng.bytes(int(rng.integers(1, 400)))
            if port == RTDE and number % 2:
                kind = int(rng.choice(list(b"VvOISPUM")))
                data = struct.pack(">HB", 3 + len(data), kind) + data
            connection.sendall(data)
    assert served.thread.is_alive()
    served.until(lambda: len(served.server._clients) == 0)
    assert served.controller.claimed == {}
    connection = served.connect(DASHBOARD)
    connection.recv(200)
    assert lines(connection, "safetymode") == ["Safetymode: NORMAL"]


def test_twenty_clients_and_one_that_never_reads(served: Served) -> None:
    idle = served.connect(REALTIME)
    clients = [Rtde(served) for _ in range(20)]
    for client in clients:
        client.ask(b"V", struct.pack(">H", 2))
        client.ask(b"O", struct.pack(">d", 125.0) + b"timestamp,actual_q")
        client.ask(b"S", b"")
    for client in clients:
        heard = [client.read()[0] for _ in range(50)]
        assert heard[-10:] == [b"U"] * 10  # data, behind the answers to what was asked
    idle.close()


def test_a_lock_step_client_gets_the_same_bytes_twice(build: Callable[[], SimulatedRobot]) -> None:
    heard = []
    for _ in range(2):
        served = Served(build(), False)
        try:
            client = Rtde(served)
            client.ask(b"V", struct.pack(">H", 2))
            client.ask(b"O", struct.pack(">d", 500.0) + b"timestamp,actual_q,actual_TCP_force")
            client.ask(b"I", b"input_int_register_0")
            client.ask(b"S", b"")
            said = b""
            for number in range(500):
                while (package := client.read())[0] != b"U":
                    pass
                said += package[1]
                client.send(b"U", struct.pack(">Bi", 1, number))
            heard.append(said)
        finally:
            served.end()
    assert len(heard[0]) == 500 * (1 + 13 * 8)
    assert heard[0] == heard[1]


def test_taken_ports_are_named(served: Served) -> None:
    with pytest.raises(InputError, match=f"port {DASHBOARD + served.offset} of {ADDRESS} cannot be used"):
        Server(served.controller, ADDRESS, True, served.offset)


def test_a_server_without_its_ports_says_so_once_and_ends(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.8", REALTIME)):
        words = ("serve", "--part", "plate", "--address", "127.0.0.8", "--out", "SERVED")
        ended = subprocess.run([*PROGRAM, *words], cwd=tmp_path, capture_output=True, text=True, timeout=240)
    assert ended.returncode == 2
    assert ended.stderr.count("error:") == ended.stderr.count(f"port {REALTIME} of 127.0.0.8") == 1
    assert "plan" not in ended.stderr  # before the cell is prepared
    assert not (tmp_path / "SERVED").exists()


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The path of a coarse plan of the plate."""
    folder = tmp_path_factory.mktemp("planned")
    words = ["plan", str(plate_file()), "--stepover", "40", *UNPROVEN, "--out", str(folder / "PLAN")]
    with undrawn():
        assert execute(commands, words) == 0
    return folder / "PLAN/path.csv"


def test_two_robots_have_a_process_each_and_end_with_the_first(planned: Path, tmp_path: Path) -> None:
    both = ("127.0.0.9", "127.0.0.10")
    words = [*PROGRAM, "serve", "--part", str(plate_file()), "--path", str(planned), "--out", "TWO"]
    for address in both:
        words += ["--address", address]
    with (tmp_path / "said").open("w") as stream:
        process = subprocess.Popen(words, cwd=tmp_path, stdout=stream, stderr=stream)
    try:
        for _ in range(1200):
            assert process.poll() is None, (tmp_path / "said").read_text()
            if (tmp_path / "said").read_text().count("serving") == 2:
                break
            time.sleep(0.1)
        for address in both:
            with socket.create_connection((address, SECONDARY)) as line:
                line.sendall(f'textmsg("this is {address}")\n'.encode())
                assert line.recv(1)
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        assert process.wait(120) == 0, (tmp_path / "said").read_text()
    finally:
        process.kill()
    for address in both:
        assert f"this is {address}" in (tmp_path / f"TWO/{address}/controller.log").read_text()


def test_addresses_and_versions_that_are_none_are_refused(polish_sim: Callable[..., object]) -> None:
    for words, said in (
        (("--address", "robot"), "is no IP address"),
        (("--polyscope", "4.0"), "5.11"),
        (("--speed", "fast"), "max"),
        (("--address", ADDRESS, "--address", ADDRESS), "an address of its own"),
        (("--score", "nothing"), "step-20"),
        (("--score", "step-20", "--part", "plate"), "--part"),
        (("--live", "--live-port", "8099", "--address", ADDRESS, "--address", "127.0.0.2"), "one robot"),
    ):
        call = polish_sim("serve", *words)
        assert (call.code, said in call.err, call.err.count("\n")) == (2, True, 1), call.err  # type: ignore[attr-defined]


@pytest.mark.skipif(
    importlib.util.find_spec("rtde_control") is None, reason="no ur_rtde: there is no wheel of it here"
)
def test_the_unmodified_client_polishes(planned: Path, tmp_path: Path) -> None:
    words = ["serve", "--part", str(plate_file()), "--path", str(planned)]
    words += ["--out", "SERVED", "--address", "127.0.0.3"]
    with (tmp_path / "said").open("w") as stream:
        process = subprocess.Popen([*PROGRAM, *words], cwd=tmp_path, stdout=stream, stderr=stream)
    try:
        for _ in range(1200):
            assert process.poll() is None, (tmp_path / "said").read_text()
            if "serving" in (tmp_path / "said").read_text():
                break
            time.sleep(0.1)
        example = Path(__file__).parents[2] / "examples/ur_rtde_polish.py"
        client = [sys.executable, str(example), str(planned), "--seconds", "4", "--host", "127.0.0.3"]
        done = subprocess.run(client, cwd=tmp_path, capture_output=True, text=True, timeout=240)
        assert done.returncode == 0, done.stdout + done.stderr
        mean = float(done.stdout.partition("mean ")[2].split(" ")[0])
        assert mean == pytest.approx(20.0, abs=0.5)
        process.send_signal(signal.SIGINT)
        assert process.wait(120) == 0, (tmp_path / "said").read_text()
    finally:
        process.kill()
    figures = json.loads((tmp_path / "SERVED/metrics.json").read_text())
    with np.load(tmp_path / "SERVED/log.npz") as log:
        time_s, exact = log["time_s"][log["phase"] == 2], log["normal_force_n"][log["phase"] == 2]
    # Force mode of a UR settles within some two seconds.
    assert exact[time_s > time_s[0] + 2.0].mean() == pytest.approx(20.0, abs=1.0)
    assert figures["contact_lost_s"] == 0.0
    assert (tmp_path / "SERVED/report.html").exists()
