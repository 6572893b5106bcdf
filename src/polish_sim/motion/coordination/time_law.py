"""From rest to rest along a quintic: speed and acceleration are zero at both ends (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Progress(NamedTuple):
    """Share of a way done, and its derivatives by the share of the time."""

    share: Array
    speed: Array
    acceleration: Array


def rest_to_rest(time_share: Array) -> Progress:
    """10 x^3 - 15 x^4 + 6 x^5 and its derivatives.

    Args:
        time_share: Share of the time, 0 to 1, shape (k,).
    """
    x = np.clip(time_share, 0.0, 1.0)
    return Progress(
        x**3 * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * (1.0 - x) ** 2, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)
    )
