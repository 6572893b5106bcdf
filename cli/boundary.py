"""How a command ends: what it found, and the one place where errors become a message and an exit code.

No command catches them itself.
"""

from __future__ import annotations

import _thread
import ctypes
import gc
import os
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import typer

from polish_sim.analysis.claim import Claim, figure_table, shortfalls
from polish_sim.cli import console
from polish_sim.cli.pictures import prepare_headless
from polish_sim.errors import PolishSimError
from polish_sim.page import Table
from polish_sim.row_file import Metrics

DONE, SHORT, USAGE, STOPPED, BUG, INTERRUPTED = 0, 1, 2, 3, 70, 130
NOTHING_RECORDED = "interrupted; nothing was recorded yet."


def execute(commands: typer.Typer, arguments: Sequence[str]) -> int:
    """Run one command line, the words behind `polish-sim`.

    Returns the exit code: 0 done, 1 a figure falls short, 2 bad input or usage, 3 protective stop, 130
    interrupted, 70 an error of ours.
    """
    prepare_headless()
    _keep_memory()
    # Reference cycles are few here: looking for them among all that is imported costs 0.4 s of a start.
    gc.set_threshold(500_000)
    # More threads would mostly wait for each other: the systems solved here are small.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What a killed command leaves of its processes is cleaned up without a word.
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker")

    def invoke() -> Any:
        command = typer.main.get_command(commands)
        with command.make_context("polish-sim", list(arguments) or ["--help"]) as context:
            return command.invoke(context)

    return exit_code(invoke, "--debug" in arguments)


def exit_code(work: Callable[[], Any], debug: bool = False) -> int:
    """Do some work; what it returns, or the code of the message that its error becomes."""
    swallowed: list[object] = []
    try:
        with _interrupts_kept(swallowed):
            outcome = work()
    except typer.Exit as end:
        return end.exit_code
    except PolishSimError as error:
        return console.fail(str(error), error.exit_code)
    except typer.TyperException as error:
        return console.fail(_usage_message(error), USAGE)
    except (KeyboardInterrupt, typer.Abort) as error:
        return console.fail(str(error) or NOTHING_RECORDED, INTERRUPTED)
    except BrokenPipeError:
        return console.close_broken_pipe()
    except Exception as error:
        if swallowed or _is_interrupt(error):
            return console.fail(NOTHING_RECORDED, INTERRUPTED)
        if isinstance(error, OSError) and error.errno:  # no room, no permission, gone, too long a name ...
            file = error.filename2 or error.filename
            where = f" '{file}'" if file else ""
            return console.fail(
                f"cannot read or write{where}: {error.strerror}. Make room, change who may use it, or write "
                "elsewhere.",
                USAGE,
            )
        return console.fail(_bug_message(error, debug), BUG)
    return outcome if isinstance(outcome, int) else DONE


