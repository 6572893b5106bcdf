"""How far an overlapped corner strays, and how long segments may overlap for it (paper 4, eq. 12-14).

The end of one segment, mirrored in time, and the begin of the next are both the way H of a speed that rises from 0 to
1 over b + c, the two shorter of the three filter times. While both are under way the tip is
``V - v1 H1(T_c - t) d1 + v2 H2(t) d2``: where H1 = H2 = h it is ``h |v2 d2 - v1 d1|`` from the vertex. So the overlap
for a tolerance is the sum of the two times at which H = tolerance / |v2 d2 - v1 d1|: eq. 13, if the filters are equal.

For symmetric corners this *vertex* error is exact, and the *contour* error, the distance from the polyline, is
``vertex * cos(turn / 2)``. For others both are upper bounds. The tool axis is the same on a sphere, where the
distance is a little less: a bound again.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, error_model="numpy")
def rise_way(b: float, c: float, time: float) -> float:
    """H: way of a speed that rises from 0 to 1 over b + c, within the first half of that.

    Args:
        b: Longer filter time [s].
        c: Shorter filter time [s].
        time: [s], 0 to (b + c) / 2.

    Returns:
        [s], as the speed has no unit.
    """
    if time < c:
        return time * (time / b) * (time / c) / 6.0
    if b == 0.0:
        return 0.0
    return (3.0 * time * (time - c) + c * c) / (6.0 * b)


@njit(cache=True, error_model="numpy")
def rise_time(b: float, c: float, way: float) -> float:
    """When H reaches a way [s], capped at (b + c) / 2 [s]: half the overlap of eq. 13."""
    time = (6.0 * b * c * way) ** (1.0 / 3.0)
    if 6.0 * b * way > c * c:
        time = 0.5 * c + math.sqrt(max(2.0 * b * way - c * c / 12.0, 0.0))
    return min(time, 0.5 * (b + c))


@njit(cache=True, error_model="numpy")
def corner_speed(speed_1: float, speed_2: float, cosine: float) -> float:
    """Size of the change of velocity |v2 d2 - v1 d1| (paper 4, eq. 12), any unit per second.

    Args:
        speed_1: L / a of the segment before.
        speed_2: Of the segment after.
        cosine: Of the turn between them: 1 straight on, -1 back.

    Returns:
        The size, exact for straight corners too.
    """
    return math.sqrt((speed_1 - speed_2) ** 2 + 2.0 * speed_1 * speed_2 * max(1.0 - cosine, 0.0))


@njit(cache=True, error_model="numpy")
def vertex_error(overlap: float, t2: float, t3: float, change: float) -> float:
    """Distance from the vertex of two segments with the same filters (paper 4, eq. 12), in the unit of ``change`` s.

    Args:
        overlap: T_c [s], at most t2 + t3.
        t2: Longer filter time [s].
        t3: Shorter filter time [s].
        change: `corner_speed`.
    """
    return change * rise_way(t2, t3, 0.5 * overlap)


@njit(cache=True, error_model="numpy")
def contour_error(overlap: float, t2: float, t3: float, change: float, cosine: float) -> float:
    """Distance from the polyline likewise: the vertex error times the cosine of half the turn."""
    return vertex_error(overlap, t2, t3, change) * math.sqrt(max(0.5 * (1.0 + cosine), 0.0))


@njit(cache=True, error_model="numpy")
def corner_overlap(tolerance: float, change: float, b1: float, c1: float, b2: float, c2: float) -> float:
    """Longest overlap whose vertex error is within a tolerance (paper 4, eq. 13, for unlike filters too) [s].

    Args:
        tolerance: Of the tip [m] or the axis [rad].
        change: `corner_speed` [m/s] or [rad/s].
        b1: Longer filter time before the corner [s].
        c1: Shorter filter time before it [s].
        b2: Longer filter time after it [s].
        c2: Shorter filter time after it [s].

    Returns:
        At most the shorter of b1 + c1 and b2 + c2, beyond which speeds would add up on a straight path.
    """
    whole = min(b1 + c1, b2 + c2)
    if change <= 0.0:
        return whole
    way = tolerance / change
    return min(whole, rise_time(b1, c1, way) + rise_time(b2, c2, way))
