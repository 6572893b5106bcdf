"""What a controller sees and answers: measurement and target in, tool twist out (layer 7).

Both travel as one flat array each, so that a compiled law and a user's Python class read the same memory;
``measurement_of`` and ``target_of`` give the named views.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

MEASUREMENT_SIZE = 26
TARGET_SIZE = 24
ANSWER_SIZE = 7
"""Tool twist (6,) and the share of the planned feed the controller grants, 0 to 1."""
WHOLE_FEED = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
"""The answer of a controller that asks for nothing: rest, and the feed as planned."""
WHOLE_FEED.setflags(write=False)


class Measurement(NamedTuple):
    """What the host computer reads each control cycle; base frame unless said."""

    position: Array
    """Tool point from the encoders [m], shape (3,)."""
    rotation: Array
    """R_base_tool, shape (3, 3)."""
    twist: Array
    """Tool velocity from the encoders (linear [m/s]; angular [rad/s]), shape (6,)."""
    wrench: Array
    """Wrench the tool exerts on the part, tool axes, about the tool point (force [N]; torque [N m]), shape (6,).
    As the wrist sensor gives it: compensated, filtered, late. Positive force z presses."""
    clock: Array
    """Time [s] and control cycle [s], shape (2,)."""


class Target(NamedTuple):
    """What is wanted at this instant; base frame."""

    position: Array
    """Tool point [m], shape (3,), already pressed in by D = F/k."""
    rotation: Array
    """R_base_tool, shape (3, 3)."""
    twist: Array
    """Planned tool velocity (linear [m/s]; angular [rad/s]), shape (6,)."""
    force: Array
    """Force to press with [N] and moment wanted about tool y [N m], shape (2,)."""
    contact: Array
    """1 while the force is to be controlled, 0 in free space, shape (1,)."""
    path: Array
    """Place on the path [m], normal curvature there along the path [1/m] and speed of the place [m/s], shape (3,)."""


@njit(cache=True)
def measurement_of(flat: Array) -> Measurement:
    """Named views of a flat measurement, shape (26,)."""
    return Measurement(flat[0:3], flat[3:12].reshape((3, 3)), flat[12:18], flat[18:24], flat[24:26])


@njit(cache=True)
def target_of(flat: Array) -> Target:
    """Named views of a flat target, shape (24,)."""
    return Target(flat[0:3], flat[3:12].reshape((3, 3)), flat[12:18], flat[18:20], flat[20:21], flat[21:24])
