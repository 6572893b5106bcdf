"""A user's Python controller as a law the compiled loop can call (layer 8a)."""

from __future__ import annotations

import ctypes
import reprlib
from typing import Any, Final

import numpy as np
from numba import types
from numpy.typing import NDArray

from polish_sim.cell.kernel import ENDED, PYTHON_ERROR
from polish_sim.control.laws import LAW_SIGNATURE, Controller
from polish_sim.control.signals import ANSWER_SIZE, WHOLE_FEED, measurement_of, target_of
from polish_sim.control.user_error import file_of, tell_error

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
