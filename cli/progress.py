"""What a terminal shows while a command works: its stage, how far it is, the kernels being compiled."""

from __future__ import annotations

import gc
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy
from matplotlib.artist import ArtistInspector
from rich.console import Console
from rich.progress import Progress, TimeElapsedColumn

from polish_sim.config import Scenario
from polish_sim.errors import duration_text
from polish_sim.experiments.registry import default_scenario, run_experiment
from polish_sim.kernel_cache import event, is_warm, kernels_under, load_registries
from polish_sim.scenario_file import merge
from polish_sim.workers import end_with_starter, processors

if TYPE_CHECKING:
    from polish_sim.cli.live_view import FrameSink

# As they are imported, matplotlib lists the settings of each class in docstrings, scipy completes those of
# its functions, and imports all there is of numpy: 0.3 s that no command needs.
ArtistInspector.get_setters = lambda *_: []  # type: ignore[assignment, method-assign]
ArtistInspector.get_aliases = lambda *_: {}  # type: ignore[assignment, method-assign]
with suppress(ImportError, AttributeError):
    unused = {"f2py", "testing"}
    numpy.__all__ = list({*numpy.__all__} - unused)
    numpy.__numpy_submodules__.difference_update(unused)
    from scipy._lib import _array_api

    _array_api.xp_capabilities = lambda *_, **__: lambda function: function
    _array_api.FunctionDoc._parse = lambda *_, **__: None
FIRST_START = "compiling kernels: at the first start only, they are kept"
REHEARSED = ("arc", "force", "surface")  #: Simulations compiled ahead: with the types of the arc's
LINE_S = 10.0  #: Least time between two lines where no bar can be shown [s]


class CompileProgress(event.Listener):  # type: ignore[misc]
    """Counts the kernels that this process and the one ahead of it compile.

    ``show`` is called with "12/57", kernels compiled and known to be needed, whenever either changes.
    """

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show = show
        self._process = os.getpid()
        self._depth = 0
        self._needed: dict[Any, None] = {}
        self._ahead = (0, 0)

    def on_start(self, event: Any) -> None:
        """A kernel that is not in the cache: it and all it calls are needed."""
        if self._depth == 0:
            self._needed |= dict.fromkeys(kernels_under(event.data["dispatcher"]))
        self._depth += 1
        self._update()

    def on_end(self, _: Any) -> None:
        """It is compiled."""
        self._depth -= 1
        self._update()

    def count(self) -> tuple[int, int]:
        """Kernels compiled and kernels needed, here and ahead."""
        done = sum(bool(kernel.overloads) for kernel in self._needed)
        return done + self._ahead[0], len(self._needed) + self._ahead[1]

    def _update(self) -> None:
        if self._process == os.getpid():  # not in a copy, which counts by itself
            done, needed = self.count()
            self._show(f"{done}/{needed}")

    @contextmanager
    def ahead(self, scenario: Scenario) -> Iterator[None]:
        """Compile the kernels of a scenario in another process while the block runs, if there is need and
        room."""
        if scenario.experiment not in REHEARSED or is_warm() or processors() < 2:
            yield
            return
        # On Linux a copy of this process, with all that it has imported.
        load_registries()
        context: Any = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
        counts, said = context.Pipe(duplex=False)
        process = context.Process(target=_rehearse, args=(scenario.controller.name, said))
        process.start()
        said.close()
        lines = iter(counts.recv, "")
        reader = threading.Thread(target=self._listen, args=(lines,), daemon=True)
        reader.start()
        try:
            yield
        finally:
            process.kill()
            process.join()
            reader.join()

    def _listen(self, lines: Iterable[str]) -> None:
        with suppress(EOFError):
            for line in lines:
                done, needed = map(int, line.split("/"))
                self._ahead = done, needed
                self._update()


def compiling_shown(show: Callable[[str], None]) -> Any:
    """Show how far compiling is while the block runs, a `CompileProgress`; nothing when all kernels come from
    the cache."""
    return event.install_listener("numba:compile", CompileProgress(show))


def now_and_then(say: Callable[[str], None]) -> Callable[[str], None]:
    """A line for the first kernel, then one in a while."""
    latest = -LINE_S

    def show(count: str) -> None:
        nonlocal latest
        if time.monotonic() - latest >= LINE_S:
            say(FIRST_START if latest < 0.0 else f"compiling kernels {count}")
            latest = time.monotonic()

    return show


def _rehearse(controller: str, said: Any) -> None:
    """Begin a run in free space, for its kernels, whose counts are ``said``; ends when the process that began
    it does."""
    from polish_sim.cell import Silent
    from polish_sim.control import CONTROLLERS

    class Begun(Silent):
        def progress(self, done: float, total: float) -> None:
            os._exit(0)  # it simulates, so its kernels are compiled

    gc.disable()  # it ends soon, by `_exit`
    end_with_starter()
    sys.stdout = sys.stderr = open(os.devnull, "w")  # noqa: SIM115  (until it ends)
    with compiling_shown(said.send):
        # a user's own stays here
        chosen = {"controller": {"name": controller}} if controller in CONTROLLERS else {}
        run_experiment(merge(default_scenario("arc"), chosen, ""), None, Begun())


# The observer that turns a run's stages into a progress bar; it satisfies the protocol of the experiments.


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
        self.frame_every_s = min([IDLE_FRAME_S, *(sink.frame_every_s for sink in sinks)])
        self._task = bar.add_task("starting", total=None)
        self.compiling: CompileProgress
        self.cell: Any = None  #: The last that was about to run
        self.model: Any = None  #: Of the cell, once it runs

    @classmethod
    @contextmanager
    def shown(cls, say: Callable[[str], None], sinks: Sequence[FrameSink]) -> Iterator[ProgressObserver]:
        """Show a bar while the block runs; on a pipe or in a file each stage is one plain line instead."""
        terminal = sys.stderr.isatty()
        columns = (*Progress.get_default_columns(), TimeElapsedColumn())
        console = Console(stderr=True)
        with Progress(
            *columns, console=console, transient=True, get_time=time.monotonic, disable=not terminal
        ) as bar:
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
        self._bar.update(self._task, description=self._stage, completed=done, total=total)
        if self._quiet_s is not None and time.monotonic() - self._told_at >= self._quiet_s and total > 0.0:
            self._told_at = time.monotonic()
            left = self._bar.tasks[0].time_remaining
            about = f", about {duration_text(left)} left" if left else ""
            self._say(f"{self._stage}: {done / total:.0%}{about}")

    def start(self, cell: Any) -> None:
        """Show the cell that is about to run to those who want to see it."""
        self.cell = cell
        for sink in self._sinks:
            sink.start(cell)

    def frame(self, model: Any, data: Any) -> None:
        """Hand a moment of the simulation on to those who want to see it."""
        self.model = model
        for sink in self._sinks:
            sink.frame(model, data)
