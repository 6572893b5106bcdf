"""A box filtered by two boxes: the closed form of one smoothed segment (paper 4, eq. 1-3), as cubic pieces.

    S(t) = 1/(6 T1 T2 T3) SUM_A (-1)^|A| (t - T_A)_+^3
    A: subsets of {T1, T2, T3}, T_A: sum of its members

That sum cancels where one time is small. Here the times are sorted, a >= b >= c, the first half is added up
piece by piece from accelerations without differences of near numbers, and S(T - t) = 1 - S(t) beyond half
time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from polish_sim.arrays import Array, running_sums
from polish_sim.motion.rules.schedule import Schedule


def fir_schedule(starts: Array, triples: Array) -> Schedule:
    """Pieces of a chain whose segments are filtered boxes.

    They begin at ``starts`` (n,) [s], not falling; their filter times ``triples`` (n, 3) [s] are in any
    order, not negative, at least one positive.
    """
    durations, coefficients = box_pieces(triples)
    used = durations > 0.0
    begins = np.cumsum(np.column_stack([starts, durations[:, :-1]]), axis=1)
    end = np.max(starts + triples.sum(axis=1), initial=0.0)
    segments = np.repeat(np.arange(len(starts)), used.sum(axis=1))
    return Schedule(segments, begins[used], durations[used], coefficients[used], end)


def box_pieces(triples: Array) -> tuple[Array, Array]:
    """Pieces of n boxes of length 1, each filtered with three times (n, 3) [s] in any order.

    Returns durations [s], (n, 7), some of them zero, and coefficients, progress from each piece's start, (n,
    7, 4).
    """
    c, b, a = np.sort(triples, axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):
        plateau = np.where(b > 0.0, 1.0 / (a * b), 0.0)
        jerk = np.where(c > 0.0, plateau / c, 0.0)
    none = np.zeros_like(a)
    # The pieces of the first half and the middle one; an unfiltered box is at full speed at once.
    length = np.array([c, b - c, np.minimum(a, b + c) - b, np.abs(a - b - c)])
    acceleration = np.array([none, plateau, plateau, np.maximum(b + c - a, 0.0) * jerk])
    third = np.array([jerk, none, -jerk, np.where(a < b + c, -2.0 * jerk, 0.0)])
    gained = length * (acceleration + 0.5 * length * third)
    speed = np.cumsum([np.where(b > 0.0, 0.0, 1.0 / a), *gained[:3]], axis=0)
    gone = length * (speed + 0.5 * gained - length * length * third / 12.0)
    way = np.cumsum([none, *gone[:3]], axis=0)
    early = np.stack([way, speed, 0.5 * acceleration, third / 6.0], axis=-1)
    mirrored = -0.5 * (acceleration + third * length)
    late = np.stack([1.0 - way[1:], speed[1:], mirrored[:3], third[:3] / 6.0], axis=-1)
    pieces = np.concatenate([early, late[::-1]])
    return np.concatenate([length, length[2::-1]]).T, pieces.swapaxes(0, 1)


def rest_to_rest(triple: Array) -> tuple[Array, Array]:
    """When the pieces of a box filtered with three times begin and, last, end [s], (n + 1,), and their
    coefficients, (n, 4)."""
    pieces = fir_schedule(np.zeros(1), triple[None])
    return running_sums(pieces.durations), pieces.coefficients


def stop_times(length: Any, speed: Any, acceleration: Any, jerk: Any) -> Array:
    """Filter times a >= b >= c [s] of time-optimal motions from rest to rest over a length, (..., 3); one
    takes their sum.

    The shortest profile is a three-box profile a >= b + c: c = acceleration / jerk; or c = b = cbrt(length /
    2 jerk) and a = 2 c, 4 cbrt(length / 2 jerk) in all, where neither acceleration nor speed is reached.
    Limits may be infinite.
    """
    with np.errstate(invalid="ignore"):
        ramp = np.where(np.isfinite(jerk), acceleration / jerk, 0.0)
        c = np.fmin(ramp, np.fmin(np.sqrt(speed / jerk), (0.5 * length / jerk) ** (1.0 / 3.0)))
        b = 0.5 * (np.sqrt(c * c + 4.0 * length / acceleration) - c)
        b = np.where(c == ramp, np.fmax(c, np.fmin(speed / acceleration, b)), c)
    return np.stack([np.maximum(length / speed, b + c), b, c], axis=-1)


# How far an overlapped corner strays, and how long segments may overlap for it (paper 4, eq. 12-14).
#
# The end of one segment, mirrored in time, and the begin of the next are both the way H of a speed that rises
# from 0 to
# 1 over b + c, the two shorter of the three filter times. While both are under way the tip is
# ``V - v1 H1(T_c - t) d1 + v2 H2(t) d2``: where H1 = H2 = h it is ``h |v2 d2 - v1 d1|`` from the vertex. So
# the overlap for a tolerance is the sum of the two times at which H = tolerance / |v2 d2 - v1 d1|: eq. 13, if
# the filters are equal.
#
# For symmetric corners this *vertex* error is exact, and the *contour* error, the distance from the polyline,
# is
# ``vertex * cos(turn / 2)``. For others both are upper bounds. The tool axis is the same on a sphere, where
# the distance is a little less: a bound again.


def filter_rise(b: Array, c: Array, way: Array) -> Array:
    """When H reaches a way [s], capped at (b + c) / 2 [s]: half the overlap of eq. 13."""
    late = 0.5 * c + np.sqrt(np.maximum(2.0 * b * way - c * c / 12.0, 0.0))
    time = np.where(6.0 * b * way > c * c, late, (6.0 * b * c * way) ** (1.0 / 3.0))
    return np.minimum(time, 0.5 * (b + c))


def corner_speed(speed_1: Array, speed_2: Array, cosine: Array) -> Array:
    """Sizes of the change of velocity |v2 d2 - v1 d1| (paper 4, eq. 12), for the cosine of the turn between
    them."""
    return np.sqrt((speed_1 - speed_2) ** 2 + 2.0 * speed_1 * speed_2 * np.maximum(1.0 - cosine, 0.0))


def corner_overlap(tolerance: float, change: Array, b1: Array, c1: Array, b2: Array, c2: Array) -> Array:
    """Longest overlap whose vertex error is within a tolerance (paper 4, eq. 13, for unlike filters too) [s].

    ``tolerance`` is of the tip [m] or the axis [rad], ``change`` the `corner_speed` [m/s, rad/s], b and c the
    longer and shorter filter time before (1) and after (2) the corner [s]. At most the shorter of b1 + c1 and
    b2 + c2, beyond which speeds would add up on a straight path.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        way = tolerance / change
        rises = filter_rise(b1, c1, way) + filter_rise(b2, c2, way)
    return np.fmin(np.minimum(b1 + c1, b2 + c2), rises)  # straight on nothing rises: not a number
