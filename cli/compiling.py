"""Progress of compiling kernels, and a second process that compiles the simulation's kernels while a path is
planned.

A first start compiles about a hundred kernels. Where there are two processors, another process runs a short
simulation as soon as the command begins: what it compiles is in the cache when the command comes to simulate.
Neither compiles what the other is compiling (kernel_cache.py), and what a killed process leaves undone the
other one does.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from polish_sim.config import Scenario
from polish_sim.kernel_cache import event, is_warm, kernels_under
from polish_sim.workers import processors

FIRST_START = "compiling kernels: at the first start only, they are kept"
REHEARSED = ("arc", "force", "surface")  #: Simulations compiled ahead: with the types of the arc's
QUIET_S = 10.0  #: Least time between two lines where no bar can be shown [s]


class CompileProgress(event.Listener):  # type: ignore[misc]
    """Counts the kernels that this process and the one ahead of it compile.

    ``show`` is called with "12/57", kernels compiled and known to be needed, whenever either changes.
    """

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show = show
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
        done, needed = self.count()
        self._show(f"{done}/{needed}")

    @contextmanager
    def ahead(self, scenario: Scenario) -> Iterator[None]:
        """Compile the kernels of a scenario in another process while the block runs, if there is need and
        room."""
        if scenario.experiment not in REHEARSED or is_warm() or processors() < 2:
            yield
            return
        command = [sys.executable, "-m", __name__, scenario.controller.name]
        pipe = subprocess.PIPE
        with subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True
        ) as process:
            reader = threading.Thread(target=self._listen, args=(process.stdout,), daemon=True)
            reader.start()
            try:
                yield
            finally:
                process.kill()
                reader.join()

    def _listen(self, lines: Any) -> None:
        for line in lines:
            with suppress(ValueError):
                done, needed = map(int, line.split("/"))
                self._ahead = done, needed
                self._update()


@contextmanager
def compiling_shown(show: Callable[[str], None]) -> Iterator[CompileProgress]:
    """Show how far compiling is while the block runs; nothing when all kernels come from the cache."""
    progress = CompileProgress(show)
    with event.install_listener("numba:compile", progress):
        yield progress


def now_and_then(say: Callable[[str], None]) -> Callable[[str], None]:
    """A line for the first kernel, then one in a while."""
    latest = -QUIET_S

    def show(count: str) -> None:
        nonlocal latest
        if time.monotonic() - latest >= QUIET_S:
            say(FIRST_START if latest < 0.0 else f"compiling kernels {count}")
            latest = time.monotonic()

    return show


def _rehearse(controller: str) -> None:
    """Begin a run in free space, for its kernels; ends when the process that began it does."""
    from polish_sim.cell import Silent
    from polish_sim.control import CONTROLLERS
    from polish_sim.experiments.registry import default_scenario, run_experiment
    from polish_sim.scenario_file import merge

    class Begun(Silent):
        def progress(self, done: float, total: float) -> None:
            os._exit(0)  # it simulates, so its kernels are compiled

    threading.Thread(target=_end_with_parent, daemon=True).start()
    with compiling_shown(lambda count: print(count, flush=True)):
        # a user's own stays here
        chosen = {"controller": {"name": controller}} if controller in CONTROLLERS else {}
        run_experiment(merge(default_scenario("arc"), chosen, ""), None, Begun())


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    _rehearse(sys.argv[1])
