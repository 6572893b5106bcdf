"""What every smoothing rule is: way points and limits in, a schedule out."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.smoothing.arm import Arm
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.limits import SmoothingLimits
from polish_sim.motion.smoothing.schedule import Schedule

Array = NDArray[np.float64]


class Smoothed(NamedTuple):
    """A rule's answer."""

    chain: Chain
    """The segments passed: the given ones, or fewer where the rule joins short ones."""
    schedule: Schedule
    """When they are passed."""


Rule = Callable[[Chain, SmoothingLimits, float, float, Arm | None, Array | None], tuple[Chain, Schedule]]
"""(chain, limits, tolerance [m], axis tolerance [rad], arm or None for the tool alone, feeds or None) -> `Smoothed`.

Feeds are speed limits of the tip per segment [m/s], shape (n,), infinity where there is none.
"""
