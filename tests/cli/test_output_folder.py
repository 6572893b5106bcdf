"""Errors, the output folder, progress and Ctrl-C: codes, one line, nothing half-written, records kept."""

import ctypes
import errno
import multiprocessing
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
from numba import njit

from polish_sim.cli import console, progress, start
from polish_sim.cli.boundary import execute
from polish_sim.cli.output_folder import claimed
from polish_sim.cli.progress import FIRST_START, compiling_shown, now_and_then
from polish_sim.errors import InputError, ProtectiveStop
from polish_sim.log import read_log
from tests.cli.conftest import PROGRAM, Started, done, metrics_of
from tests.kept import plate_file

MESSAGE = "the part 'x.stl' is empty"


def app_that(raises, returns=None):
    app = typer.Typer(rich_markup_mode=None)

    @app.callback()
    def options(debug: bool = False) -> None:
        """Stand where polish-sim's own options stand."""

    @app.command()
    def work() -> int | None:
        if raises is not None:
            raise raises
        return returns

    return app


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InputError(MESSAGE), 2), (ProtectiveStop(MESSAGE), 3),
        (KeyboardInterrupt(), 130), (OSError(errno.ENOSPC, "No space left on device"), 2),
        (OSError(errno.EROFS, "Read-only file system", "x"), 2),
        (OSError(errno.ENAMETOOLONG, "File name too long", "x"), 2),
    ],
)  # fmt: skip
def test_an_error_is_one_line_on_stderr_with_its_code(error, code, capsys):
    assert execute(app_that(error), ["work"]) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("error: ")
    assert shown.err.count("\n") == 1
    assert execute(app_that(None, code), ["work"]) == code
    assert execute(app_that(None, None), ["work"]) == 0


def test_an_unexpected_error_is_called_a_bug_and_traced_with_debug(capsys):
    assert execute(app_that(ZeroDivisionError("by zero")), ["work"]) == 70
    message = capsys.readouterr().err
    assert all(word in message for word in ("bug", "ZeroDivisionError: by zero", "--debug"))
    assert "Traceback" not in message
    assert execute(app_that(ZeroDivisionError("by zero")), ["--debug", "work"]) == 70
    assert "Traceback" in capsys.readouterr().err


def files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def asked(out, overwrite=False):
    return {"--out": out, "--overwrite": overwrite}


def test_a_folder_that_cannot_be_made_is_refused_and_without_out_a_dated_one_made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("out").mkdir()
    Path("taken").touch()
    # /proc takes no folders, whoever asks; a read-only folder would stop everybody but root.
    for out, said in (
        ("out", "--overwrite"), ("taken", "taken"), ("taken/out", "taken"), ("/proc/polish/out", "--out"),
    ):  # fmt: skip
        options = asked(Path(out), overwrite=out != "out")
        with pytest.raises(InputError, match=said), claimed(options, "run-force"):
            pytest.fail("the work must not start")
    assert files(tmp_path) == {"out", "taken"}
    finals = set()
    for _ in range(3):
        with claimed(asked(None), "run-force") as folder:
            (folder.draft / "log.npz").touch()
            assert not folder.final.exists()
        assert folder.final.parent == Path("results/run-force")
        assert files(folder.final) == {"log.npz"}
        finals.add(folder.final)
    assert len(finals) == 3


def fill(out, error):
    with claimed(asked(out, overwrite=True), "run-force") as folder:
        (folder.draft / "metrics.json").write_text("new")
        if error:
            raise error


def test_overwrite_replaces_files_of_the_same_name_and_a_failure_leaves_all_as_it_was(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "metrics.json").write_text("old")
    (out / "notes.txt").write_text("mine")
    for error in (RuntimeError(), KeyboardInterrupt()):
        for place in (out, tmp_path / "a" / "b" / "out"):
            with pytest.raises(type(error)):
                fill(place, error)
    assert (out / "metrics.json").read_text() == "old"
    fill(out, None)
    assert (out / "metrics.json").read_text() == "new"
    assert (out / "notes.txt").read_text() == "mine"
    assert files(tmp_path) == {"out", "out/metrics.json", "out/notes.txt"}


