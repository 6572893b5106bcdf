"""The observer that turns a run's stages into a progress bar; it satisfies the protocol of the
experiments."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from polish_sim.cli.compiling import CompileProgress, compiling_shown, now_and_then
from polish_sim.cli.pictures import FrameSink

QUIET_S = 20.0  #: How long a stage may be quiet where no bar can be shown [s]
IDLE_FRAME_S = 0.5  #: Simulated time between looks at the run when no frames are asked for [s]


class ProgressObserver:
    """Shows the current stage and how far it is; each stage leaves one line behind."""

    def __init__(
        self,
        bar: Progress,
        say: Callable[[str], None],
        sinks: Sequence[FrameSink],
        quiet_s: float | None = None,
    ) -> None:
        self._bar = bar
        self._quiet_s = quiet_s
        self._stage = ""
        self._told_at = 0.0
        self._say = say
        self._sinks = sinks
        self.frame_every_s = min([IDLE_FRAME_S, *(sink.every_s for sink in sinks)])
        self._task = bar.add_task("starting", total=None)
        self.compiling: CompileProgress

    @classmethod
    @contextmanager
    def shown(cls, say: Callable[[str], None], sinks: Sequence[FrameSink]) -> Iterator[ProgressObserver]:
        """Show a bar while the block runs; on a pipe or in a file each stage is one plain line instead."""
        console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=32),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        terminal = sys.stderr.isatty()
        with Progress(*columns, console=console, transient=True, disable=not terminal) as bar:
            shown = bar.console.print if terminal else say
            observer = cls(bar, shown, sinks, None if terminal else QUIET_S)
            with compiling_shown(observer.compiled if terminal else now_and_then(say)) as observer.compiling:
                yield observer

    def stage(self, text: str) -> None:
        """Begin a stage: its bar starts anew."""
        self._say(text)
        self._stage = text
        self._told_at = time.monotonic()
        self._bar.reset(self._task, total=None, description=text)
        for sink in self._sinks:
            sink.stage(text)

    def compiled(self, count: str) -> None:
        """Say how many kernels are compiled, in the stage's line."""
        self._bar.update(self._task, description=f"{self._stage}: compiling kernels {count}")

    def progress(self, done: float, total: float) -> None:
        """Say how far the stage is, in any unit; where no bar can be shown, in a line now and then."""
        if self._quiet_s is not None and time.monotonic() - self._told_at >= self._quiet_s and total > 0.0:
            self._told_at = time.monotonic()
            self._say(f"{self._stage}: {done / total:.0%}")
        self._bar.update(self._task, description=self._stage, completed=done, total=total)

    def start(self, cell: Any) -> None:
        """Show the cell that is about to run to those who want to see it."""
        for sink in self._sinks:
            sink.start(cell)

    def frame(self, model: Any, data: Any) -> None:
        """Hand a moment of the simulation on to those who want to see it."""
        for sink in self._sinks:
            sink.take(model, data)
