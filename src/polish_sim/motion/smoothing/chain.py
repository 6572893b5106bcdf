"""The way points as a chain of segments, each a straight line of the tip and one turn of the tool (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Chain(NamedTuple):
    """n segments between n + 1 way points, in one frame; arrays a compiled kernel can take.

    At progress u in [0, 1] of segment k the tip is at ``tips[k] + u lengths[k] directions[k]`` and the tool at
    ``exp(u angles[k] turn_axes[k]) R_start[k] exp(u rolls[k] z)``: the tool axis runs along a great circle at constant
    rate (paper 4, eq. 11), the roll about it is shared out evenly.
    """

    tips: Array
    """Way points [m], shape (n + 1, 3)."""
    axes: Array
    """Unit tool axes at the way points, pointing into the part (tool z), shape (n + 1, 3)."""
    rotations: Array
    """Tool frames at the way points, third column the axis, shape (n + 1, 3, 3)."""
    lengths: Array
    """[m], shape (n,)."""
    directions: Array
    """Unit directions of the tip; zero where the length is, shape (n, 3)."""
    angles: Array
    """Angle the tool axis turns by [rad], in [0, pi), shape (n,)."""
    turn_axes: Array
    """Unit axis it turns about, at a right angle to both ends' tool axes; zero where the angle is, shape (n, 3)."""
    rolls: Array
    """Turn about the tool axis that is left to the next way point's frame [rad], shape (n,)."""
