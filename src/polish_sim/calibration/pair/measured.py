"""What is known of two robots before they are adjusted together, and the touches that close their chain (layer 8b)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PairParts(NamedTuple):
    """Bases, tool and part as found one by one, each with its covariance."""

    T_master_follower: Array
    """The follower's base in the master's, shape (4, 4)."""
    bases_covariance: Array
    """Of its origin [m] and a small rotation [rad], master axes, shape (6, 6)."""
    tip: Array
    """The tool's tip on the follower's flange [m], shape (3,)."""
    tip_covariance: Array
    """Flange axes [m^2], shape (3, 3)."""
    marks_flange: Array
    """Marks of the part on the master's flange [m], shape (k, 3)."""
    marks_covariance: Array
    """Flange axes [m^2], shape (k, 3, 3)."""


class ClosingTouches(NamedTuple):
    """The follower's tip brought to marks of the part the master holds; flange poses as the robots say them."""

    T_master_flange: Array
    """Of the master in its base, shape (n, 4, 4)."""
    T_follower_flange: Array
    """Of the follower in its base, shape (n, 4, 4)."""
    mark: NDArray[np.int64]
    """Which mark was touched, shape (n,)."""
