"""The machine that runs URScript: a programme's threads take turns, 500 times a second."""

from __future__ import annotations

import marshal
import re
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass
from time import thread_time
from typing import TYPE_CHECKING, Any

from polish_sim.ur.script import values
from polish_sim.ur.script.built_ins import STOP_A, BuiltIns
from polish_sim.ur.script.sockets import Waiting
from polish_sim.ur.script.translate import FILE, Program

if TYPE_CHECKING:
    from polish_sim.ur.robot import SimulatedRobot

MOST_WORK = 300_000  #: Parts of statements a thread may run between two waits
MOST_S = 0.2  #: And processor time of all threads in a step [s]
MOST_THREADS = 64


class Halt(Exception):
    """The programme ends itself."""


@dataclass(eq=False)
class _Thread:
    """A thread; its generator waits a step at each ``yield``."""

    steps: Generator[None, None, Any]
    alive: bool = True

    def close(self) -> None:
        """End it where it waits."""
        self.alive = False
        with suppress(ValueError):  # it is the one that runs
            self.steps.close()


class Machine(BuiltIns):
    """Runs one programme, given as text; ``tick`` comes from the clock, the rest from the ports, all in one
    thread.

    Args:
        program: What was made of its text.
        listener: Receives its messages.
        client: The address its sockets reach.
    """

    def __init__(self, program: Program, listener: Any, client: str = "") -> None:
        super().__init__()
        self.program = program
        self.listener = listener
        self.running = True
        self.client = client
        space: dict[str, Any] = {"__builtins__": {}, "Halt": Halt, "List": values.List, "pose": values.pose}
        for word in ("add", "sub", "mul", "mod", "xor", "element", "replaced", "checked"):
            space[word] = getattr(values, word)
        space |= {"spend": self._spend, "run": self._run, "join": self._join, "kill": self._kill}
        space |= {f"b_{name}": built_in for name, built_in in self.table().items()}
        self._threads = [_Thread(self._main(space))]
        self._current = self._threads[0]
        self._left = 0
        self._deadline = 0.0
        if not self.program.secondary:
            listener.started(self.program.name)

    def _main(self, space: dict[str, Any]) -> Waiting:
        """The programme; parameters get their defaults in its first step."""
        exec(marshal.loads(self.program.code), space)
        yield from space["main"]()

    def stop(self) -> None:
        """End the programme and stop the robot; harmless when it has ended."""
        if not self.running:
            return
        self.running = False
        for thread in self._threads:
            thread.close()
        self.close_all()
        if self.program.secondary:
            return
        if hasattr(self, "robot"):
            self.robot.end_force_mode()
            self.robot.stopj(STOP_A)
        self.listener.stopped(self.program.name)

    def close_popup(self) -> None:
        """Let a programme continue after its blocking message."""
        self.popup_open = False

    def tick(self, robot: SimulatedRobot) -> None:
        """Run each thread to its next wait: once in 2 ms, before the robot's step."""
        self.robot = robot
        self._deadline = thread_time() + MOST_S
        for thread in self._threads:  # a thread that starts another lets it run in the same step
            if thread.alive:
                self._advance(thread)
            if not self.running:
                return
        if self._threads[0].alive:
            self._threads = [thread for thread in self._threads if thread.alive]
        else:
            self.stop()

    def _advance(self, thread: _Thread) -> None:
        self._current = thread
        self._left = MOST_WORK
        try:
            next(thread.steps)
            if self.program.secondary:
                raise ValueError("a secondary programme may not wait or move the robot")
        except (StopIteration, GeneratorExit):
            thread.alive = False
        except Halt:
            self.stop()
        except Exception as error:
            self.listener.runtime_exception(*_place(error, self.program), _said(error))
            self.stop()

    def _spend(self, work: int) -> None:
        self._left -= work
        if self._left < 0 or thread_time() > self._deadline:
            raise ValueError("an endless loop: nothing in it waits, such as sync()")

    def _run(self, steps: Generator[None, None, Any]) -> _Thread:
        if len(self._threads) >= MOST_THREADS:
            raise ValueError(f"more than {MOST_THREADS} threads")
        thread = _Thread(steps)
        self._threads.append(thread)
        return thread

    def _join(self, thread: Any) -> Generator[None, None, None]:
        while isinstance(thread, _Thread) and thread.alive:
            yield

    def _kill(self, thread: Any) -> None:
        if not isinstance(thread, _Thread) or not thread.alive:
            return
        if thread is self._threads[0]:
            raise Halt
        if thread is self._current:
            raise GeneratorExit
        thread.close()
        if self.mover is thread:
            self.mover = None


def _place(error: Exception, program: Program) -> tuple[int, int]:
    """Line and column where a programme failed."""
    place = (1, 1)
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == FILE:
            place = program.places.get(trace.tb_lineno, place)
        trace = trace.tb_next
    return place


def _said(error: Exception) -> str:
    if isinstance(error, NameError):
        name = re.search(r"'[gl]_(\w+)'", str(error))
        return f"variable '{name.group(1) if name else '?'}' has no value yet"
    known: dict[type[Exception], str] = {
        RecursionError: "functions call each other too deeply",
        ZeroDivisionError: "division by zero",
        IndexError: "there is no such element",
        TypeError: "an operand or argument of a wrong type",
    }
    return known.get(type(error), str(error) or type(error).__name__)
