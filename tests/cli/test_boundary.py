"""Whatever a command raises ends in one message and the exit code of the contract."""

from __future__ import annotations

import errno

import pytest
import typer

from polish_sim.cli.boundary import execute
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


def test_an_unexpected_error_is_called_a_bug_without_a_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(app_that(ZeroDivisionError("by zero")), ["work"]) == 70
    message = capsys.readouterr().err
    assert "bug" in message
    assert "ZeroDivisionError: by zero" in message
    assert "--debug" in message
    assert "Traceback" not in message


def test_debug_shows_where_an_unexpected_error_comes_from(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(app_that(ZeroDivisionError("by zero")), ["--debug", "work"]) == 70
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(("returned", "code"), [(None, 0), (0, 0), (1, 1), (130, 130)])
def test_a_command_s_own_code_is_kept(returned: int | None, code: int) -> None:
    assert execute(app_that(None, returned), ["work"]) == code