@contextmanager
def _interrupts_kept(swallowed: list[object]) -> Iterator[None]:
    """Collect interrupts that arrive where C calls Python, as while kernels are compiled: Python drops them
    there.

    Mostly what was called continues as if nothing had happened: a moment later each is raised again.
    """
    before = sys.unraisablehook
    again: list[threading.Timer] = []

    def hook(lost: sys.UnraisableHookArgs) -> None:
        if issubclass(lost.exc_type, KeyboardInterrupt):
            swallowed.append(lost.exc_type)
            again.append(threading.Timer(0.05, _thread.interrupt_main))
            again[-1].start()
        else:
            before(lost)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before
        for timer in again:
            timer.cancel()


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C is what an error comes from.

    A C++ module interrupted while it is loaded raises an `ImportError` with its cause, a call of a C function
    one of ctypes that only names it.
    """
    if isinstance(error, ctypes.ArgumentError) and KeyboardInterrupt.__name__ in str(error):
        return True
    seen: list[BaseException] = []
    while error is not None and error not in seen:
        seen.append(error)
        error = error.__cause__ or error.__context__
    return any(isinstance(cause, KeyboardInterrupt) for cause in seen)


def _keep_memory() -> None:
    """Let the C library keep freed memory for the next array: handing it back and forth takes a fine part a
    third of its time. Only glibc can be asked to.
    """
    mmap_threshold, trim_threshold = -3, -1  # M_MMAP_THRESHOLD and M_TRIM_THRESHOLD of malloc.h
    with suppress(OSError, AttributeError):
        c = ctypes.CDLL(None)
        c.gnu_get_libc_version  # noqa: B018  (other libraries give these numbers other meanings)
        c.mallopt(mmap_threshold, 8 << 20)
        c.mallopt(trim_threshold, 2**31 - 1)


def _usage_message(error: typer.TyperException) -> str:
    """One line: what is wrong, the names that would be right, where to read on."""
    message = error.format_message().rstrip(".").replace("\n", " ")
    context = getattr(error, "ctx", None)
    if context is None:
        return f"{message}. See 'polish-sim --help'."
    message += "" if message.endswith("?") else "."
    known = getattr(context.command, "commands", None)
    names = f" Known: {', '.join(sorted(known))}." if known else ""
    return f"{message}{names} See '{context.command_path} --help'."


def _bug_message(error: Exception, debug: bool) -> str:
    if debug:
        return "".join(traceback.format_exception(error))
    where = traceback.extract_tb(error.__traceback__)[-1]
    return (
        f"this is a bug in polish-sim: {type(error).__name__}: {error} "
        f"({where.filename.rsplit('/', 1)[-1]}:{where.lineno}). "
        "Run 'polish-sim --debug ...' to see where it comes from, and please report it."
    )


# What a command found: its figures beside the paper's and what is asked, and the exit code of the contract.


@dataclass(frozen=True)
class Outcome:
    """One run or calibration, or several seeds of one: the figures that count."""

    claims: Sequence[Claim]  #: The figures to show and what is asked of them
    title: str
    #: Of figures to show, by heading; the last one is what is checked
    columns: Mapping[str, Metrics]
    stops: tuple[str, ...] = ()  #: Protective stops, each with its reason
    interrupted: bool = False
    #: How to draw the pictures that are missing because of an interrupt after all was measured
    undrawn: str = ""
    notes: Sequence[str] = ()  #: To print above the table
    bad: tuple[str, ...] = ()  #: What is bad about it though it went to its end, in sentences
    conditions: tuple[str, ...] = ()
    """Conditions that differ from those the figures are asked for; nothing is called met or not met then."""

    def finish(self, folder: Path, check: bool | None) -> int:
        """Show the outcome and the folder; returns the exit code, falling short counts with ``check``."""
        # What is checked is called met or not, whatever the conditions.
        with suppress(KeyboardInterrupt):  # all is written
            (replace(self, conditions=()) if check else self).show()
        console.say_folder(folder)
        return self.exit_code(check)

    def show(self) -> None:
        """Print why the run ended early, if it did, and the table of figures."""
        if self.interrupted:
            console.note("interrupted: what was recorded up to now is kept.")
        if self.undrawn:
            console.note(
                "interrupted while drawing: the simulation, its log and figures are whole and kept, but "
                f"pictures are missing. {self.undrawn}"
            )
        for reason in self.stops:
            end = "" if reason.endswith("?") else "."
            console.note(f"error: protective stop: {reason}{end} The log is kept, stop included.")
        console.notes(self.notes)
        for text in self.bad:
            console.note(f"bad: {text}.")
        console.table(self.table._replace(title=self.title + ": with bad figures" * bool(self.bad)))

    def exit_code(self, check: bool | None) -> int:
        """The code to end with; falling short counts only when it was asked to ``check``."""
        if self.interrupted or self.undrawn:
            return INTERRUPTED
        if self.stops:
            return STOPPED
        return (
            SHORT if check and (self.bad or shortfalls(self.claims, [*self.columns.values()][-1])) else DONE
        )

    @property
    def table(self) -> Table:
        """The figures."""
        return figure_table(self.claims, self.columns, conditions=self.conditions)
