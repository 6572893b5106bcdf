"""`--live` and `view` in a real browser: the run as it goes, what is changed there, who may look."""

import importlib.util
import os
import shutil
import signal
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
from contextlib import suppress
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from rich.progress import Progress

from polish_sim.analysis.run_record import read_record
from polish_sim.cli.progress import ProgressObserver
from polish_sim.cli.view import PORT, Address, allowed, asked_address, free_address
from polish_sim.config import Scenario
from polish_sim.errors import InputError
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.page.page import read_page
from polish_sim.scenario_file import load_scenario, override
from tests.cli.conftest import PROGRAM, Started, in_browser

WITH_VISER = importlib.util.find_spec("viser") is not None
served = pytest.mark.skipif(not WITH_VISER, reason="no viser: pip install 'polish-sim[view]'")
SHORT = ["process.hold_s=1"]
LIVE = ("run", "force", "--live", "--set", "process.approach_speed_m_s=0.05", "--out", "out")


def same(one, other, rows=None):
    """Whether all rows are alike, or the first ones."""
    return one.names == other.names and all(
        one[name][:rows].tobytes() == other[name][:rows].tobytes() for name in one.names
    )


def free_port():
    with socket.socket() as any_port:
        any_port.bind(("127.0.0.1", 0))
        return int(any_port.getsockname()[1])


@served
def test_a_run_that_is_shown_writes_the_same_bytes_and_leaves_nothing_behind():
    from polish_sim.cli.live_view import LiveView

    scenario, port = override(default_scenario("force"), SHORT), free_port()
    threads = set(threading.enumerate())
    with LiveView(Address("127.0.0.1", port), "a <b>title</b>") as live:
        live.page.speed = np.inf
        shown = run_experiment(
            scenario, None, observer := ProgressObserver(Progress(disable=True), str, [live])
        )
        assert "a &lt;b&gt;title" in live.page.text.content
    assert live.page.shown >= 1
    assert not observer.cell.asked
    assert same(shown.log, run_experiment(scenario).log)
    assert not {thread for thread in set(threading.enumerate()) - threads if "ThreadPool" not in thread.name}
    assert free_address(Address("127.0.0.1", port)).port == port


@served
def test_pages_of_other_servers_are_refused():
    from viser import _messages
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    from polish_sim.cli.live_page import LivePage

    page = LivePage(Address("127.0.0.1", port := free_port()), "a run")
    here, url = f"http://127.0.0.1:{port}", f"ws://127.0.0.1:{port}"
    for headers in ({"Origin": "http://evil.example"}, {"Origin": f"http://localhost:{port}"}):
        with pytest.raises(InvalidStatus, match="403"):
            connect(url, additional_headers=headers)
    connect(url, additional_headers={"Origin": here}).close()
    assert _messages.ShareUrlRequest not in page.server._websock_server._incoming_handlers
    page.close("")


def test_this_computer_alone_is_served_unless_an_address_is_named_and_only_to_its_own_pages():
    if WITH_VISER:
        assert asked_address({"--live-host": None, "--live-port": None}) == Address("127.0.0.1")
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with suppress(OSError):  # somebody else has it
            taken.bind(("127.0.0.1", PORT))
            taken.listen()
        assert free_address(Address("127.0.0.1")).port != PORT
        with pytest.raises(InputError, match=f"port {PORT}: Address already in use"):
            free_address(Address("127.0.0.1", PORT))
    with pytest.raises(InputError, match=r"no page can be served at '192\.0\.2\.1'"):
        free_address(Address("192.0.2.1"))
    for origin, host, may in (
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True), ("http://localhost:8080", "localhost:8080", True),
        ("http://[::1]:8080", "[::1]:8080", True), (None, "127.0.0.1:8080", True),
        ("http://127.0.0.1:9090", "127.0.0.1:8080", False), ("null", "127.0.0.1:8080", False),
        ("http://rebound.example:8080", "rebound.example:8080", False),
        (None, "rebound.example:8080", False), (None, "", False),
    ):  # fmt: skip
        assert allowed(origin, host) is may, (origin, host)


