"""`--live` and `view` in a real browser: the run as it goes, what is changed there, who may look."""

from __future__ import annotations

import importlib.util
import shutil
import socket
import threading
from pathlib import Path

import numpy as np
import pytest

from polish_sim.cli.view import PORT, Address, allowed, asked_address, free_address
from polish_sim.errors import InputError
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.log import RunLog
from polish_sim.scenario_file import override
from tests.cli.conftest import Tool

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
WITH_VISER = importlib.util.find_spec("viser") is not None
HERE = BROWSER is not None and WITH_VISER and importlib.util.find_spec("playwright") is not None
served = pytest.mark.skipif(not WITH_VISER, reason="no viser: pip install 'polish-sim[view]'")
in_browser = pytest.mark.skipif(
    not HERE, reason="no browser or viser: apt install chromium, pip install playwright viser"
)
SHORT = ["process.hold_s=1"]


def same(one: RunLog, other: RunLog) -> bool:
    return one.names == other.names and all(one[name].tobytes() == other[name].tobytes() for name in one.names)


def free_port() -> int:
    with socket.socket() as any_port:
        any_port.bind(("127.0.0.1", 0))
        return int(any_port.getsockname()[1])


@served
def test_a_run_that_is_shown_writes_the_same_bytes_and_leaves_nothing_behind() -> None:
    from rich.progress import Progress

    from polish_sim.cli.live_page import LiveView
    from polish_sim.cli.progress import ProgressObserver

    scenario, threads, port = override(default_scenario("force"), SHORT), set(threading.enumerate()), free_port()
    with LiveView(Address("127.0.0.1", port), "a <b>title</b>") as live:
        live.page.speed = np.inf
        shown = run_experiment(scenario, None, ProgressObserver(Progress(disable=True), str, [live]))
        assert "a &lt;b&gt;title" in live.page.text.content
    assert live.page.shown > 3
    assert same(shown.log, run_experiment(scenario).log)
    assert live.as_run(scenario) == scenario
    assert not {thread for thread in set(threading.enumerate()) - threads if "ThreadPool" not in thread.name}
    assert free_address(Address("127.0.0.1", port)).port == port


@served
def test_pages_of_other_servers_are_refused() -> None:
    from viser import _messages
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    from polish_sim.cli.live_page import Page

    page = Page(Address("127.0.0.1", port := free_port()), "a run")
    here, url = f"http://127.0.0.1:{port}", f"ws://127.0.0.1:{port}"
    for headers in ({"Origin": "http://evil.example"}, {"Origin": f"http://localhost:{port}"}):
        with pytest.raises(InvalidStatus, match="403"):
            connect(url, additional_headers=headers)
    connect(url, additional_headers={"Origin": here}).close()
    assert _messages.ShareUrlRequest not in page.server._websock_server._incoming_handlers
    page.close("")


@pytest.mark.parametrize(
    ("origin", "host", "may"),
    [
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://localhost:8080", "localhost:8080", True),
        ("http://[::1]:8080", "[::1]:8080", True),
        (None, "127.0.0.1:8080", True),
        ("http://127.0.0.1:9090", "127.0.0.1:8080", False),
        ("null", "127.0.0.1:8080", False),
        ("http://rebound.example:8080", "rebound.example:8080", False),
        (None, "rebound.example:8080", False),
        (None, "", False),
    ],
)
def test_only_the_servers_own_pages_may_use_it(origin: str | None, host: str, may: bool) -> None:
    assert allowed(origin, host) is may


def test_this_computer_alone_is_served_unless_an_address_is_named(polish_sim: Tool) -> None:
    if WITH_VISER:
        assert asked_address({}) == Address("127.0.0.1", None)
    assert "whoever reaches the address" in " ".join(polish_sim("run", "force", "--help").out.split())
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            taken.bind(("127.0.0.1", PORT))
            taken.listen()
        except OSError:
            pass  # somebody else has it
        assert free_address(Address("127.0.0.1", None)).port != PORT
        with pytest.raises(InputError, match=f"port {PORT}: Address already in use"):
            free_address(Address("127.0.0.1", PORT))
    with pytest.raises(InputError, match=r"no page can be served at '192\.0\.2\.1'"):
        free_address(Address("192.0.2.1", None))


def test_what_cannot_be_shown_is_said_before_anything_starts(
    polish_sim: Tool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    call = polish_sim("run", "force", "--live-port", "9000")
    assert (call.code, "give --live as well" in call.err) == (2, True)
    assert polish_sim("run", "force", "--live", "--seeds", "2").code == 2
    monkeypatch.setattr("polish_sim.cli.view.find_spec", lambda name: None)
    for words in (["run", "force", "--live"], ["view", "nowhere"]):
        call = polish_sim(*words)
        assert (call.code, call.err.count("\n")) == (2, 1)
        assert "pip install 'polish-sim[view]'" in call.err
    assert not list(tmp_path.iterdir())
