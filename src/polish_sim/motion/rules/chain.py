"""The way points as a chain of segments, each a straight line of the tip and one turn of the tool."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, chord_lengths, norms, unit
from polish_sim.errors import SmoothingError, place_in_mm
from polish_sim.kernel_cache import njit
from polish_sim.kernels import cross, dot, minus, scaled, set_to, turn_about
from polish_sim.spatial import no_rotations, steady_rotations


class Chain(NamedTuple):
    """n segments between n + 1 way points, in one frame; arrays a compiled kernel can take.

    At progress u in [0, 1] of segment k the tip is at ``tips[k] + u lengths[k] directions[k]`` and the tool
    at ``exp(u angles[k] turn_axes[k]) R_start[k] exp(u rolls[k] z)``: the tool axis runs along a great circle
    at constant rate (paper 4, eq. 11), the roll about it is shared out evenly.
    """

    tips: Array  #: Way points [m], shape (n + 1, 3)
    axes: Array  #: Unit tool axes at the way points, pointing into the part (tool z), shape (n + 1, 3)
    rotations: Array  #: Tool frames at the way points, third column the axis, shape (n + 1, 3, 3)
    lengths: Array  #: [m], shape (n,)
    directions: Array  #: Unit directions of the tip; zero where the length is, shape (n, 3)
    angles: Array  #: Angle the tool axis turns by [rad], in [0, pi), shape (n,)
    #: Unit axis it turns about, square to both ends' tool axes; zero where the angle is, shape (n, 3)
    turn_axes: Array
    rolls: Array  #: Turn about the tool axis that is left to the next way point's frame [rad], shape (n,)


SAME_PLACE = 1e-14  #: Way points closer than this are one [m]: rounding of lengths of the size of a robot
SAME_AXIS = 1e-13  #: Tool axes closer than this are one [rad]
HALF_TURN = math.pi - 1e-6  #: A turn of the tool axis beyond this has no plane of its own [rad]


def build_chain(tips: Array, rotations: Array) -> Chain:
    """Join way points (m, 3) [m] with tool frames (m, 3, 3), third column the axis into the part, to a chain.

    Repeated points (tip and tool axis the same) are left out: it goes through
    ``~repeated_points(tips, rotations)``.

    Raises:
        SmoothingError: Wrong shapes, values that are not finite, no rotations, or a tool axis that turns by
            180 deg.
    """
    tips, rotations = np.ascontiguousarray(tips, dtype=float), np.ascontiguousarray(rotations, dtype=float)
    _check(tips, rotations)
    kept = ~repeated_points(tips, rotations)
    tips, rotations = tips[kept], rotations[kept]
    axes = unit(rotations[:, :, 2])
    n = len(tips) - 1
    chain = Chain(tips, axes, rotations, *(np.zeros(shape) for shape in (n, (n, 3), n, (n, 3), n)))
    _fill_segments(chain)
    if n and chain.angles.max() > HALF_TURN:
        k, raw = int(chain.angles.argmax()), np.flatnonzero(kept)
        raise SmoothingError(
            f"the tool axis turns by 180 deg between {place_in_mm(tips[k])} and {place_in_mm(tips[k + 1])} "
            f"(way points {raw[k]} and {raw[k + 1]}, counted from 0): "
            "which way round is not given. Put a way point between them."
        )
    return chain


def chain_from_axes(tips: Array, axes: Array) -> Chain:
    """Join way points (m, 3) [m] of a round tool with axes (m, 3) into the part: its frames turn about them
    least.

    The tool's x axis stays near that axis of the frame the points are in which suits all best.

    Raises:
        SmoothingError: As `build_chain`; an axis of no length; axes that point along x, y and z.
    """
    axes = np.asarray(axes, dtype=float)
    if axes.ndim != 2 or axes.shape[1:] != (3,):
        raise SmoothingError(f"tool axes have shape {axes.shape}; (m, 3) is needed.")
    sizes = norms(axes)
    if not np.all(sizes > 1e-9):
        raise SmoothingError(
            f"the tool axis of way point {int(np.argmin(sizes > 1e-9))} (counted from 0) is zero."
        )
    directions = axes / sizes[:, None]
    rotations = steady_rotations(directions)
    if rotations is None:
        raise SmoothingError(
            "tool axes point along x, y and z: no steady frame suits them all; give tool frames."
        )
    return build_chain(tips, rotations)


def part_of(chain: Chain, rows: slice) -> Chain:
    """Some neighbouring segments of a chain."""
    points = slice(rows.start, rows.stop + 1)
    return Chain(*(array[points] for array in chain[:3]), *(array[rows] for array in chain[3:]))


def repeated_points(tips: Array, rotations: Array) -> Bools:
    """Which way points repeat the one before them, in tip and tool axis, shape (m,); a turn about the axis is
    kept for the next one."""
    axes = unit(np.asarray(rotations, dtype=float)[:, :, 2])
    moved = chord_lengths(tips) > SAME_PLACE
    turned = chord_lengths(axes) > SAME_AXIS
    repeated: Bools = np.concatenate([[False], ~(moved | turned)])
    return repeated


def _check(tips: Array, rotations: Array) -> None:
    if tips.ndim != 2 or tips.shape[1:] != (3,) or rotations.shape != (len(tips), 3, 3) or len(tips) == 0:
        raise SmoothingError(
            f"way points have shape {tips.shape}, tool frames {rotations.shape}; (m, 3) and (m, 3, 3) are "
            "needed."
        )
    finite = np.isfinite(tips).all(axis=1) & np.isfinite(rotations).all(axis=(1, 2))
    if not finite.all():
        raise SmoothingError(
            f"way point {int(np.argmin(finite))} (counted from 0) holds a value that is not finite."
        )
    skewed = no_rotations(rotations, 1e-6)
    if skewed.any():
        raise SmoothingError(
            f"the tool frame of way point {int(np.argmax(skewed))} (counted from 0) is no rotation."
        )


@njit
def _fill_segments(chain: Chain) -> None:
    """Write length, direction, angle, turn axis and roll of every segment from its two way points."""
    for k in range(chain.lengths.shape[0]):
        direction = chain.directions[k]
        set_to(direction, minus(chain.tips[k + 1], chain.tips[k]))
        length = math.sqrt(dot(direction, direction))
        chain.lengths[k] = length if length > SAME_PLACE else 0.0
        for i in range(3):
            direction[i] = direction[i] / length if length > SAME_PLACE else 0.0
        _fill_turn(chain, k)
        chain.rolls[k] = _roll(chain, k)


@njit(inline="always")
def _fill_turn(chain: Chain, k: int) -> None:
    """Angle and axis between both ends' tool axes."""
    a, b, n = chain.axes[k], chain.axes[k + 1], chain.turn_axes[k]
    # From the difference, square to their middle by construction: accurate for the smallest turns.
    set_to(n, cross(a, minus(b, a)))
    sine = math.sqrt(dot(n, n))
    angle = math.atan2(sine, dot(a, b))
    chain.angles[k] = angle if angle > SAME_AXIS else 0.0
    for i in range(3):
        n[i] = n[i] / sine if angle > SAME_AXIS else 0.0


