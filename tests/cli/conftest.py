"""The command line as a user calls it, in an empty folder."""

import atexit
import importlib.util
import json
import os
import re
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from matplotlib.figure import Figure

from polish_sim.cli.boundary import execute
from polish_sim.cli.main import app, commands

PROGRAM = [sys.executable, "-c", "from polish_sim.cli.main import app; app()"]
UNPROVEN = ("--proof", "none")  #: Where the proof is not what is tested
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
in_browser = pytest.mark.skipif(
    BROWSER is None or importlib.util.find_spec("playwright") is None,
    reason="no browser: apt install chromium, pip install playwright",
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """The system's Chromium, with WebGL in software."""
    from playwright.sync_api import sync_playwright

    words = ["--enable-unsafe-swiftshader", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=BROWSER, args=words)
        yield started
        started.close()


def metrics_of(folder: Path | str) -> dict[str, Any]:
    """The figures a command wrote into a folder."""
    return dict(json.loads(Path(folder, "metrics.json").read_text(encoding="utf-8")))


class Started:
    """`polish-sim` at work in a process of its own, forked from this one: nothing is imported or drawn anew.

    ``out`` and ``err`` are the descriptors of files for what it says.
    """

    def __init__(self, *words: object, folder: Path, out: int = 1, err: int = 2, begin: Any = app) -> None:
        self.returncode: int | None = None
        self.pid = os.fork()
        if self.pid == 0:
            try:
                atexit._clear()
                os.chdir(folder)
                for stream, given in ((1, out), (2, err)):
                    os.dup2(given, stream)
                sys.stdout, sys.stderr = (os.fdopen(stream, "w", 1, closefd=False) for stream in (1, 2))
                sys.argv = ["polish-sim", *map(str, words)]
                begin()
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(99)

    def __enter__(self) -> "Started":
        return self

    def __exit__(self, *_: object) -> None:
        self.wait()

    def poll(self, options: int = os.WNOHANG) -> int | None:
        """The exit code once it has ended."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, options)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout_s: float = 120.0) -> int:
        """The exit code, once it has ended; it is killed if it does not."""
        latest = time.monotonic() + timeout_s
        while self.poll() is None:
            time.sleep(0.005)
            if time.monotonic() > latest:
                self.kill()
                raise AssertionError("it does not end")
        return self.returncode  # type: ignore[return-value]

    def send_signal(self, number: signal.Signals) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)
        self.poll(0)


@contextmanager
def undrawn() -> Iterator[None]:
    """Leave pictures empty: drawing takes most of the time of a short run."""

    def save(self: Figure, file: object, **words: Any) -> None:
        if isinstance(file, Path):
            file.touch()
        else:
            drawn(self, file, **words)

    def save_cell(file: Path, *_: object) -> bool:
        file.touch()
        return True

    drawn = Figure.savefig
    with pytest.MonkeyPatch.context() as left_out:
        left_out.setattr(Figure, "savefig", save)
        for name in ("path_plot.plot_plan", "inspect_plot.plot_maps", "removal_plot.plot_removal"):
            left_out.setattr(f"polish_sim.analysis.{name}", lambda *_, **__: Figure())
        for name in ("corners", "joints", "tool_rates"):
            left_out.setattr(f"polish_sim.smoothing.plots.plot_{name}", lambda *_, **__: Figure())
        for name in ("run", "report"):
            left_out.setattr(f"polish_sim.cli.{name}.save_cell_picture", save_cell)
        yield


def ran(*words: object) -> None:
    """Run a command for the fixture of a module: without pictures, and to the end."""
    with undrawn():
        assert execute(commands, [str(word) for word in words]) == 0


@pytest.fixture(autouse=True)
def _undrawn(request: pytest.FixtureRequest) -> Iterator[None]:
    """Tests with the mark `pictures` draw, and commands in other processes."""
    with nullcontext() if "pictures" in request.keywords else undrawn():
        yield


class Call(NamedTuple):
    """What a command line left behind."""

    code: int
    out: str
    err: str


def assert_refused(call: Call, said: str, *there: str) -> None:
    """One error with code 2 that says facts in order, " ... " between them; the folder holds nothing new."""
    assert (call.code, call.out) == (2, ""), call.err
    (error,) = [line for line in call.err.splitlines() if line.startswith("error: ")]
    assert re.search(".*".join(map(re.escape, said.split(" ... "))), error), error
    assert {path.name for path in Path().iterdir()} - {"__pycache__"} == set(there)


def refused(call: Call, *facts: str, code: int = 2) -> None:
    """One error with this code that names these facts."""
    assert call.code == code, call.err
    assert [fact for fact in facts if fact not in call.err] == [], call.err


def interrupted(*_: object, **__: object) -> None:
    """In place of something that Ctrl-C comes in."""
    raise KeyboardInterrupt


def done(call: Call, *facts: str) -> Call:
    """A command that did what it was asked and says these facts."""
    assert call.code == 0, call.err
    assert [fact for fact in facts if fact not in call.out + call.err] == [], call
    return call


@pytest.fixture
def polish_sim(tmp_path, monkeypatch, capfd) -> Callable[..., Call]:
    """Run `polish-sim` with the given words; the current folder is empty before the first call."""
    monkeypatch.chdir(tmp_path)

    def call(*words: object) -> Call:
        capfd.readouterr()
        code = execute(commands, [str(word) for word in words])
        return Call(code, *capfd.readouterr())

    return call
