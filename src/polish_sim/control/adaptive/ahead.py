"""The course as a compiled law reads it: columns in one flat array behind the law's gains and memory (layer 7).

Kernels cannot hold a Python object; they get the tail of the context and see it through ``ahead_of``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from polish_sim.control.course import Course

Array = NDArray[np.float64]

HEADER = 2  # spacing and number of rows
COLUMNS = 15
MEMORY_COLUMNS = 2  # the last ones
SMOOTHING_M = 0.002  # of the planned depth before its slope is taken: the pad is far wider [m]


class Ahead(NamedTuple):
    """What lies ahead, and what was learned on the way; columns of shape (n,), n = 0 without a course."""

    spacing: float
    """Arc length between rows [m]."""
    depth: Array
    """Depth that presses with the wanted force, from the unpressed surface [m]."""
    surplus: Array
    """That depth beyond the planned target's [m]."""
    slope: Array
    """Change of the surplus per arc length [-]."""
    stiffness: Array
    """Head spring and touching part of the pad in series [N/m]."""
    turn_x: Array
    """Planned rotation per arc length about base x [rad/m]."""
    turn_y: Array
    turn_z: Array
    moment_x: Array
    """Moment of the pad's pressure about tool x through the middle of its face [N m]."""
    moment_y: Array
    tilt_x: Array
    """Stiffness against tilting about tool x [N m/rad]."""
    tilt_y: Array
    share: Array
    """Share of the planned feed the loops can follow [-]."""
    neighbour: Array
    """Row of the nearest place on an earlier turn, -1 for none."""
    learned: Array
    """How much deeper than drawn the tool had to go here, memory of the run [m]."""
    known: Array
    """1 where that was learned in this run, else 0."""


def pack_ahead(course: Course, share: Array) -> Array:
    """Flatten a course for the compiled laws, shape (2 + 15 n,).

    Args:
        course: The course.
        share: Share of the planned feed that can be followed, see ``feed.followable_share``, shape (n,).
    """
    n = len(course.depth)
    smooth = gaussian_filter1d(course.surplus, SMOOTHING_M / course.spacing, mode="nearest")
    slope = np.gradient(smooth, course.spacing) if n > 1 else np.zeros(n)
    columns = [
        course.depth, smooth, slope, course.stiffness, *course.turning.T, *course.moment.T, *course.tilt_stiffness.T,
        share, course.neighbour, *np.zeros((MEMORY_COLUMNS, n)),
    ]  # fmt: skip
    return np.concatenate([[course.spacing, n], *columns]).astype(np.float64)


def no_ahead() -> Array:
    """What the laws get when nothing is known of the path, shape (2,)."""
    return np.array([1.0, 0.0])


def forget(flat: Array) -> None:
    """Forget what was learned; what was drawn stays."""
    n = int(flat[1])
    flat[HEADER + (COLUMNS - MEMORY_COLUMNS) * n :] = 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def ahead_of(flat: Array) -> Ahead:
    """Named views of a flat course."""
    n, table = int(flat[1]), flat[2:]
    return Ahead(
        flat[0],
        table[0:n], table[n : 2 * n], table[2 * n : 3 * n], table[3 * n : 4 * n], table[4 * n : 5 * n],
        table[5 * n : 6 * n], table[6 * n : 7 * n], table[7 * n : 8 * n], table[8 * n : 9 * n],
        table[9 * n : 10 * n], table[10 * n : 11 * n], table[11 * n : 12 * n], table[12 * n : 13 * n],
        table[13 * n : 14 * n], table[14 * n : 15 * n],
    )  # fmt: skip


@njit(cache=True, error_model="numpy", forceinline=True)
def at(column: Array, spacing: float, s: float) -> float:
    """A column at an arc length [m], linear between rows and held at its ends; 0 without rows."""
    n = column.shape[0]
    if n < 2:
        return 0.0
    place = min(max(s / spacing, 0.0), n - 1.000001)
    row = int(place)
    return column[row] + (place - row) * (column[row + 1] - column[row])
