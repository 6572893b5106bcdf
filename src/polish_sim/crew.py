"""Work shared out to processes that may die, each task's result as it comes (layer 0).

A pool of the standard library breaks as a whole when one of its processes is killed; here the one that died is named,
another takes its place, and its task is tried once more.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Final, NamedTuple

from polish_sim.errors import PolishSimError

TRIES: Final = 2
"""A task that has cost this many processes their lives is given up."""
MOST_DEATHS: Final = 4
"""Deaths in a row, without a result between them, after which the crew gives up."""


class Result(NamedTuple):
    """What became of a task."""

    task: Any
    value: Any
    """What the work returned; None where there is only trouble to tell."""
    trouble: str | None
    """What went wrong on the way, in one line."""


class CrewError(PolishSimError):
    """Processes die one after the other: the machine, not a task, is at fault."""


@dataclass
class _Worker:
    process: BaseProcess
    pipe: Connection
    task: Any = None
    group: Hashable = None


@dataclass
class _Queue:
    """Tasks by group: who has set a group up goes on with it."""

    groups: dict[Hashable, list[Any]] = field(default_factory=dict)
    taken: set[Hashable] = field(default_factory=set)

    def put(self, group: Hashable, task: Any) -> None:
        self.groups.setdefault(group, []).append(task)

    def next_for(self, group: Hashable) -> tuple[Hashable, Any] | None:
        """A task of the worker's own group, else of one nobody has begun, else of the longest."""
        if not self.groups:
            return None
        fresh = [name for name in self.groups if name not in self.taken]
        if group not in self.groups:
            group = fresh[0] if fresh else max(self.groups, key=lambda name: len(self.groups[name]))
        self.taken.add(group)
        task = self.groups[group].pop(0)
        if not self.groups[group]:
            del self.groups[group]
        return group, task


def work_off(
    tasks: Sequence[Any], work: Callable[[Any], Any], group_of: Callable[[Any], Hashable], workers: int
) -> Generator[Result]:
    """Do tasks in processes; results come in the order they are done.

    Args:
        tasks: What is to be done; hashable, and sent to another process.
        work: A function of a module, called with one task.
        group_of: Tasks of the same group are done by the same process where that costs no waiting.
        workers: Number of processes.

    Yields:
        One result per task, and one without a value whenever a process died.

    Raises:
        CrewError: If processes die one after the other.
        RuntimeError: If the work itself raised, with its traceback.
    """
    queue, tries, deaths = _Queue(), dict.fromkeys(tasks, 0), 0
    for task in tasks:
        queue.put(group_of(task), task)
    crew: list[_Worker] = []
    try:
        while queue.groups or any(worker.task is not None for worker in crew):
            wanted = min(workers, sum(len(group) for group in queue.groups.values()) + len(crew))
            crew += [_hire(work) for _ in range(wanted - len(crew))]
            for worker in crew:
                _hand_out(queue, worker)
            ready = wait([worker.pipe for worker in crew])
            for worker in [worker for worker in crew if worker.pipe in ready]:
                result = _collect(worker)
                if result is None:
                    crew.remove(worker)
                    deaths += 1
                    yield _bury(worker, queue, tries, deaths)
                else:
                    deaths = 0
                    yield result
    finally:
        _dismiss(crew)


def _hire(work: Callable[[Any], Any]) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, work), daemon=True)
    with _deaf_children():
        process.start()
    theirs.close()
    return _Worker(process, ours)


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Processes begun in the block never hear Ctrl-C, not even while they start up; this one hears it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _hand_out(queue: _Queue, worker: _Worker) -> None:
    if worker.task is not None:
        return
    following = queue.next_for(worker.group)
    if following is not None:
        worker.group, worker.task = following
        with suppress(OSError):  # a dead one is noticed when it is listened to
            worker.pipe.send(worker.task)


def _collect(worker: _Worker) -> Result | None:
    """The result a worker has sent, or None if it is dead."""
    try:
        value, error = worker.pipe.recv()
    except (EOFError, OSError):
        return None
    if error is not None:
        raise RuntimeError(f"in {worker.task}: {error}")
    task, worker.task = worker.task, None
    return Result(task, value, None)


def _bury(worker: _Worker, queue: _Queue, tries: dict[Any, int], deaths: int) -> Result:
    worker.process.join()
    code = worker.process.exitcode or 0
    cause = f"was killed (signal {-code})" if code < 0 else f"ended with code {code}"
    if deaths >= MOST_DEATHS:
        raise CrewError(
            f"{deaths} worker processes in a row died, the last one {cause}. Is there enough memory? Try --workers 1."
        )
    task = worker.task
    if task is None:
        return Result(None, None, f"a worker process {cause}; another takes its place")
    tries[task] += 1
    if tries[task] < TRIES:
        queue.put(worker.group, task)
        return Result(task, None, f"a worker process {cause}; its task is tried again")
    return Result(task, None, f"a worker process {cause} for the second time at the same task; it is left out")


def _dismiss(crew: list[_Worker]) -> None:
    for worker in crew:
        worker.process.terminate()
    for worker in crew:
        worker.process.join()
        worker.pipe.close()


def _serve(pipe: Connection, work: Callable[[Any], Any]) -> None:
    """Life of a worker: it ends when nobody listens any more. The parent alone hears Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    sys.stdout = sys.stderr  # what a user's controller prints is not part of the tables
    with suppress(EOFError, OSError):
        while True:
            task = pipe.recv()
            try:
                value, error = work(task), None
            except Exception as raised:
                value, error = None, "".join(traceback.format_exception(raised))
            pipe.send((value, error))


def _leave_with_parent() -> None:
    """End this process as soon as the one that hired it is gone, killed in the middle of a task or not."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
