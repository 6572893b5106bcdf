"""Tasks shared out to processes that may die; each task's result as it comes.

One loky executor a worker: where a process is killed, its task alone is lost, and it is tried once more in another.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from polish_sim.errors import PolishSimError

TRIES: Final = 2  #: A task at which this many processes died is left out
MOST_DEATHS: Final = 4  #: Deaths in a row, without a result between them, after which all is given up


class Result(NamedTuple):
    """The end of a task, or of a process at work on it."""

    task: Any
    value: Any  #: What the work returned; None where a process died
    trouble: str | None  #: What went wrong, in one line


class CrewError(PolishSimError):
    """Processes die one after the other: the machine, not a task, is at fault."""


@dataclass
class _Worker:
    """One process, started with its first task."""

    executor: Any = None
    group: Hashable = None
    task: Any = None
    future: Future[Any] | None = None

    def start(self, work: Callable[[Any], Any], group: Hashable, task: Any) -> None:
        from joblib.externals.loky import ProcessPoolExecutor

        self.group, self.task = group, task
        with _interrupts_blocked():
            if self.executor is None:
                self.executor = ProcessPoolExecutor(1, timeout=None, initializer=_prepare, initargs=(os.getpid(),))
            self.future = self.executor.submit(work, task)

    def stop(self) -> None:
        if self.executor is not None:
            self.executor.shutdown(wait=True, kill_workers=True)
        self.executor = None


def work_off(
    tasks: Sequence[Any], work: Callable[[Any], Any], group_of: Callable[[Any], Hashable], workers: int
) -> Generator[Result]:
    """Do hashable tasks in so many worker processes; results come in the order they are done.

    One without a value comes whenever a process died. ``work`` is called with one task; tasks of the same ``group_of``
    are done by the same process where that costs no waiting.

    Raises:
        CrewError: If processes die one after the other.
        RuntimeError: If the work itself raised, with its traceback.
    """
    waiting: dict[Hashable, list[Any]] = {}
    for task in tasks:
        waiting.setdefault(group_of(task), []).append(task)
    begun: set[Hashable] = set()
    tries, deaths = dict.fromkeys(tasks, 0), 0
    crew = [_Worker() for _ in range(min(workers, len(tasks)))]
    try:
        while waiting or any(worker.future for worker in crew):
            for worker in crew:
                if waiting and worker.future is None:
                    worker.start(work, *_next_task(waiting, begun, worker.group))
            done, _ = wait([worker.future for worker in crew if worker.future], return_when=FIRST_COMPLETED)
            for worker in crew:
                future, task = worker.future, worker.task
                if future is None or future not in done:
                    continue
                worker.future, error = None, future.exception()
                if error is None:
                    deaths = 0
                    yield Result(task, future.result(), None)
                elif isinstance(error, BrokenExecutor):
                    worker.stop()
                    deaths, tries[task] = deaths + 1, tries[task] + 1
                    again = tries[task] < TRIES
                    if again:
                        waiting.setdefault(worker.group, []).append(task)
                    yield Result(task, None, _death(error, deaths, again))
                else:
                    raise RuntimeError(f"in {task}: {''.join(traceback.format_exception(error))}")
    finally:
        for worker in crew:
            worker.stop()


def _next_task(waiting: dict[Hashable, list[Any]], begun: set[Hashable], group: Hashable) -> tuple[Hashable, Any]:
    """A task of the worker's own group, else of one no other has begun, else of the longest."""
    if group not in waiting:
        fresh = [name for name in waiting if name not in begun]
        group = fresh[0] if fresh else max(waiting, key=lambda name: len(waiting[name]))
    begun.add(group)
    task = waiting[group].pop(0)
    if not waiting[group]:
        del waiting[group]
    return group, task


def _death(error: BaseException, deaths: int, again: bool) -> str:
    """A line on a process that died; CrewError if too many have in a row."""
    code = re.search(r"(?:SIG\w+|EXIT)\((-?\d+)\)", str(error))  # as loky writes exit codes
    number = int(code[1]) if code else 0
    cause = f"was killed (signal {-number})" if number < 0 else f"ended with code {number}"
    if deaths >= MOST_DEATHS:
        raise CrewError(
            f"{deaths} worker processes in a row died, the last one {cause}. Is there enough memory? Try --workers 1."
        )
    if again:
        return f"a worker process {cause}; its task is tried again"
    return f"a worker process {cause} for the second time at the same task; it is left out"


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Processes started in the block never hear Ctrl-C; this one hears it afterwards and decides for all."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing.resource_tracker import ensure_running

    ensure_running()  # started inside the block, it would lift it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _prepare(parent: int) -> None:
    """Set a process up: what a user's controller prints goes to stderr, and it ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdout = sys.stderr
    threading.Thread(target=_leave_with_parent, args=(parent,), daemon=True).start()


def _leave_with_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
