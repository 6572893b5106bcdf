"""Who may look on while a run goes: progress bars, viewers, video writers."""

from __future__ import annotations

import ctypes
import reprlib
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any, Protocol

import numpy as np
from numba import types

from polish_sim.arrays import Array
from polish_sim.cell.kernel import CellState
from polish_sim.control.laws import file_of, tell_error
from polish_sim.control.signals import CALL, LAW_SIGNATURE, Controller
from polish_sim.kernels import memory_of


class Observer(Protocol):
    """Receives the progress of long work; the library never prints."""

    frame_every_s: float  #: Simulated time between calls of ``frame`` [s]

    def stage(self, text: str) -> None:
        """A new stage of the work begins, e.g. ``"simulate"``."""
        return

    def progress(self, done: float, total: float) -> None:
        """How far the present stage is."""
        return

    def start(self, cell: Any) -> None:
        """The cell that is about to run; between frames it can be asked to ``let_happen`` something."""
        return

    def frame(self, model: Any, data: Any) -> None:
        """The cell's model and data at this instant; not to be changed."""
        return


class Silent(Observer):
    """Looks on and says nothing."""

    frame_every_s = 0.5


SILENT = Silent()


# Ctrl-C between two chunks of steps, not in the middle of one: what was recorded stays whole.

STOPPING = "stopping at the next cycle; Ctrl-C again ends a controller's step"
#: After the first Ctrl-C a controller may run for this long before it is aborted [s]
PATIENCE_S = 2.0


@dataclass
class Interrupt:
    """Whether the user has asked to stop."""

    seen: bool = False
    waits: bool = False  #: Until results are written

    def note(self, *_: object) -> None:
        """Handle the signal: raise the first one unless it waits, and no other."""
        first, self.seen = not self.seen, True
        if first and not self.waits:
            raise KeyboardInterrupt


_waiting = Interrupt()


@contextmanager
def interrupts_noted(observer: Observer = SILENT) -> Iterator[Interrupt]:
    """Note Ctrl-C instead of raising it; a second one ends a controller's step, and so does one that does not
    end by itself.

    Raised, the first could land inside a callback from compiled code, where Python can only print and drop
    it. Outside the main thread, or where somebody else handles or ignores the signal, everything stays as it
    is.
    """
    interrupt, before = Interrupt(_waiting.waits and _waiting.seen), signal.getsignal(signal.SIGINT)
    ours = threading.current_thread() is threading.main_thread() and before in (
        signal.default_int_handler,
        _waiting.note,
    )
    alarm = ours and hasattr(signal, "setitimer") and signal.getsignal(signal.SIGALRM) is signal.SIG_DFL

    def note(_number: int, _frame: FrameType | None) -> None:
        interrupt.seen = True
        signal.signal(signal.SIGINT, _abort_step)
        if alarm:
            signal.signal(signal.SIGALRM, _abort_step)
            signal.setitimer(signal.ITIMER_REAL, PATIENCE_S)
        observer.stage(STOPPING)

    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield interrupt
    finally:
        if alarm:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
        if ours:
            signal.signal(signal.SIGINT, _waiting.note if _waiting.waits else before)


@contextmanager
def results_kept(waits: bool = True) -> Iterator[Interrupt]:
    """From the end of a run to the end of the block Ctrl-C is noted while it ``waits``, so that what was
    recorded is written; after one that came no other is raised."""
    before = signal.getsignal(signal.SIGINT)
    _waiting.waits = waits
    _waiting.seen = False
    try:
        yield _waiting
    finally:
        _waiting.waits = False
        signal.signal(signal.SIGINT, before)


# A user's Python controller as a law the compiled loop can call.

EXPECTED = "(6,), or (7,) with the feed's share"  #: Shape of an answer


def _abort_step(_number: int, frame: FrameType | None) -> None:
    """End a controller's step; nothing else, or what was recorded would be lost."""
    while frame is not None:
        if frame.f_code is PythonLaw._call.__code__:
            raise KeyboardInterrupt
        frame = frame.f_back


def _locked(record: Any) -> Any:
    """The same memory, not writable: a controller must not change what the sensor is recorded to have
    read."""
    array = memory_of(record).view(record.dtype)
    array.flags.writeable = False
    return array[0]


def _numbers(answer: Any) -> Array:
    """What ``step`` returned as an array; TypeError if it is no numbers, ValueError if they are too few or
    too many."""
    try:
        numbers = np.asarray(answer, dtype=float)
    except (TypeError, ValueError):
        numbers = None
    if answer is None or numbers is None:
        raise TypeError(f"step() returned {reprlib.repr(answer)}, expected {EXPECTED}")
    if numbers.shape not in ((6,), (7,)):
        raise ValueError(f"step() returned shape {numbers.shape}, expected {EXPECTED}")
    return numbers


class PythonLaw:
    """Calls ``controller.step`` on the loop's own arrays; what it raises stops the run and is kept."""

    _numba_type_ = types.FunctionType(LAW_SIGNATURE)

    def __init__(self, controller: Controller, state: CellState) -> None:
        self.error: BaseException | None = None
        self._controller = controller
        self._status = state.status
        self._measurement, self._target = _locked(state.measurement), _locked(state.target)
        self._answer = memory_of(state.answer).view(np.float64)
        self._callback = CALL(self._call)
        self.address = ctypes.cast(self._callback, ctypes.c_void_p).value

    @property
    def message(self) -> str:
        """What the controller raised, in one line, with the line of its file."""
        return "" if self.error is None else tell_error(self.error, file_of(self._controller))

    def _call(self, *_pointers: int) -> None:
        self._answer[:] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
        try:
            answer = _numbers(self._controller.step(self._measurement, self._target))
            self._answer[: len(answer)] = answer
        except BaseException as error:
            self.error = error
            if isinstance(error, KeyboardInterrupt):
                self._status.ended = True
            else:
                self._status.python_error = True