@njit(inline="always")
def _roll(chain: Chain, k: int) -> float:
    """Turn about the tool axis left to the next frame once the axis is there [rad]."""
    n, angle = chain.turn_axes[k], chain.angles[k]
    start, end = chain.rotations[k], chain.rotations[k + 1]
    cosine, sine = math.cos(angle), math.sin(angle)
    x = turn_about(n, cosine, sine, 1.0 - cosine, start[:, 0])
    y = turn_about(n, cosine, sine, 1.0 - cosine, start[:, 1])
    return math.atan2(dot(y, end[:, 0]) - dot(x, end[:, 1]), dot(x, end[:, 0]) + dot(y, end[:, 1]))


@njit
def tip_distance(raw: Chain, first: int, stop: int, tip: Array) -> float:
    """Distance of a point to segments ``first`` to ``stop - 1`` [m]."""
    best = np.inf
    for k in range(first, stop):
        offset = minus(tip, raw.tips[k])
        d = raw.directions[k]
        aside = minus(offset, scaled(min(max(dot(offset, d), 0.0), raw.lengths[k]), d))
        best = min(best, dot(aside, aside))
    return math.sqrt(best)


@njit
def axis_distance(raw: Chain, first: int, stop: int, axis: Array) -> float:
    """Angle of a unit axis to the arcs of segments ``first`` to ``stop - 1`` [rad]."""
    best = np.inf
    for k in range(first, stop):
        best = min(best, angle_between(raw.axes[k], axis), angle_between(raw.axes[k + 1], axis))
        n, a = raw.turn_axes[k], raw.axes[k]
        x, y = dot(axis, a), dot(axis, cross(n, a))
        if raw.angles[k] > 0.0 and 0.0 <= math.atan2(y, x) <= raw.angles[k]:
            out = dot(axis, n)
            best = min(best, abs(math.atan2(out, math.sqrt(x * x + y * y))))
    return best


@njit
def angle_between(a: Array, b: Array) -> float:
    """Angle of two unit vectors [rad], accurate near zero too."""
    across = cross(a, b)
    return math.atan2(math.sqrt(dot(across, across)), dot(a, b))
