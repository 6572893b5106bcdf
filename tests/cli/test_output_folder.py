"""The error boundary, the output folder and progress: codes, messages, nothing half-written."""

import errno
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from numba import njit

from polish_sim.cli import progress
from polish_sim.cli.boundary import execute
from polish_sim.cli.output_folder import claimed
from polish_sim.cli.progress import FIRST_START, compiling_shown, now_and_then
from polish_sim.errors import InputError, ProtectiveStop

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
        (InputError(MESSAGE), 2),
        (ProtectiveStop(MESSAGE), 3),
        (KeyboardInterrupt(), 130),
        (OSError(errno.ENOSPC, "No space left on device"), 2),
        (OSError(errno.EROFS, "Read-only file system", "x"), 2),
        (OSError(errno.ENAMETOOLONG, "File name too long", "x"), 2),
    ],
)
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
    # Without --out files appear at the end.
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
    progress.CompileProgress(said.append)._listen(["1/57\n", "a line of something else\n", "2/57\n"])  # ahead
    assert said[1:] == ["1/57", "2/57"]


def test_the_process_that_compiles_ahead_ends_when_its_kernels_are_there_or_its_parent_is_gone():
    command = [sys.executable, "-m", "polish_sim.cli.progress", "hybrid-pi"]
    for gone in (False, True):
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
            if gone:
                process.stdin.close()
            assert process.wait() == gone
