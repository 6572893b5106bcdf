"""Slight bends inside a line: turned through without a change of the line's speed.

Chords that follow one another with small turns are strung into one line with a single law of time s(t), which may
accelerate through the bends. At a bend the tip leaves the old chord at rate s' - g and enters the new one at rate g:
with t1, t2 the old and the new chord's directions, tip'' = s'' t1 + g' (t2 - t1) and so on. Over a time T about the
vertex g grows from nothing to s' as two parabolas, so only the share g'' |t2 - t1| of the jerk goes into the turn. Part
of every limit is kept for the law along the line, the rest is left to the bends.

The plain kernel of a corner has the same two parabolas with the speed falling to zero: slower than the shapes of the
table, but it takes much less of both segments.
"""

from __future__ import annotations

import math

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.connector import Ends, Peaks, connector_time
from polish_sim.motion.certified.kernel import Corner, Figures, Kernel, Side, set_cubic
from polish_sim.motion.certified.window import MOST_STRUNG, Lines, Segments, peaks_of

LINE_SHARE = 0.8  #: Share of acceleration and jerk limits that the law along a bent line may use
_BULGE = 1.15 / 12.0
"""What remains of the old chord at the vertex, as a share of the bend's length: 1/12 at constant speed, and a margin
for speed that changes."""
_NEAR_FULL = 0.9  #: A bend passed at this share of full speed does not hold a line up
_OVER_STOPS = 1.5  #: Else it must be passed at this multiple of the mean speed from stop to stop on either side
_ROUNDING = 1.0 - 1e-9


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _turn_size(side: Side) -> float:
    """|t2 - t1| of tip or axis per generalised length."""
    one, two = side.first, side.second
    return math.sqrt(max(one * one + two * two - 2.0 * one * two * side.cosine, 0.0))


@njit(cache=True, error_model="numpy", _nrt=False)
def off_line(side: Side) -> float:
    """Distance from the nearer chord per remaining generalised length, at most; on a sphere for the axis."""
    if side.first == 0.0 or side.second == 0.0:
        return 0.0
    if side.is_axis:
        return min(math.sqrt(max(2.0 - 2.0 * side.cosine, 0.0)), 1.0) * max(side.first, side.second)
    return math.sqrt(max(1.0 - side.cosine * side.cosine, 0.0)) * max(side.first, side.second)


@njit(cache=True, error_model="numpy", _nrt=False)
def _greatest_turning(side: Side, limit: float) -> float:
    """Largest |g''| or |g'| within a limit on tip or axis, beside LINE_SHARE of it along either chord."""
    turn, longer = _turn_size(side), max(side.first, side.second)
    if turn <= 1e-12 * longer:
        return _ratio(limit, turn)
    product = side.first * side.second * side.cosine
    along = max(abs(product - side.first**2), abs(side.second**2 - product)) / (turn * longer)
    mixed = LINE_SHARE * min(along, 1.0)
    return (math.sqrt(mixed * mixed + 1.0 - LINE_SHARE * LINE_SHARE) - mixed) * limit / turn


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _ratio(limit: float, share: float) -> float:
    return limit / share if share > 0.0 else math.inf


@njit(cache=True, error_model="numpy", _nrt=False)
def plan_bend(corner: Corner, bend: Array) -> None:
    """Write the length [m] of the longest bend within the tolerances, and the speed it allows [m/s]."""
    tip, axis, along = corner.tip, corner.axis, corner.along
    length = min(corner.spans[0], corner.spans[1], _ratio(tip.tolerance, _BULGE * off_line(tip)))
    length = min(length, _ratio(axis.tolerance, _BULGE * off_line(axis)))
    jerk = min(_greatest_turning(tip, tip.limits.jerk), _greatest_turning(axis, axis.limits.jerk))
    acceleration = min(
        _greatest_turning(tip, tip.limits.acceleration), _greatest_turning(axis, axis.limits.acceleration)
    )
    line = LINE_SHARE * along.acceleration
    speed = _bend_speed(length, jerk - 0.5 * LINE_SHARE * along.jerk, acceleration - 0.5 * line, line)
    bend[0], bend[1] = length, min(speed, along.speed)


@njit(cache=True, error_model="numpy", _nrt=False)
def _bend_speed(length: float, jerk: float, acceleration: float, along: float) -> float:
    """Greatest v with 4 v^3 / l^2 + a v / l <= jerk and 2 v^2 / l <= acceleration; a: the line's acceleration."""
    if length <= 0.0 or not (jerk > 0.0 and acceleration > 0.0):
        return 0.0
    if math.isinf(jerk) and math.isinf(acceleration):
        return math.inf
    square, steady = 4.0 / (length * length), along / length
    v = (jerk / square) ** (1.0 / 3.0)
    for _ in range(8):
        v -= (v * (square * v * v + steady) - jerk) / (3.0 * square * v * v + steady)
    return min(v * (1.0 - 1e-9), math.sqrt(0.5 * acceleration * length))


