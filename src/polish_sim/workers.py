"""Tasks shared out to other processes, here or on a cluster; each task's result as it comes.

``local`` gives every worker a loky executor of its own: where a process is killed, its task alone is lost,
and it is tried once more. ``dask`` starts a cluster of Dask on this machine, ``tcp://`` and ``tls://`` use
one that runs.
"""

from __future__ import annotations

import getpass
import logging
import multiprocessing
import os
import re
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import closing, contextmanager, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import cache, partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple, Protocol

from polish_sim.errors import InputError, PolishSimError, did_you_mean, needed
from polish_sim.row_file import Row, Rows
from polish_sim.source_stamp import package_hash, short_hash

TRIES = 2  #: A task at which this many processes died is left out
MOST_DEATHS = 4  #: Deaths in a row, without a result between them, after which all is given up
AHEAD = 2  #: Tasks a process is given: it does not wait for the way here and back
JOIN_S = 20.0  #: How long a scheduler is waited for, a worker of it, and a result that is done [s]
GONE_S = 60.0  #: How long a cluster that has lost all its workers is waited for [s]
ENGINES = ("local", "dask", "tcp://HOST:PORT", "tls://HOST:PORT")

Work = Callable[[Any], Any]
GroupOf = Callable[[Any], Hashable]
Heard = Callable[[int, int, str | None], None]  #: Called with tasks done, all of them, and a trouble, if any


class Result(NamedTuple):
    """The end of a task, or of a process at work on it."""

    task: Any
    value: Any  #: What the work returned; None where a process died
    trouble: str | None  #: What went wrong, in one line
    again: bool = False  #: Whether the task is then tried again, or else left out


class WorkersError(PolishSimError):
    """Processes die one after the other, or the cluster is gone: the machine, not a task, is at fault."""


class Workers(Protocol):
    """Processes that do tasks; `open_workers` starts and stops them."""

    count: int  #: Processes, or threads of a cluster, at the start
    where: str  #: For people

    def results(self, tasks: Sequence[Any], work: Work, group_of: GroupOf) -> Generator[Result]:
        """Do hashable tasks; results come in the order they are done, one without a value where a process
        died.

        ``work`` is called with one task; tasks of the same ``group_of`` are done by the same process where
        that costs no waiting.

        Raises:
            WorkersError: If processes die one after the other, or the cluster or all its workers are gone.
            PolishSimError: What the work itself raised.
            RuntimeError: If it raised anything else, with its traceback.
        """
        ...


@contextmanager
def open_workers(
    on: str = "local", count: int | None = None, files: Sequence[Path] = ()
) -> Iterator[Workers]:
    """Start ``count`` processes (by default one a processor) on an engine of `ENGINES`; they end with the
    block.

    ``files`` of the user's are shipped to other machines, by content; `local_copy` finds them there.

    Raises:
        InputError: If there is no such engine, or its versions are not those here.
    """
    count = count or processors()
    if engine(on) == "here":
        yield Here()
    elif on == "local":
        local = _Local(count)
        try:
            yield local
        finally:
            local.stop()
    else:
        shipped = {str(file): file.read_bytes() for file in files}
        with _client(on, count) as client:
            yield _Cluster(client, shipped, f"{count} processes" if on == "dask" else on)


def engine(on: str) -> str:
    """The same, if it is an engine.

    Raises:
        InputError: It is none; lists them.
    """
    if on not in ("here", *ENGINES[:2]) and not re.fullmatch(r"(tcp|tls)://\S+:\d+", on):
        raise InputError(f"unknown engine '{on}'.{did_you_mean(on, ENGINES)} Known: {', '.join(ENGINES)}.")
    return on


def processors() -> int:
    """How many processors this process may use."""
    from joblib import cpu_count  # slow to import

    return int(cpu_count())


