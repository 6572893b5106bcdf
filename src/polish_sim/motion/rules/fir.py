"""A box filtered by two boxes: the closed form of one smoothed segment (paper 4, eq. 1-3), as cubic pieces.

    S(t) = 1/(6 T1 T2 T3) SUM_A (-1)^|A| (t - T_A)_+^3
    A: subsets of {T1, T2, T3}, T_A: sum of its members

That sum cancels where one time is small. Here the times are sorted, a >= b >= c, the first half is added up
piece by piece from accelerations without differences of near numbers, and S(T - t) = 1 - S(t) beyond half
time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from polish_sim.arrays import Array, Indices, running_sums
from polish_sim.kernel_cache import njit
from polish_sim.motion.rules.schedule import Schedule

PIECES = 7  #: Cubic pieces of one segment at most


def fir_schedule(starts: Array, triples: Array) -> Schedule:
    """Pieces of a chain whose segments are filtered boxes.

    They begin at ``starts`` (n,) [s], not falling; their filter times ``triples`` (n, 3) [s] are in any
    order, not negative, at least one positive.
    """
    n = len(starts)
    segments, counts = np.repeat(np.arange(n), PIECES), np.zeros(n, dtype=np.int64)
    begins, durations, coefficients = np.empty(n * PIECES), np.empty(n * PIECES), np.empty((n * PIECES, 4))
    _write_all(np.asarray(starts, float), np.asarray(triples, float), counts, begins, durations, coefficients)
    used = np.tile(np.arange(PIECES), n) < np.repeat(counts, PIECES)
    end = np.max(starts + triples.sum(axis=1), initial=0.0)
    return Schedule(segments[used], begins[used], durations[used], coefficients[used], end)


@njit
def _write_all(
    starts: Array, triples: Array, counts: Indices, begins: Array, durations: Array, coefficients: Array
) -> None:
    for k in range(starts.shape[0]):
        row = PIECES * k
        rows = slice(row, row + PIECES)
        counts[k] = box_pieces(
            triples[k, 0], triples[k, 1], triples[k, 2], durations[rows], coefficients[rows]
        )
        time = starts[k]
        for i in range(row, row + counts[k]):
            begins[i] = time
            time += durations[i]


@njit
def sorted_times(t1: float, t2: float, t3: float) -> tuple[float, float, float]:
    """The three times, the longest first."""
    low, high = min(t1, t2), max(t1, t2)
    return max(high, t3), max(low, min(high, t3)), min(low, t3)


@njit
def box_pieces(t1: float, t2: float, t3: float, durations: Array, coefficients: Array) -> int:
    """Write the pieces of a box of length 1 filtered with three times [s] in any order, those of no duration
    left out.

    Written are ``durations`` (7,) [s] and ``coefficients`` (7, 4), progress from each piece's start. Returns
    the number of pieces.
    """
    a, b, c = sorted_times(t1, t2, t3)
    plateau = 1.0 / (a * b) if b > 0.0 else 0.0
    jerk = plateau / c if c > 0.0 else 0.0
    early = min(a, b + c)  # the middle piece begins
    # Where the pieces of the first half begin; an unfiltered box is at full speed at once.
    ways, speeds = np.zeros(4), np.full(4, 0.0 if b > 0.0 else 1.0 / a)
    count = 0
    for i in range(PIECES):
        half = min(i, PIECES - 1 - i)
        length, acceleration, third = c, 0.0, jerk
        if half == 1:
            length, acceleration, third = b - c, plateau, 0.0
        elif half == 2:
            length, acceleration, third = early - b, plateau, -jerk
        elif half == 3:
            length, acceleration = abs(a - b - c), max(b + c - a, 0.0) * jerk
            third = -2.0 * jerk if a < b + c else 0.0
        if i < 3:
            gained = length * (acceleration + 0.5 * length * third)
            ways[i + 1] = ways[i] + length * (speeds[i] + 0.5 * gained - length * length * third / 12.0)
            speeds[i + 1] = speeds[i] + gained
        if length <= 0.0:
            continue
        begin = half
        if i > 3:  # mirrored in time
            begin, acceleration = half + 1, -(acceleration + third * length)
        durations[count] = length
        coefficients[count, 0] = 1.0 - ways[begin] if i > 3 else ways[begin]
        coefficients[count, 1] = speeds[begin]
        coefficients[count, 2], coefficients[count, 3] = 0.5 * acceleration, third / 6.0
        count += 1
    return count


def rest_to_rest(triple: Iterable[float]) -> tuple[Array, Array]:
    """When the pieces of `box_pieces` begin and, last, end [s], (n + 1,), and their coefficients, (n, 4)."""
    durations, coefficients = np.zeros(PIECES), np.zeros((PIECES, 4))
    n = box_pieces(*triple, durations, coefficients)
    return running_sums(durations[:n]), coefficients[:n]


@njit
def stop_times(length: float, speed: float, acceleration: float, jerk: float) -> tuple[float, float, float]:
    """Filter times a >= b >= c [s] of the time-optimal motion from rest to rest over a length; it takes their
    sum.

    The shortest profile is a three-box profile a >= b + c: c = acceleration / jerk; or c = b = cbrt(length /
    2 jerk) and a = 2 c, 4 cbrt(length / 2 jerk) in all, where neither acceleration nor speed is reached.
    Limits may be infinite.
    """
    ramp = c = 0.0
    if math.isfinite(jerk):
        ramp = acceleration / jerk
        c = min(ramp, math.sqrt(speed / jerk), (0.5 * length / jerk) ** (1.0 / 3.0))
    b = c
    if c == ramp:
        b = max(c, min(speed / acceleration, 0.5 * (math.sqrt(c * c + 4.0 * length / acceleration) - c)))
    return max(length / speed, b + c), b, c


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


@njit
def filter_rise(b: float, c: float, way: float) -> float:
    """When H reaches a way [s], capped at (b + c) / 2 [s]: half the overlap of eq. 13."""
    time = (6.0 * b * c * way) ** (1.0 / 3.0)
    if 6.0 * b * way > c * c:
        time = 0.5 * c + math.sqrt(max(2.0 * b * way - c * c / 12.0, 0.0))
    return min(time, 0.5 * (b + c))


@njit
def corner_speed(speed_1: float, speed_2: float, cosine: float) -> float:
    """Size of the change of velocity |v2 d2 - v1 d1| (paper 4, eq. 12), for the cosine of the turn between
    them."""
    return math.sqrt((speed_1 - speed_2) ** 2 + 2.0 * speed_1 * speed_2 * max(1.0 - cosine, 0.0))


@njit
def corner_overlap(tolerance: float, change: float, b1: float, c1: float, b2: float, c2: float) -> float:
    """Longest overlap whose vertex error is within a tolerance (paper 4, eq. 13, for unlike filters too) [s].

    ``tolerance`` is of the tip [m] or the axis [rad], ``change`` the `corner_speed` [m/s, rad/s], b and c the
    longer and shorter filter time before (1) and after (2) the corner [s]. At most the shorter of b1 + c1 and
    b2 + c2, beyond which speeds would add up on a straight path.
    """
    whole = min(b1 + c1, b2 + c2)
    if change <= 0.0:
        return whole
    way = tolerance / change
    return min(whole, filter_rise(b1, c1, way) + filter_rise(b2, c2, way))
