"""The way points as a chain of segments, each a straight line of the tip and one turn of the tool."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    angles_between,
    chord_lengths,
    crosses,
    dots,
    foot_on_chord,
    norms,
    unit,
)
from polish_sim.errors import SmoothingError, place_in_mm
from polish_sim.spatial import no_rotations, rotations_from_vectors, steady_rotations


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
    axes, ways = unit(rotations[:, :, 2]), np.diff(tips, axis=0)
    ways[norms(ways) <= SAME_PLACE] = 0.0
    # From the difference, square to their middle by construction: accurate for the smallest turns.
    turns = crosses(axes[:-1], np.diff(axes, axis=0))
    angles = np.arctan2(norms(turns), dots(axes[:-1], axes[1:]))
    turns[angles <= SAME_AXIS] = angles[angles <= SAME_AXIS] = 0.0
    if angles.max(initial=0.0) > HALF_TURN:
        k, raw = int(angles.argmax()), np.flatnonzero(kept)
        raise SmoothingError(
            f"the tool axis turns by 180 deg between {place_in_mm(tips[k])} and {place_in_mm(tips[k + 1])} "
            f"(way points {raw[k]} and {raw[k + 1]}, counted from 0): "
            "which way round is not given. Put a way point between them."
        )
    turn_axes = unit(turns)
    arrived = rotations_from_vectors(angles[:, None] * turn_axes) @ rotations[:-1]
    left = arrived.swapaxes(1, 2) @ rotations[1:]
    rolls = np.arctan2(left[:, 1, 0] - left[:, 0, 1], left[:, 0, 0] + left[:, 1, 1])
    return Chain(tips, axes, rotations, norms(ways), unit(ways), angles, turn_axes, rolls)


def part_way(chain: Chain, k: Indices, share: Array) -> tuple[Array, Array]:
    """Tips (n, 3) [m] and tool frames (n, 3, 3) at shares (n, 1) of segments k (n,)."""
    turn = rotations_from_vectors(share * chain.angles[k, None] * chain.turn_axes[k])
    roll = rotations_from_vectors(share * chain.rolls[k, None] * np.array([0.0, 0.0, 1.0]))
    tips = chain.tips[k] + share * chain.lengths[k, None] * chain.directions[k]
    return tips, turn @ chain.rotations[k] @ roll


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


def tip_distances(raw: Chain, k: Indices, tips: Array) -> Array:
    """Distances of points (n, 3) to segments k (n,) [m], shape (n,)."""
    return foot_on_chord(tips - raw.tips[k], raw.lengths[k, None] * raw.directions[k])[1]


def axis_distances(raw: Chain, k: Indices, axes: Array) -> Array:
    """Angles of unit axes (n, 3) to the arcs of segments k (n,) [rad], shape (n,)."""
    a, n = raw.axes[k], raw.turn_axes[k]
    ends = np.minimum(angles_between(a, axes), angles_between(raw.axes[k + 1], axes))
    x, y, out = dots(axes, a), dots(axes, crosses(n, a)), dots(axes, n)
    along = np.arctan2(y, x)
    beside = (raw.angles[k] > 0.0) & (along >= 0.0) & (along <= raw.angles[k])
    return np.where(beside, np.minimum(ends, np.abs(np.arctan2(out, np.hypot(x, y)))), ends)