class Runner:
    """Rows of a folder, found there from before or done by workers, whatever these are and their number."""

    interrupted = False  #: Whether Ctrl-C left rows out
    lost = 0  #: Tasks given up because their processes died

    def __init__(self, kept: Rows, workers: Workers, heard: Heard = lambda *_: None) -> None:
        self.kept, self.heard, self._workers = kept, heard, workers

    def fill(
        self,
        keys: Mapping[Any, str],
        work: Work,
        group_of: GroupOf = lambda _: 0,
        lost: Callable[[Any, str], Row] | None = None,
        heard: Heard | None = None,
    ) -> dict[Any, Any]:
        """What is kept of tasks, named with the ``keys`` of their rows, those that are missing done by
        ``work``.

        A task whose process dies again and again has no row, or the one that ``lost`` makes of it and the
        trouble. Ctrl-C leaves out what is not done; before anything is, it is raised.
        """
        heard = heard or self.heard
        tasks, total = self.kept.missing(keys), len(keys)
        done = total - len(tasks)
        heard(done, total, None)
        try:
            with closing(self._workers.results(tasks, work, group_of)) as results:
                for task, row, trouble, again in results:
                    done += row is not None
                    if trouble is not None:
                        if not again:
                            self.lost += 1
                            row = lost and lost(task, trouble)
                        trouble += f"; its task is {'tried again' if again else 'left out'} ({task})"
                    if row is not None:
                        self.kept.add(keys[task], row)
                    heard(done, total, trouble)
        except KeyboardInterrupt:
            if not done:
                raise
            self.interrupted = True
        known = self.kept.known
        return {task: known[key] for task, key in keys.items() if key in known}


class Here:
    """Tasks done in this process, one after the other: for those that take less time than to start
    another."""

    count, where = 1, "this process"

    def results(self, tasks: Sequence[Any], work: Work, _group_of: GroupOf) -> Generator[Result]:
        """As of `Workers`."""
        for task in tasks:
            yield Result(task, work(task), None)


# Processes of this machine.


@dataclass
class _Worker:
    """One process, started with its first task."""

    executor: Any = None
    group: Hashable = None
    tasks: deque[tuple[Any, Future[Any]]] = field(default_factory=deque)  #: At work on the first

    def start(self, work: Work, group: Hashable, task: Any) -> None:
        from joblib.externals.loky import ProcessPoolExecutor

        self.group = group
        with _interrupts_blocked():
            if self.executor is None:
                # More threads would mostly wait for each other: the systems solved here are small.
                self.executor = ProcessPoolExecutor(
                    1,
                    timeout=None,
                    initializer=_prepare,
                    env={"OPENBLAS_NUM_THREADS": "1"},
                )
            self.tasks.append((task, self.executor.submit(work, task)))

    def stop(self) -> None:
        if self.executor is not None:
            self.executor.shutdown(wait=True, kill_workers=True)
        self.executor = None
        self.tasks.clear()


@dataclass
class _Waiting:
    """Tasks by group; a group that is begun stays with its process while there are others."""

    groups: dict[Hashable, deque[Any]] = field(default_factory=dict)
    begun: set[Hashable] = field(default_factory=set)

    def add(self, group: Hashable, task: Any) -> None:
        self.groups.setdefault(group, deque()).append(task)

    def take(self, group: Hashable) -> tuple[Hashable, Any]:
        """A task of the worker's own group, else of one no other has begun, else of the longest."""
        if group not in self.groups:
            fresh = next((name for name in self.groups if name not in self.begun), None)
            group = fresh if fresh is not None else max(self.groups, key=lambda name: len(self.groups[name]))
        self.begun.add(group)
        task = self.groups[group].popleft()
        if not self.groups[group]:
            del self.groups[group]
        return group, task

    def __len__(self) -> int:
        return sum(map(len, self.groups.values()))


class _Local:
    def __init__(self, count: int) -> None:
        self.count = count
        self.where = "one process" if count == 1 else f"{count} processes"
        self._crew = [_Worker() for _ in range(count)]

    def results(self, tasks: Sequence[Any], work: Work, group_of: GroupOf) -> Generator[Result]:
        waiting = _Waiting()
        for task in tasks:
            waiting.add(group_of(task), task)
        tries = dict.fromkeys(tasks, 0)
        deaths = 0
        try:
            while waiting or any(worker.tasks for worker in self._crew):
                for ahead in range(AHEAD):
                    for worker in self._crew:
                        if len(worker.tasks) == ahead and len(waiting) > ahead * self.count:
                            worker.start(work, *waiting.take(worker.group))
                wait(
                    [worker.tasks[0][1] for worker in self._crew if worker.tasks], return_when=FIRST_COMPLETED
                )
                for worker in self._crew:
                    if not worker.tasks or not worker.tasks[0][1].done():
                        continue
                    task, future = worker.tasks.popleft()
                    error = future.exception()
                    if error is None:
                        deaths = 0
                        yield Result(task, future.result(), None)
                    elif isinstance(error, BrokenExecutor):
                        for innocent, _ in worker.tasks:
                            waiting.add(worker.group, innocent)
                        worker.stop()
                        deaths, tries[task] = deaths + 1, tries[task] + 1
                        again = tries[task] < TRIES
                        if again:
                            waiting.add(worker.group, task)
                        yield Result(task, None, _death(error, deaths), again)
                    else:
                        raise _in_task(task, error)
        finally:  # what is still at work at an interrupt
            for worker in self._crew:
                if worker.tasks:
                    worker.stop()

    def stop(self) -> None:
        for worker in self._crew:
            worker.stop()


