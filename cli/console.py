"""The only module that talks: results on stdout, progress and errors on stderr."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polish_sim.page import PAGE, Table

if TYPE_CHECKING:
    from polish_sim.cli.live_view import FrameSink
    from polish_sim.cli.progress import ProgressObserver

PLAIN_WIDTH = 160  #: Width of tables when the output is not a terminal: wide enough not to wrap


def say(text: str) -> None:
    """Print a line of results on stdout, as it is."""
    print(text, flush=True)


def say_folder(folder: Path) -> None:
    """Print where results are, and the page that shows them."""
    if (folder / PAGE).exists():
        say(f"to look at in a browser: {folder / PAGE}")
    say(f"folder: {folder}")


def note(text: str) -> None:
    """Print a line about the work (what was assumed, a stage, a warning) on stderr."""
    print(text, file=sys.stderr, flush=True)


def notes(texts: Iterable[str]) -> None:
    """Print what a user should know of the work, a line each, on stderr."""
    for text in texts:
        note(f"note: {text}")


def fail(message: str, exit_code: int) -> int:
    """Print one error message on stderr and return the exit code to end with."""
    note(f"error: {message}")
    return exit_code


def close_broken_pipe() -> int:
    """Close a stdout whose reader has ended (`polish-sim list | head -1`), without a message at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 1


class _Terminal(io.FileIO):
    """A terminal that may be closed while a command runs: what is written then is lost, and the signal that
    comes with it ends the command."""

    def write(self, content: Any, /) -> int:
        """Write some bytes; how many."""
        with suppress(OSError):
            return super().write(content)
        return len(content)


def outlive_terminal() -> None:
    """Lose what is written to a terminal or stream that was closed, or cannot be in its encoding, instead of
    failing."""
    sys.stdout, sys.stderr = map(_outliving, (sys.stdout, sys.stderr))


def _outliving(stream: Any) -> Any:
    if stream is None:  # the next file that is opened must not take its place
        return open(os.devnull, "w", encoding="utf-8")
    stream.reconfigure(errors="backslashreplace")
    if sys.platform == "win32" or not stream.isatty():
        return stream
    raw = _Terminal(stream.fileno(), "w", closefd=False)
    return io.TextIOWrapper(io.BufferedWriter(raw), stream.encoding, stream.errors, line_buffering=True)


def table(shown: Table) -> None:
    """Print a table on stdout, with its caption below it."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else PLAIN_WIDTH
    Console(markup=False, highlight=False, emoji=False, width=width).print(shown.grid)
    if shown.caption:
        say(shown.caption)


def progress(sinks: Sequence[FrameSink] = ()) -> AbstractContextManager[ProgressObserver]:
    """Show the stages of a run and a bar on stderr while the block runs; plain lines when it is not a
    terminal.

    Yields the observer to hand to the run; ``sinks`` get its frames.
    """
    from polish_sim.cli.progress import ProgressObserver

    return ProgressObserver.shown(note, sinks)
