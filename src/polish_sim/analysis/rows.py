"""Columns of a log as plain numbers, and which rows belong to which phase (layer 8c)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.log import RunLog

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PROCESS, RETRACT = 2, 3
"""Codes of the phases, see ``log.PHASES``."""


def numbers(log: RunLog, name: str) -> Array:
    """A column in double precision, shape (n,) or (n, k)."""
    return log[name].astype(np.float64)


def fed(log: RunLog) -> Mask:
    """Rows of the process, shape (n,)."""
    return log["phase"].astype(np.int8) == PROCESS


def before_retract(log: RunLog) -> Mask:
    """Rows before the tool lifts off, shape (n,)."""
    return log["phase"].astype(np.int8) < RETRACT