@njit(cache=True, error_model="numpy", _nrt=False)
def plain_kernel(corner: Corner) -> Figures:
    """The largest plain kernel within limits and tolerances of tip and axis, its jerk as high as they allow."""
    tip, axis, speed = corner.tip, corner.axis, corner.along.speed
    tip_turn, axis_turn = _turn_size(tip), _turn_size(axis)
    jerk = min(_ratio(tip.limits.jerk, tip_turn), _ratio(axis.limits.jerk, axis_turn))
    acceleration = min(_ratio(tip.limits.acceleration, tip_turn), _ratio(axis.limits.acceleration, axis_turn))
    bulge = min(_ratio(tip.tolerance, off_line(tip)), _ratio(axis.tolerance, off_line(axis)))
    if math.isinf(jerk):
        return Figures(0.0, speed * _ROUNDING, 0.0, 0.0)
    # At its middle a = b = j T^3 / 48, the acceleration's peak is j T / 2 and v = j T^2 / 4.
    T = min((48.0 * bulge / jerk) ** (1.0 / 3.0), 2.0 * acceleration / jerk, 2.0 * math.sqrt(speed / jerk)) * _ROUNDING
    v = 0.25 * jerk * T * T
    return Figures(0.5 * v * T, v, 0.0, T)


@njit(cache=True, error_model="numpy", _nrt=False)
def fill_plain(size: float, speed: float, kernel: Kernel) -> None:
    """Write the pieces of the plain kernel of a size and a speed."""
    half = size / speed
    jerk = speed / (half * half)
    cube = jerk * half**3 / 6.0
    kernel.durations[:2], kernel.durations[2:] = half, 0.0
    set_cubic(kernel.remaining[0], size, -speed, 0.0, jerk)
    set_cubic(kernel.remaining[1], cube, -0.5 * speed, jerk * half, -jerk)
    set_cubic(kernel.gone[0], 0.0, 0.0, 0.0, jerk)
    set_cubic(kernel.gone[1], cube, 0.5 * speed, jerk * half, -jerk)


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def may_string(segments: Segments, lines: Lines, line: int, k: int) -> bool:
    """Whether segment ``k`` joins the open line: a short one on either side, and a bend that holds nothing up."""
    first, bend = lines.first[line], segments.bends[k, 1]
    if k - first >= MOST_STRUNG or bend <= 0.0:
        return False
    old, new = peaks_of(segments.limits, k - 1), peaks_of(segments.limits, k)
    if min(segments.spans[k - 1], segments.spans[k]) > 2.0 * _braking_way(old):
        return False
    # A line has one speed: only alike parts are strung; its first bend sets it.
    if not _alike(new.speed, old.speed) or (k - first > 1 and not _alike(min(bend, new.speed), lines.limits[line, 0])):
        return False
    if bend >= _NEAR_FULL * min(old.speed, new.speed):
        return True
    one, two, rest = segments.spans[k - 1], segments.spans[k], Ends(0.0, 0.0, 0.0, 0.0)
    return bend > _OVER_STOPS * max(one / connector_time(rest, one, old), two / connector_time(rest, two, new))


@njit(cache=True, error_model="numpy", _nrt=False)
def _braking_way(limits: Peaks) -> float:
    """Distance from full speed to rest [m]."""
    v, a, j = limits.speed, limits.acceleration, limits.jerk
    return v * math.sqrt(v / j) if v * j <= a * a else 0.5 * v * (v / a + a / j)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _alike(first: float, second: float) -> bool:
    return min(first, second) >= _NEAR_FULL * max(first, second)


@njit(cache=True, error_model="numpy", _nrt=False)
def open_line(segments: Segments, lines: Lines, line: int, k: int) -> None:
    """Begin a line with segment ``k``."""
    lines.first[line] = k
    lines.spans[line] = segments.spans[k]
    for c in range(6):
        lines.limits[line, c] = segments.limits[k, c]


@njit(cache=True, error_model="numpy", _nrt=False)
def string_segment(segments: Segments, lines: Lines, line: int, k: int) -> None:
    """Go on with a line."""
    lines.spans[line] += segments.spans[k]
    lines.limits[line, 0] = min(lines.limits[line, 0], segments.bends[k, 1])
    for c in range(3):
        lines.limits[line, c] = min(lines.limits[line, c], segments.limits[k, c])


@njit(cache=True, error_model="numpy", _nrt=False)
def close_line(segments: Segments, lines: Lines, line: int, last: int) -> None:
    """End a line with segment ``last``."""
    first = lines.first[line]
    lines.first[line + 1] = last + 1
    lines.rooms[line, 0], lines.rooms[line, 1] = segments.spans[first], segments.spans[last]
    if last > first:
        # The other half of an end segment belongs to its bend.
        lines.rooms[line, 0] *= 0.5
        lines.rooms[line, 1] *= 0.5
        lines.limits[line, 1] *= LINE_SHARE
        lines.limits[line, 2] *= LINE_SHARE
        for c in range(3):
            lines.limits[line, 3 + c] = lines.limits[line, c]