class Tab:
    """A page in the browser, and what it asked for and complained of."""

    def __init__(self, browser, url):
        self.requests, self.errors = [], []
        self.tab = browser.new_context(viewport={"width": 700, "height": 600}).new_page()
        self.tab.set_default_timeout(60_000)
        self.tab.on("request", lambda request: self.requests.append(request.url))
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.goto(url)
        self.tab.get_by_text("resume").wait_for()

    def press(self, button):
        self.tab.get_by_role("button", name=button, exact=True).click()

    def wait_for(self, text):
        self.tab.get_by_text(text).first.wait_for()

    def press_until(self, button, text):
        """Press what still moves in a folder that opens: in a slow browser it slides away under the mouse."""
        for _ in range(6):
            self.press(button)
            try:
                return self.tab.get_by_text(text).first.wait_for(timeout=10_000)
            except Exception as late:
                if "Timeout" not in str(late):
                    raise
        raise AssertionError(f"{text!r} does not show after {button!r}")

    def paused(self):
        """Let the run wait; the simulated time then [s]."""
        self.press("pause")
        self.wait_for("(paused)")
        return self.clock()

    def clock(self):
        """Simulated time the page shows [s]."""
        return float(self.tab.get_by_text(" s of ").first.inner_text().partition(" s of ")[0].split("\n")[-1])

    def picture(self):
        return np.asarray(Image.open(BytesIO(self.tab.screenshot())).convert("RGB"))[:, :350].copy()

    def close(self):
        """As somebody closes a tab; it asked nobody else for anything, and nothing went wrong in it."""
        hosts = [url.split("/")[2] for url in self.requests if url.startswith("http")]
        assert set(hosts) == {hosts[0]}
        assert self.errors == []
        self.tab.context.close()


class Running:
    """A command that serves a page."""

    def __init__(self, folder, *words):
        self.url = f"http://127.0.0.1:{(port := free_port())}"
        self._said = folder / "said"
        words = (*words, "--live-port", str(port))
        with self._said.open("w") as stream:
            self.process = Started(*words, folder=folder, out=stream.fileno(), err=stream.fileno())
        self.until(lambda: f"open {self.url} in a browser" in self.said)

    @property
    def said(self):
        return self._said.read_text()

    def until(self, done):
        for _ in range(900):
            if done():
                return
            assert self.process.poll() is None, self.said
            time.sleep(0.1)
        raise AssertionError(self.said)

    def interrupted(self):
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(60)


@pytest.fixture
def start(tmp_path):
    """Start a command in an empty folder; it does not outlive the test."""
    started = []

    def begin(*words):
        started.append(Running(tmp_path, *words))
        return started[-1]

    yield begin
    for run in started:
        run.process.kill()
        run.process.wait()


@served
def test_moments_keep_reaching_who_looks_on(start):
    import viser
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    run = start(*LIVE, "--set", "process.hold_s=60")
    run.until(lambda: "\nsimulate" in run.said)
    spoken = [Subprotocol(f"viser-v{viser.__version__}")]
    with connect(run.url.replace("http", "ws"), subprotocols=spoken, max_size=None, compression=None) as page:
        begun, arrived = time.monotonic(), 0
        while arrived < 20:
            page.recv(timeout=30.0)
            arrived += time.monotonic() > begun + 1.0  # the first second brings the scene
    assert run.interrupted() == 130


