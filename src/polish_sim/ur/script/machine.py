"""The machine that runs URScript: a programme's threads take turns, 500 times a second."""

from __future__ import annotations

import re
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass
from random import Random
from typing import Any

from polish_sim.ur.api import Listener, Robot
from polish_sim.ur.script import values
from polish_sim.ur.script.built_ins import STOP_A, BuiltIns
from polish_sim.ur.script.parse import ScriptError
from polish_sim.ur.script.translate import FILE, Program, translate

MOST_WORK = 300_000  #: Parts of statements a thread may run between two waits
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


class Machine:
    """Runs one programme, and secondary ones beside it.

    ``load`` and ``stop`` come from the ports, ``tick`` from the clock; all in one thread of Python.
    """

    robot: Robot

    def __init__(self, listener: Listener) -> None:
        self.listener = listener
        self.popup_open = False
        self.paused = False
        self.random = Random(0)
        self.mover: _Thread | None = None  #: The thread that moves the robot now
        self.program: Program | None = None
        self._built_ins = BuiltIns(self)
        self._threads: list[_Thread] = []
        self._secondary: list[tuple[Program, _Thread]] = []
        self._current: _Thread | None = None
        self._left = 0

    @property
    def running(self) -> bool:
        """Whether a programme runs (or is paused)."""
        return self.program is not None

    @property
    def name(self) -> str:
        """The running programme's name."""
        return self.program.name if self.program else ""

    def translate(self, text: str) -> Program:
        """What ``start`` takes; may be called from another thread of Python. Raises ScriptError."""
        return translate(text.replace("\r\n", "\n"), self._built_ins)

    def load(self, text: str, client: str = "") -> bool:
        """Start a programme in the place of the present one, which goes on if this one is refused."""
        try:
            program = self.translate(text)
        except ScriptError as error:
            self.listener.runtime_exception(error.line, error.column, error.text)
            return False
        self.start(program, client)
        return True

    def start(self, program: Program, client: str = "") -> None:
        """Start a programme; its first statements run in the next ``tick``. ``client``: what its sockets reach."""
        space: dict[str, Any] = {"__builtins__": {}, "Halt": Halt, "List": values.List, "pose": values.pose}
        for word in ("add", "mul", "mod", "xor", "element", "replaced"):
            space[word] = getattr(values, word)
        space |= {"spend": self._spend, "run": self._run, "join": self._join, "kill": self._kill}
        space |= {f"b_{name}": built_in for name, built_in in self._built_ins.table().items()}
        exec(program.code, space)
        thread = _Thread(space["main"]())
        if program.secondary:
            self._secondary.append((program, thread))
            return
        self.stop()
        self._built_ins.client = client
        self.program, self._threads, self.paused, self.random = program, [thread], False, Random(0)
        self.listener.started(program.name)

    def stop(self) -> None:
        """End the programme and stop the robot; harmless without one."""
        program, self.program = self.program, None
        for thread in self._threads:
            thread.close()
        self._threads, self.mover, self.popup_open = [], None, False
        self._built_ins.close_all()
        if program is None:
            return
        if hasattr(self, "robot"):
            self.robot.end_force_mode()
            self.robot.end_freedrive()
            self.robot.stopj(STOP_A)
        self.listener.stopped(program.name)

    def close_popup(self) -> None:
        """Let a programme go on behind its blocking message."""
        self.popup_open = False

    def tick(self, robot: Robot) -> None:
        """Run each thread to its next wait: once in 2 ms, before the robot's step."""
        self.robot = robot
        secondary, self._secondary = self._secondary, []
        for program, thread in secondary:
            self._advance(program, thread)
        if self.program is None or self.paused:
            return
        main = self._threads[0]
        for thread in self._threads:  # a thread that starts another lets it run in the same step
            if thread.alive:
                self._advance(self.program, thread)
            if self.program is None:
                return
        if main.alive:
            self._threads = [thread for thread in self._threads if thread.alive]
        else:
            self.stop()

    def _advance(self, program: Program, thread: _Thread) -> None:
        self._current, self._left = thread, MOST_WORK
        try:
            next(thread.steps)
            return
        except (StopIteration, GeneratorExit):
            thread.alive = False
            return
        except Halt:
            pass
        except Exception as error:
            line, column = _place(error, program)
            self.listener.runtime_exception(line, column, _said(error))
        thread.alive = False
        if not program.secondary:
            self.stop()

    def take_robot(self) -> None:
        """Refuse a move while another thread moves the robot."""
        if self.mover is not None and self.mover is not self._current:
            raise ValueError("another thread is already moving the robot")
        self.mover = self._current

    def _spend(self, work: int) -> None:
        self._left -= work
        if self._left < 0:
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
    place, trace = (1, 1), error.__traceback__
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
