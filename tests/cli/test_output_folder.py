"""The error boundary and the output folder: codes, messages, nothing half-written."""

from __future__ import annotations

import errno
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from polish_sim.cli.boundary import execute
from polish_sim.cli.output_folder import claimed
from polish_sim.errors import InputError, ProtectiveStop

MESSAGE = "the part 'x.stl' is empty"


def app_that(raises: BaseException | None, returns: int | None = None) -> typer.Typer:
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
        (typer.Abort(), 130),
        (OSError(errno.ENOSPC, "No space left on device"), 2),
    ],
)
def test_an_error_is_one_line_on_stderr_with_its_code(
    error: BaseException, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(app_that(error), ["work"]) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("error: ")
    assert shown.err.count("\n") == 1


def test_an_unexpected_error_is_called_a_bug_and_debug_shows_where_it_comes_from(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert execute(app_that(ZeroDivisionError("by zero")), ["work"]) == 70
    message = capsys.readouterr().err
    assert all(word in message for word in ("bug", "ZeroDivisionError: by zero", "--debug"))
    assert "Traceback" not in message
    assert execute(app_that(ZeroDivisionError("by zero")), ["--debug", "work"]) == 70
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(("returned", "code"), [(None, 0), (0, 0), (1, 1), (130, 130)])
def test_a_command_s_own_code_is_kept(returned: int | None, code: int) -> None:
    assert execute(app_that(None, returned), ["work"]) == code


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def asked(out: Path | None, overwrite: bool = False) -> dict[str, object]:
    return {"--out": out, "--overwrite": overwrite}


def test_a_run_without_out_gets_a_new_dated_folder_whose_files_appear_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    finals = set()
    for _ in range(3):
        with claimed(asked(None), "run-force") as folder:
            (folder.draft / "log.npz").touch()
            assert not folder.final.exists()
        assert folder.final.parent == Path("results/run-force")
        assert files(folder.final) == {"log.npz"}
        finals.add(folder.final)
    assert len(finals) == 3


def test_an_existing_folder_is_refused_before_the_block_runs(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="--overwrite"), claimed(asked(tmp_path / "out"), "run-force"):
        pytest.fail("the work must not start")
    assert files(tmp_path) == {"out"}


def test_overwrite_replaces_files_of_the_same_name_and_keeps_the_others(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "metrics.json").write_text("old")
    (out / "notes.txt").write_text("mine")
    with claimed(asked(out, overwrite=True), "run-force") as folder:
        (folder.draft / "metrics.json").write_text("new")
    assert (out / "metrics.json").read_text() == "new"
    assert (out / "notes.txt").read_text() == "mine"
    assert files(tmp_path) == {"out", "out/metrics.json", "out/notes.txt"}


def fail_halfway(out: Path, error: type[BaseException]) -> None:
    with claimed(asked(out, overwrite=True), "run-force") as folder:
        (folder.draft / "metrics.json").write_text("new")
        raise error


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_failure_leaves_an_existing_folder_as_it_was_and_of_a_new_one_nothing(
    tmp_path: Path, error: type[BaseException]
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "metrics.json").write_text("old")
    for out in (tmp_path / "out", tmp_path / "a" / "b" / "out"):
        with pytest.raises(error):
            fail_halfway(out, error)
    assert (tmp_path / "out" / "metrics.json").read_text() == "old"
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


def test_drafts_of_killed_commands_are_swept_at_the_next_start_those_of_running_ones_stay(
    tmp_path: Path,
) -> None:
    (tmp_path / ".mine.part").mkdir()
    program = [sys.executable, "-c", KILLED]
    for number in range(3):
        assert (
            subprocess.run([*program, str(tmp_path / str(number)), "die"], check=False).returncode
            == -signal.SIGKILL
        )
    pipe = subprocess.PIPE
    with subprocess.Popen([*program, str(tmp_path / "live"), "wait"], stdin=pipe, stdout=pipe) as running:
        assert running.stdout is not None
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


def test_a_file_in_the_way_or_a_place_that_cannot_be_written_is_refused_before_the_block_runs(
    tmp_path: Path,
) -> None:
    (tmp_path / "taken").touch()
    # /proc takes no folders, whoever asks; a read-only folder would stop everybody but root.
    for out, said in (("taken", "taken"), ("taken/out", "taken"), ("/proc/polish/out", "--out")):
        with (
            pytest.raises(InputError, match=said),
            claimed(asked(tmp_path / out, overwrite=True), "run-force"),
        ):
            pytest.fail("the work must not start")
