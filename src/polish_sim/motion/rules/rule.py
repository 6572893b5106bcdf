"""What every smoothing rule is: way points and limits in, a schedule out."""

from __future__ import annotations

from typing import NamedTuple, Protocol

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


class Rule(Protocol):
    """A smoothing rule."""

    def __call__(
        self,
        chain: Chain,
        limits: SmoothingLimits,
        tolerance: float,
        axis_tolerance: float,
        arm: Arm | None,
        feeds: Array | None = None,
    ) -> Smoothed:
        """Plan the motion along a chain.

        Args:
            chain: The segments.
            limits: Of tool and joints.
            tolerance: Of the tip [m]; the rule says of which distance.
            axis_tolerance: Of the tool axis [rad].
            arm: None leaves the joints out.
            feeds: Speed limits of the tip per segment [m/s], shape (n,), infinity where there is none; or None.

        Returns:
            The chain and its schedule.

        Raises:
            ReachError: A place out of reach or singular.
            SmoothingError: No speed keeps the joint limits.
        """
        ...