def test_what_was_measured_is_kept_where_its_pictures_find_no_room(tmp_path):
    with pytest.raises(OSError, match="No space left"):
        fill(tmp_path / "out", OSError(errno.ENOSPC, "No space left on device"))
    assert (tmp_path / "out" / "metrics.json").read_text() == "new"
    assert files(tmp_path) == {"out", "out/metrics.json"}


KILLED = """
import os, signal, sys
from pathlib import Path
from polish_sim.cli.output_folder import claimed
with claimed({"--out": Path(sys.argv[1]), "--overwrite": None}, "run-force") as folder:
    (folder.draft / "log.npz").touch()
    if sys.argv[2] == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    print("ready", flush=True)
    sys.stdin.read()
"""


def test_drafts_of_killed_commands_are_swept_those_of_running_ones_stay(tmp_path):
    (tmp_path / ".mine.part").mkdir()
    program = [sys.executable, "-c", KILLED]
    dead = subprocess.run([*program, str(tmp_path / "dead"), "die"], check=False)
    assert dead.returncode == -signal.SIGKILL
    pipe = subprocess.PIPE
    with subprocess.Popen([*program, str(tmp_path / "live"), "wait"], stdin=pipe, stdout=pipe) as running:
        assert running.stdout.readline() == b"ready\n"
        with claimed(asked(tmp_path / "next"), "run-force"):
            found = files(tmp_path)
        with (
            pytest.raises(InputError, match="another command is writing 'live'"),
            claimed(asked(tmp_path / "live"), "x"),
        ):
            pytest.fail("the work must not start")
        running.communicate()
    draft = ".live.polish-sim-part"
    assert found == {".mine.part", draft, f"{draft}/log.npz", ".next.polish-sim-part"}
    assert files(tmp_path) == {".mine.part", "next", "live", "live/log.npz"}


def test_a_long_stage_says_how_far_it_is_now_and_then(monkeypatch):
    said = []
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(progress.sys.stderr, "isatty", lambda: False, raising=False)
    with progress.ProgressObserver.shown(said.append, ()) as observer:
        observer.stage("plan the path")
        for second in range(50):
            now[0] = 100.0 + second
            observer.progress(second, 50.0)
    shares = "", ": 40%, about 30 s left", ": 80%, about 10 s left"
    assert said == [f"plan the path{share}" for share in shares]


def test_compiling_is_told_once_and_only_when_it_happens():
    @njit
    def double(x):
        return 2 * x

    said = []
    with compiling_shown(now_and_then(said.append)):
        assert double(3) == 6
        assert double(3.0) == 6.0
    assert said == [FIRST_START]
    with compiling_shown(now_and_then(said.append)):
        assert double(4) == 8
    assert said == [FIRST_START]
    progress.CompileProgress(said.append)._listen(["1/57", "2/57"])  # ahead
    assert said[1:] == ["1/57", "2/57"]


def test_the_process_that_compiles_ahead_ends_when_its_kernels_are_there_or_its_parent_is_gone():
    _counts, said = multiprocessing.Pipe(duplex=False)
    ahead = multiprocessing.Process(target=progress._rehearse, args=("hybrid-pi", said))
    ahead.start()
    ahead.join()
    assert ahead.exitcode == 0
    names = "import multiprocessing, os, time; from polish_sim.workers import end_with_starter as end"
    start = "multiprocessing.Process(target=lambda: (end(), time.sleep(60))).start(); os._exit(0)"
    subprocess.run([sys.executable, "-c", f"{names}; {start}"], stdout=-1, timeout=30, check=True)


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
    again = err.splitlines()[-1].partition("polish-sim ")[2].removesuffix(" resumes it")
    assert polish_sim(*shlex.split(again)).code == 0
    assert "1 of 1 passes done\n" in polish_sim(*shlex.split(again)).err
