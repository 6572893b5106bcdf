"""The memory of ``hybrid-adaptive`` along tool z, as named views of one array (layer 7)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

LINE = 64
"""Cycles the delay lines hold."""
MEMORY_SIZE = 3 * LINE + 31

# Slots of the memory's small arrays, as ``PressMemory`` describes them.
SENSED_AT, SENSED_PATH, SENSED_OWN, SENT_AT = 0, 1, 2, 3
LAST_SPEED, MOVED, DAMPER_SPEED = 0, 1, 2
DELAY, BEHIND, SLOWED, LAST_COMMAND = 0, 1, 2, 3
WATCHED, AIR_MEAN, AIR_VARIANCE, FAST, SLOW, TOUCHES, APPROACH_SPEED, TOLD, FAST_VARIANCE = 0, 1, 2, 3, 4, 5, 6, 7, 8
WEIGHT, MEAN_PATH, MEAN_FORCE, SPREAD, CO_SPREAD = 0, 1, 2, 3, 4
AT_NO_TRAVEL, RATE, TRAVEL, STIFFNESS, LANDED, AGE = 0, 1, 2, 3, 4, 5


class PressMemory(NamedTuple):
    """All zero after a reset."""

    path_line: Array
    """Travel into the part as the sensor's filter leaves it, the last cycles [m], shape (64,)."""
    own_line: Array
    """The tool's own forces as the sensor's filter leaves them, the last cycles [N], shape (64,)."""
    sent: Array
    """Commanded speeds along tool z, the last cycles [m/s], shape (64,)."""
    line: Array
    """Place in the lines of the sensor; filtered travel [m] and own force [N]; place in ``sent``, shape (4,)."""
    motion: Array
    """Tool speed of the last cycle [m/s], whether there was one, low-passed speed of the damper [m/s], shape (3,)."""
    delay: Array
    """Command delay [s], commanded less done travel [m], slowed command [m/s], last command [m/s], shape (4,)."""
    air: Array
    """Time watched [s]; mean of the reading in the air [N], variance of its noise [N^2]; the reading at two low-passes
    [N]; whether the tool touches; fastest approach [m/s]; the target's contact before; variance of the faster
    low-passed reading [N^2], shape (9,)."""
    fit: Array
    """Weight, mean travel [m], mean force [N], spread of the travel [m^2], of both [N m], shape (5,)."""
    force: Array
    """Force at no travel [N], its rate [N/s], travel since contact [m], stiffness [N/m], how far landed [-],
    time since contact [s], shape (6,)."""


@njit(cache=True)
def memory_in(flat: Array) -> PressMemory:
    """Named views of a flat memory, shape (223,)."""
    n = 3 * LINE
    return PressMemory(
        flat[0:64],
        flat[64:128],
        flat[128:192],
        flat[n : n + 4],
        flat[n + 4 : n + 7],
        flat[n + 7 : n + 11],
        flat[n + 11 : n + 20],
        flat[n + 20 : n + 25],
        flat[n + 25 : n + 31],
    )
