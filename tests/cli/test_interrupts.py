"""Ctrl-C: 130 and one line; no file is left half written, and what was recorded is kept."""

from __future__ import annotations

import ctypes
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import typer

from polish_sim.cli.boundary import execute
from tests.cli.conftest import PROGRAM, Tool


def write_long_path(file: Path) -> None:
    """A spiral of 60,000 way points, which take seconds to read and to smooth."""
    rows = (
        (10.0 + 5e-4 * k, 0.02 * k / (10.0 + 5e-4 * k)) for k in range(60_000)
    )  # radius [mm] and angle of points 0.02 mm apart
    lines = (f"{r * math.cos(a):.5f},{r * math.sin(a):.5f},0,0,0,1" for r, a in rows)
    file.write_text("x,y,z,i,j,k\n" + "\n".join(lines) + "\n")


def broken_off(words: list[str], folder: Path, ready: Callable[[Path], bool], then_s: float) -> str:
    """What a command says when Ctrl-C comes a while after its draft folder is ready; it ends with 130."""
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        [*PROGRAM, *words, "--out", "out/cut"], cwd=folder, env=environment, stderr=subprocess.PIPE, text=True
    ) as run:
        while not ready(folder / "out/.cut.polish-sim-part"):
            assert run.poll() is None, run.communicate()[1]
            time.sleep(0.02)
        time.sleep(then_s)
        run.send_signal(signal.SIGINT)
        _, err = run.communicate()
    assert run.returncode == 130, err
    assert "Traceback" not in err
    return err


@pytest.mark.parametrize(
    "words",
    [
        ["smooth", "path.csv"],
        ["run", "smooth"],
        ["identify", "--starts", "50"],
        ["run", "force", "--seeds", "2", "--set", "process.hold_s=600"],
    ],
    ids=" ".join,
)
def test_ctrl_c_of_what_records_nothing_on_the_way_leaves_nothing(words: list[str], tmp_path: Path) -> None:
    write_long_path(tmp_path / "path.csv")
    err = broken_off(words, tmp_path, lambda draft: draft.exists(), 1.0)
    assert err.splitlines()[-1].startswith("error: interrupted")
    assert [path.name for path in tmp_path.iterdir()] == ["path.csv"]


def test_ctrl_c_while_the_program_is_loaded_ends_it_quietly() -> None:
    loading = "import builtins; real = builtins.__import__\n"
    loading += "def load(name, *rest):\n  if name == 'polish_sim.cli.main': raise KeyboardInterrupt\n"
    loading += "  return real(name, *rest)\nbuiltins.__import__ = load\nfrom polish_sim.cli import start; start()"
    run = subprocess.run([sys.executable, "-c", loading], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (130, "", "")


def test_ctrl_c_that_python_drops_where_c_calls_it_is_no_bug_of_ours(capsys: pytest.CaptureFixture[str]) -> None:
    """As while kernels are compiled: the compiler's callback loses the interrupt, then what it should have made is
    missing.
    """
    app = typer.Typer()

    @app.command()
    def compile_kernels() -> None:
        def interrupted() -> None:
            raise KeyboardInterrupt

        ctypes.CFUNCTYPE(None)(interrupted)()
        raise RuntimeError("no compiled object yet")

    assert execute(app, ["--"]) == 130
    assert capsys.readouterr().err == "error: interrupted; nothing was recorded yet.\n"


def test_ctrl_c_that_python_drops_without_a_trace_comes_again(capsys: pytest.CaptureFixture[str]) -> None:
    app = typer.Typer()

    @app.command()
    def go_on_for_ever() -> None:
        def interrupted() -> None:
            raise KeyboardInterrupt

        ctypes.CFUNCTYPE(None)(interrupted)()
        deadline = time.monotonic() + 30.0
        while time.monotonic() < deadline:
            time.sleep(0.01)

    assert execute(app, ["--"]) == 130
    assert capsys.readouterr().err == "error: interrupted; nothing was recorded yet.\n"


def test_ctrl_c_while_a_c_module_is_loaded_is_no_bug_of_ours(capsys: pytest.CaptureFixture[str]) -> None:
    """Modules built with pybind11 turn it into an ImportError."""
    app = typer.Typer()

    @app.command()
    def load() -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise ImportError("initialization failed") from interrupt

    assert execute(app, ["--"]) == 130
    assert capsys.readouterr().err == "error: interrupted; nothing was recorded yet.\n"


@pytest.mark.parametrize("what", ["tcp", "base", "payload"])
def test_ctrl_c_of_many_calibrations_keeps_those_that_were_done(what: str, polish_sim: Tool, tmp_path: Path) -> None:
    assert polish_sim("calibrate", what, "--out", "compiled").code == 0
    words = ["calibrate", what, "--seeds", "100000"]
    if what == "payload":
        err = broken_off(words, tmp_path, lambda draft: (draft / "seed-0001").exists(), 0.05)
    else:
        err = broken_off(words, tmp_path, lambda draft: draft.exists(), 2.0)
    assert "interrupted: what was recorded up to now is kept." in err
    cut = tmp_path / "out/cut"
    metrics = json.loads((cut / "metrics.json").read_text(encoding="utf-8"))
    count = len(metrics["seeds"])
    assert 0 < count < 100_000
    assert metrics["seeds"] == list(range(count))
    assert len(metrics["runs"]) == count
    folders = {f"seed-{seed:04d}" for seed in range(count)} if what == "payload" else set()
    assert {path.name for path in cut.iterdir()} == {"metrics.json"} | folders
    files = {"calibration.toml", "residuals.csv", "metrics.json", "config.toml", "residuals.png", "drift.png"}
    assert all({path.name for path in (cut / name).iterdir()} == files for name in folders)