def _in_task(task: Any, error: BaseException) -> BaseException:
    """What to raise for an error in a task: that of input or disk itself, others with their traceback."""
    if isinstance(error, (PolishSimError, OSError)):
        return error
    return RuntimeError(f"in {task}: {''.join(traceback.format_exception(error))}")


def _death(error: BaseException, deaths: int) -> str:
    """A line on a process that died; WorkersError if too many have in a row."""
    code = re.search(r"(?:SIG\w+|EXIT)\((-?\d+)\)", str(error))  # as loky writes exit codes
    number = int(code[1]) if code else 0
    cause = f"was killed (signal {-number})" if number < 0 else f"ended with code {number}"
    if not code:
        cause = f"failed ({' '.join(str(error.__cause__ or error).split())[-200:]})"
    if deaths >= MOST_DEATHS:
        raise WorkersError(
            f"{deaths} worker processes in a row died, the last one {cause}. Is there enough memory? Try "
            "--workers 1."
        )
    return f"a worker process {cause}"


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Children started here ignore SIGINT; the parent handles Ctrl-C for all, after the block."""
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


def _prepare() -> None:
    """Set a process up: what a user's controller prints goes to stderr, and it ends with its parent."""
    end_with_starter()
    sys.stdout = sys.stderr


def end_with_starter() -> None:
    """Leave Ctrl-C to the process that started this one, and end when that has gone, even if killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    starter: Any = multiprocessing.parent_process()

    def watch() -> None:
        while os.getppid() == starter.pid:
            time.sleep(0.5)
        signal.raise_signal(signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


# A cluster of Dask.


@contextmanager
def _client(on: str, count: int) -> Iterator[Any]:
    """A client of a cluster started here, on loopback, or of the scheduler at an address."""
    dask, distributed = (
        needed(name, f"'--on {on}' needs Dask", "cluster") for name in ("dask", "distributed")
    )
    quiet = {
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.scheduler.allowed-failures": TRIES - 1,
    }
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what goes wrong is said here
    with dask.config.set(quiet), _interrupts_blocked():
        if on == "dask":
            cluster = distributed.LocalCluster(
                n_workers=count, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )  # fmt: skip
            client = distributed.Client(cluster)
        else:
            cluster = None
            client = _reach(distributed, on)
    try:
        yield client
    finally:
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        with _interrupts_blocked():
            client.close(timeout=5)
            if cluster is not None:
                cluster.close(timeout=10)


def _reach(distributed: Any, address: str) -> Any:
    try:
        client = distributed.Client(address, timeout=JOIN_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address}: {_first_line(error)}. Start one with 'dask scheduler'."
        ) from error
    try:
        client.wait_for_workers(1, timeout=JOIN_S)
        theirs = client.run(versions_here)
    except TimeoutError as error:
        raise InputError(
            f"the scheduler at {address} has no workers: start one, 'dask worker {address}'."
        ) from error
    except Exception as error:
        reason = f"cannot run polish-sim: {_first_line(error)}"
        raise InputError(f"the workers at {address} {reason}. Install the same there.") from error
    for worker, known in theirs.items():
        if known != versions_here():
            client.close()
            raise InputError(
                f"the worker {worker} has {_differing(known)} this command. Install the same there."
            )
    return client


def _first_line(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def _differing(theirs: Mapping[str, str]) -> str:
    return ", ".join(
        f"{k} {theirs.get(k)}, not {v} as" for k, v in versions_here().items() if theirs.get(k) != v
    )


@cache
def versions_here() -> dict[str, str]:
    """What results depend on: this package's source, Python, and the libraries that compute; and Dask's
    own."""
    names = ("numpy", "scipy", "numba", "mujoco", "trimesh", "dask", "distributed")
    python = ".".join(map(str, sys.version_info[:2]))
    return {"polish-sim": f"source {package_hash()[:12]}", "python": python} | {
        name: version(name) for name in names
    }


class _Cluster:
    def __init__(self, client: Any, shipped: Mapping[str, bytes], where: str) -> None:
        self._client = client
        shown = "dashboard" in client.scheduler_info()["services"]
        self.count = sum(client.nthreads().values())
        self.where = f"{where}, dashboard {client.dashboard_link}" if shown else where
        # Workers that come later keep them as well.
        client.register_worker_callbacks(partial(_store, shipped))

    def results(self, tasks: Sequence[Any], work: Work, group_of: GroupOf) -> Generator[Result]:
        distributed = import_module("distributed")
        # Neighbours share a group: a worker keeps what it has prepared for it.
        waiting = deque(sorted(tasks, key=lambda task: hash(group_of(task))))
        running: dict[Any, Any] = {}
        tries = dict.fromkeys(tasks, 0)
        doing = partial(_same_there, work, versions_here())
        done = SimpleQueue[Any]()

        def submit() -> None:
            task = waiting.popleft()
            future = self._client.submit(doing, task, pure=False)
            running[future] = task
            future.add_done_callback(done.put)

        try:
            for _ in range(min(AHEAD * max(1, self.count), len(waiting))):
                submit()
            while running:
                future = self._next(done)
                task = running[future]
                result = self._end_of(future, task, distributed)
                if result is None:
                    future.add_done_callback(done.put)
                    continue
                del running[future]
                if result.trouble is not None:
                    tries[task] += 1
                    # Dask blames all tasks of a worker that dies: this one may not be what killed it.
                    result = result._replace(again=tries[task] < TRIES)
                    if result.again:
                        waiting.append(task)
                if waiting:
                    submit()
                yield result
        finally:
            if running and self._client.status == "running":
                self._client.cancel(list(running), force=True)

    def _next(self, done: SimpleQueue[Any]) -> Any:
        """The next future that is done, as long as there are workers."""
        there = time.monotonic()
        while True:
            with suppress(Empty):
                return done.get(timeout=1.0)
            with suppress(OSError):  # no scheduler: its futures are cancelled in a moment
                there = time.monotonic() if self._client.nthreads() else there
            if time.monotonic() - there > GONE_S:
                raise WorkersError(
                    f"no worker for {GONE_S:.0f} s ({self.where}). Start one; the same command resumes."
                )

    def _end_of(self, future: Any, task: Any, distributed: Any) -> Result | None:
        """A task's result; None where its worker died with the result: the scheduler has it done again."""
        if future.status == "finished":
            # While the result was fetched its worker may die.
            with suppress(distributed.scheduler.KilledWorker, CancelledError):
                try:
                    return Result(task, future.result(JOIN_S), None)
                except TimeoutError:
                    return Result(task, None, f"a worker gave no result within {JOIN_S:.0f} s")
        if future.status in ("lost", "pending"):
            return None
        error = future.exception() if future.status == "error" else None
        if isinstance(error, distributed.scheduler.KilledWorker):
            return Result(task, None, "worker processes died at a task")
        if error is not None:
            raise _in_task(task, error)
        raise WorkersError(f"the scheduler is gone ({self.where}). The same command resumes when it is back.")


_copies: dict[str, str] = {}  #: Of shipped files, by their names on the machine they come from


def local_copy(name: str) -> str:
    """Where a user's file is on this machine: shipped to a worker, or its own name."""
    return _copies.get(name, name)


def _store(shipped: Mapping[str, bytes]) -> None:
    """Keep the user's files on this machine, each in a folder named by its content."""
    folder = Path(tempfile.gettempdir()) / f"polish-sim-{getpass.getuser()}"
    for name, content in shipped.items():
        copy = folder / short_hash(content) / Path(name).name
        copy.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        draft = copy.with_name(f".{copy.name}.{os.getpid()}")
        draft.write_bytes(content)
        draft.replace(copy)
        _copies[name] = str(copy)


def _same_there(work: Work, versions: Mapping[str, str], task: Any) -> Any:
    """One task on a worker of a cluster, of the same versions as here; what it prints goes to stderr."""
    if versions != versions_here():
        raise WorkersError(f"the command has {_differing(versions)} a worker. Install the same on both ends.")
    with redirect_stdout(sys.stderr):
        return work(task)