@served
@in_browser
def test_ctrl_c_while_a_run_waits_keeps_it_with_what_was_changed_in_the_page(start, tmp_path, request):
    run = start(*LIVE, "--set", "process.hold_s=600")
    browser = request.getfixturevalue("browser")  # only now: the run was forked
    tab = Tab(browser, run.url)
    tab.wait_for("of 20 N")
    stood = tab.paused()
    tab.press("step")
    run.until(lambda: tab.clock() > stood)
    stepped = tab.clock()
    assert stepped == pytest.approx(stood + 0.012, abs=0.01)
    force = tab.tab.get_by_role("textbox").first
    force.fill("26")
    force.press("Enter")
    tab.wait_for("force_n=26")
    # Who comes later sees the same page.
    tab.close()
    tab = Tab(browser, run.url)
    tab.press("step")
    tab.wait_for("of 26 N")
    tab.tab.get_by_text("Faults").click()
    tab.press_until("friction-jump", "friction-jump@")
    first = tab.picture()
    tab.press("tool")
    run.until(lambda: float(np.mean(first != tab.picture())) > 0.02)
    tab.press("fastest")
    tab.press("resume")
    run.until(lambda: tab.clock() > stepped + 1.0)
    stood = tab.paused()
    assert run.interrupted() == 130
    assert "Traceback" not in run.said
    tab.wait_for("The run is over")
    tab.close()
    assert free_address(Address("127.0.0.1", int(run.url.rpartition(":")[2])))
    record = read_record(tmp_path / "out")
    assert record.metrics["simulated_s"] == pytest.approx(stood, abs=0.02)
    change, _, at = record.scenario.process.changes.partition("@")
    assert (change, float(at)) == ("force_n=26", pytest.approx(stepped, abs=0.0051))
    assert record.scenario.faults.events.startswith("friction-jump@")
    again = override(load_scenario(tmp_path / "out/config.toml", Scenario()), [f"process.hold_s={stood}"])
    assert same(run_experiment(again).log, record.log, len(record.log))


def test_a_saved_run_is_served_as_its_page_and_to_its_own_pages_alone(polish_sim, start, tmp_path):
    assert polish_sim("run", "arc", "--set", "process.max_feed_s=0.2", "--out", "out").code == 0
    again = start("view", "out")
    shown = urllib.request.urlopen(again.url).read().decode()
    assert shown.startswith("<!DOCTYPE html>")
    (tmp_path / "shown.html").write_text(shown)
    assert read_page(tmp_path / "shown.html").title == read_page(tmp_path / "out/report.html").title
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(urllib.request.Request(again.url, headers={"Host": "elsewhere.example"}))
    assert again.interrupted() == 0
    assert "Traceback" not in again.said


@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="no display to try --view on: apt install xvfb")
def test_mujocos_own_window_shows_the_run_and_ctrl_c_closes_it(tmp_path):
    screen, colors = ["-screen", "0", "640x480x24", "-fbdir", str(tmp_path)], 0
    display = subprocess.Popen(["Xvfb", "-displayfd", "1", *screen], stdout=subprocess.PIPE)
    name = display.stdout.readline().decode().strip()
    environment = os.environ | {"DISPLAY": f":{name}", "MUJOCO_GL": "glfw"}
    command = [*PROGRAM, "run", "force", "--view", "--set", "process.hold_s=600", "--out", "out"]
    run = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        for _ in range(600):
            pixels = np.fromfile(tmp_path / "Xvfb_screen0", np.uint8)[-640 * 480 * 4 :].reshape(480, 640, 4)
            colors = len(np.unique(pixels[::4, ::4].reshape(-1, 4), axis=0))
            if colors > 200 or run.poll() is not None:
                break
            time.sleep(0.1)
        run.send_signal(signal.SIGINT)
        said = run.communicate(timeout=60)[1]
    finally:
        for process in (run, display):
            process.kill()
            process.wait()
    assert (run.returncode, "Traceback" in said) == (130, False), said
    assert colors > 200
    log = read_record(tmp_path / "out").log
    alone = run_experiment(override(default_scenario("force"), SHORT)).log
    rows = min(len(log), len(alone))
    assert rows > 1
    assert all(log[name][:rows].tobytes() == alone[name][:rows].tobytes() for name in ("q_rad", "torque_nm"))
