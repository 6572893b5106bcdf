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
from typing import Any, Final, Protocol

import numpy as np
from numba import types
from numpy.typing import NDArray

from polish_sim.cell.kernel import ENDED, PYTHON_ERROR
from polish_sim.control.signals import ANSWER_SIZE, LAW_SIGNATURE, WHOLE_FEED, Controller, measurement_of, target_of
from polish_sim.control.user_controller import file_of, tell_error


class Observer(Protocol):
    """What the library tells about long work; it never prints itself."""

    frame_every_s: float
    """Simulated time between calls of ``frame`` [s]."""

    def stage(self, text: str) -> None:
        """A new stage of the work begins, e.g. ``"simulate"``."""

    def progress(self, done: float, total: float) -> None:
        """How far the present stage is."""

    def frame(self, model: Any, data: Any) -> None:
        """The cell's model and data at this instant; not to be changed."""


class Silent:
    """Looks on and says nothing."""

    frame_every_s = 0.2

    def stage(self, text: str) -> None:
        """Ignore."""

    def progress(self, done: float, total: float) -> None:
        """Ignore."""

    def frame(self, model: Any, data: Any) -> None:
        """Ignore."""


# Ctrl-C between two chunks of steps, not in the middle of one: what was recorded stays whole.


@dataclass
class Interrupt:
    """Whether the user has asked to stop."""

    seen: bool = False


@contextmanager
def interrupts_noted() -> Iterator[Interrupt]:
    """Note the first Ctrl-C instead of raising it; a second one raises as ever.

    Raised, it could land inside a callback from compiled code, where Python can only print and drop it. Outside the
    main thread, or where somebody else handles or ignores the signal, everything stays as it is.
    """
    interrupt = Interrupt()
    before = signal.getsignal(signal.SIGINT)
    ours = threading.current_thread() is threading.main_thread() and before is signal.default_int_handler

    def note(_number: int, _frame: FrameType | None) -> None:
        interrupt.seen = True
        signal.signal(signal.SIGINT, before)

    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield interrupt
    finally:
        if ours:
            signal.signal(signal.SIGINT, before)


# A user's Python controller as a law the compiled loop can call.

Array = NDArray[np.float64]

EXPECTED: Final = "(6,), or (7,) with the feed's share"
"""Shape of an answer."""

_CALLBACK = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)


def _locked(flat: Array) -> Array:
    """The same memory, not writable: a controller must not change what the sensor is recorded to have read."""
    view = flat.view()
    view.flags.writeable = False
    return view


def _numbers(answer: Any) -> Array:
    """What ``step`` returned as an array.

    Raises:
        TypeError: It is no numbers.
        ValueError: They are too few or too many.
    """
    try:
        numbers = np.asarray(answer, dtype=float)
    except (TypeError, ValueError):
        numbers = None
    if answer is None or numbers is None:
        raise TypeError(f"step() returned {reprlib.repr(answer)}, expected {EXPECTED}")
    if numbers.shape not in ((ANSWER_SIZE - 1,), (ANSWER_SIZE,)):
        raise ValueError(f"step() returned shape {numbers.shape}, expected {EXPECTED}")
    return numbers


class PythonLaw(types.WrapperAddressProtocol):  # type: ignore[misc]
    """Calls ``controller.step`` on the loop's own arrays; what it raises stops the run and is kept."""

    def __init__(self, controller: Controller, measurement: Array, target: Array, twist: Array, status: Array) -> None:
        self.error: BaseException | None = None
        self._controller, self._twist, self._status = controller, twist, status
        self._measurement, self._target = measurement_of(_locked(measurement)), target_of(_locked(target))
        self._callback = _CALLBACK(self._call)

    def __wrapper_address__(self) -> int:
        """Address of the C function."""
        return ctypes.cast(self._callback, ctypes.c_void_p).value or 0

    @property
    def told(self) -> str:
        """What the controller raised, in one line, with the line of its file."""
        return "" if self.error is None else tell_error(self.error, file_of(self._controller))

    def signature(self) -> Any:
        """Numba's signature of a law."""
        return LAW_SIGNATURE

    def _call(self, _context: int, _measurement: int, _target: int, _twist: int) -> None:
        try:
            answer = _numbers(self._controller.step(self._measurement, self._target))
            self._twist[:] = WHOLE_FEED
            self._twist[: len(answer)] = answer
        except BaseException as error:
            self.error = error
            self._twist[:] = WHOLE_FEED
            self._status[ENDED if isinstance(error, KeyboardInterrupt) else PYTHON_ERROR] = 1.0
