"""Ctrl-C: 130 and one line; no file is left half written, and what was recorded is kept."""

import ctypes
import os
import pty
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
import typer

from polish_sim.cli import console, progress, start
from polish_sim.cli.boundary import execute
from polish_sim.log import read_log
from tests.cli.conftest import PROGRAM, Started, done, metrics_of
from tests.kept import plate_file

NOTHING = "error: interrupted; nothing was recorded yet.\n"


def interrupted(words, folder, ready, then_s, signals=(signal.SIGINT,)):
    """What a command says when Ctrl-C or other ``signals`` come a while after it is ready, by its draft, or
    the folder of its rows, and what it has said; it ends with 130. It says every 0.1 s how far it is."""
    out, draft = folder / "out/cut", folder / "out/.cut.polish-sim-part"

    def talk():
        progress.QUIET_S = 0.1
        start()

    with (
        tempfile.NamedTemporaryFile() as said,
        Started(*words, "--out", "out/cut", folder=folder, err=said.fileno(), begin=talk) as run,
    ):
        while not ready(out if (out / "rows.jsonl").exists() else draft, Path(said.name).read_text()):
            assert run.poll() is None, Path(said.name).read_text()
            time.sleep(0.02)
        time.sleep(then_s)
        for number in signals:
            run.send_signal(number)
            time.sleep(0.02)
        run.wait()
        err = Path(said.name).read_text()
    assert run.returncode == 130, err
    assert "Traceback" not in err
    return err


@pytest.mark.parametrize(
    "words",
    [["identify", "--starts", "50"], ["run", "force", "--seeds", "2", "--set", "process.hold_s=600"]],
    ids=" ".join,
)
def test_ctrl_c_of_what_records_nothing_on_the_way_leaves_nothing(words, tmp_path):
    err = interrupted(words, tmp_path, lambda draft, _: draft.exists(), 0.2)
    assert err.splitlines()[-1].startswith("error: interrupted")
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_the_program_is_loaded_is_one_line():
    loading = "import builtins; real = builtins.__import__\n"
    loading += "def load(name, *rest):\n  if name == 'polish_sim.cli.main': raise KeyboardInterrupt\n"
    loading += "  return real(name, *rest)\nbuiltins.__import__ = load\n"
    loading += "from polish_sim.cli import start; start()"
    run = subprocess.run([sys.executable, "-c", loading], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (130, "", NOTHING)


def dropped():
    """Ctrl-C where C calls Python, as while kernels are compiled: Python drops it there."""

    def interrupted():
        raise KeyboardInterrupt

    ctypes.CFUNCTYPE(None)(interrupted)()


def compile_kernels():
    dropped()
    raise RuntimeError("no compiled object yet")  # what the compiler's callback should have made


def go_on_for_ever():
    dropped()
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        time.sleep(0.01)


def load_c_module():
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt as interrupt:  # modules built with pybind11 turn it into this
        raise ImportError("initialization failed") from interrupt


class Argument:
    @property
    def _as_parameter_(self):
        raise KeyboardInterrupt


def call_c_function():
    ctypes.CDLL(None).abs(Argument())  # ctypes makes an error of its own of it


@pytest.mark.parametrize("command", [compile_kernels, go_on_for_ever, load_c_module, call_c_function])
def test_ctrl_c_that_is_dropped_or_taken_for_another_error_ends_it(command, capsys):
    app = typer.Typer()
    app.command()(command)
    assert execute(app, ["--"]) == 130
    assert capsys.readouterr().err == NOTHING


def test_ctrl_c_however_often_and_a_closed_terminal_keep_what_a_run_recorded(tmp_path, monkeypatch):
    arc = ["run", "arc", "--feed", "0.5"]
    err = interrupted(arc, tmp_path, lambda _, said: "simulate: " in said, 0.0, 20 * [signal.SIGINT])
    assert "kept" in err
    assert len(read_log(tmp_path / "out/cut/log.npz")) > 10
    assert metrics_of(tmp_path / "out/cut")["path_done"] < 1.0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["cut"]
    # A closed terminal does as well.
    ours, its = pty.openpty()
    monkeypatch.setenv("TERM", "xterm")

    def run_there():
        os.close(ours)
        start()

    words = ["run", "arc", "--feed", "0.5", "--out", "cut"]
    with Started(*words, folder=tmp_path, out=its, err=its, begin=run_there) as run:
        os.close(its)
        said = b""
        while b"%" not in said.partition(b"simulate")[2]:
            said += os.read(ours, 1000)
        os.close(ours)
        time.sleep(0.3)  # what is written before the signal is lost
        run.send_signal(signal.SIGHUP)
    assert run.returncode == 130
    assert metrics_of(tmp_path / "cut")["path_done"] < 1.0


def test_streams_that_are_closed_or_lack_a_sign_fail_no_command(monkeypatch, tmp_path):
    closed = ["sh", "-c", 'exec "$0" "$@" >&- 2>&-', *PROGRAM]
    assert subprocess.run([*closed, "list"], check=False).returncode == 0
    assert subprocess.run([*closed, "nothing"], check=False).returncode == 2
    with (tmp_path / "said").open("w", encoding="ascii") as narrow:
        monkeypatch.setattr(sys, "stdout", narrow)
        console.outlive_terminal()
        console.say("force in ±4 N")
    assert (tmp_path / "said").read_text() == "force in \\xb14 N\n"


def test_ctrl_c_of_many_seeds_keeps_those_that_ended_and_goes_on(tmp_path, polish_sim):
    many = ["run", "arc", "--seeds", "5", "--set", "process.max_feed_s=0.5"]
    second = lambda folder, _: (folder / "seed-0001").exists()  # noqa: E731
    err = interrupted([*many, "--workers", "1"], tmp_path, second, 0.0)
    assert err.splitlines()[-1].endswith("the same command with --out out/cut resumes.")
    kept = metrics_of(tmp_path / "out/cut")["seeds"]
    assert 1 <= len(kept) < 5
    assert {folder.name for folder in Path("out/cut").glob("seed-*")} == {f"seed-{s:04d}" for s in kept}
    begun = (tmp_path / "out/cut/rows.jsonl").read_bytes()
    assert (tmp_path / "out/cut/seed-0000/log.npz").is_file()
    done(polish_sim(*many, "--on", "here", "--out", "out/cut"))
    assert metrics_of(tmp_path / "out/cut")["seeds"] == list(range(5))
    assert (tmp_path / "out/cut/rows.jsonl").read_bytes().startswith(begun)
    assert polish_sim(*many, "--feed", "20", "--out", "out/cut").code == 2  # another run is not mixed in


def test_a_job_that_is_killed_says_how_to_go_on_and_that_goes_on(tmp_path, polish_sim):
    job = f'part = "{plate_file()}"\n[cell]\nsafety.proof = "none"\n[[setup]]\n[[setup.pass]]\n'
    (tmp_path / "job.toml").write_text(f"{job}plan.stepover_m = 0.04\nprocess.feed_m_s = 0.06\n")
    pieces = tmp_path / "out/cut/setup_1/region_1/pass_1/pieces"
    began = lambda *_: any(pieces.rglob("[0-9]*.npz"))  # noqa: E731
    err = interrupted(["job", "job.toml"], tmp_path, began, 0.0, [signal.SIGTERM])
    more = "--resume --out 'out/cut'"
    assert err.splitlines()[-1].endswith(f"the same command resumes it with {more}")
    assert polish_sim("job", "job.toml", *shlex.split(more)).code == 0
