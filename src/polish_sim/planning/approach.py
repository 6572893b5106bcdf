"""How the tool comes to the part and leaves it: lead-in, lead-out, approach and retract (paper 1, 1.4, fig. 14)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curve import unit
from polish_sim.planning.toolpath import APPROACH, LEAD_IN, LEAD_OUT, PROCESS, RETRACT

Array = NDArray[np.float64]

LEAD_SHARE = 1.0 / 3.0
"""Height of the lead-in as a share of the clearance."""
RAMP = np.radians(20.0)
"""Angle of the tangent lead-in to the surface [rad]."""
SPACING_M = 1e-3

LeadShape = Callable[[float], Array]
"""Maps a height [m] to points (distance back along the path, height above the part) [m], shape (n, 2), top first."""


class Move(NamedTuple):
    """A piece of the tool path in one segment."""

    positions: Array
    """Tool points [m], shape (n, 3)."""
    axes: Array
    """Unit tool axes, shape (n, 3)."""
    segment: int
    pass_index: NDArray[np.int64]


def normal_lead(height: float) -> Array:
    """Straight down along the tool axis: the tool never touches the part sideways."""
    down = _even(height, 0.0, height)
    return np.stack([np.zeros_like(down), down], axis=1)


def tangent_lead(height: float) -> Array:
    """A shallow ramp along the path."""
    down = _even(height, 0.0, height / np.sin(RAMP))
    return np.stack([down / np.tan(RAMP), down], axis=1)


def arc_lead(height: float) -> Array:
    """A quarter circle that ends along the path."""
    angle = _even(0.5 * np.pi, 0.0, 0.5 * np.pi * height)
    return height * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)


LEADS: Final[Mapping[str, LeadShape]] = {"normal": normal_lead, "tangent": tangent_lead, "arc": arc_lead}


def with_leads(process: Move, shape: LeadShape, clearance: float) -> list[Move]:
    """Put approach and lead-in before a process move and lead-out and retract after it.

    Args:
        process: Points in contact.
        shape: How the tool lands; it leaves the same way, mirrored.
        clearance: Height of the first and last point above the part along the tool axis [m].

    Returns:
        The five moves in order.
    """
    height = LEAD_SHARE * clearance
    profile = shape(height)[:-1]
    rise = _even(clearance, height, clearance - height)[:-1]
    above = np.stack([np.full_like(rise, profile[0, 0]), rise], axis=1)
    moves = [process]
    for end, outward, codes in ((0, 1, (LEAD_IN, APPROACH)), (-1, -1, (LEAD_OUT, RETRACT))):
        inner = process.positions[1 if end == 0 else -2]
        back = unit((process.positions[end] - inner)[None])[0]
        axis = process.axes[end]
        back = unit((back - axis * (back @ axis))[None])[0]
        for points, code in ((profile, codes[0]), (above, codes[1])):
            line = process.positions[end] + points[:, :1] * back + points[:, 1:] * axis
            move = Move(
                line[::outward],
                np.tile(axis, (len(line), 1)),
                code,
                np.full(len(line), process.pass_index[end]),
            )
            moves = [move, *moves] if outward == 1 else [*moves, move]
    return moves


def travel(first: Move, second: Move, up: Array, safe_height: float) -> Move:
    """Carry the lifted tool from one run to the next above everything in between.

    Args:
        first: The retract that ends the first run.
        second: The approach that begins the second.
        up: Unit vector away from the table, shape (3,).
        safe_height: Height along ``up`` the tool travels at [m].

    Returns:
        The points between, as approach to the second run.
    """
    start, end = first.positions[-1], second.positions[0]
    corners = [start]
    corners += [p + up * max(safe_height - float(p @ up), 0.0) for p in (start, end)]
    corners.append(end)
    legs = [_even_line(a, b) for a, b in pairwise(corners)]
    line = np.concatenate([leg[1:] for leg in legs])[:-1]
    share = np.linspace(0.0, 1.0, len(line) + 2)[1:-1, None]
    axes = unit((1.0 - share) * first.axes[-1] + share * second.axes[0])
    return Move(line, axes, APPROACH, np.full(len(line), second.pass_index[0]))


def process_move(positions: Array, axes: Array, pass_index: NDArray[np.int64]) -> Move:
    """Points in contact as a move."""
    return Move(positions, axes, PROCESS, pass_index)


def concatenate(moves: Sequence[Move]) -> tuple[Array, Array, NDArray[np.int8], NDArray[np.int64]]:
    """Positions, axes, segment codes and pass indices of all moves in a row."""
    return (
        np.concatenate([move.positions for move in moves]),
        np.concatenate([move.axes for move in moves]),
        np.concatenate([np.full(len(move.positions), move.segment, dtype=np.int8) for move in moves]),
        np.concatenate([move.pass_index for move in moves]),
    )


def _even(first: float, last: float, length: float) -> Array:
    """Values from first to last, about `SPACING_M` apart over a length."""
    return np.linspace(first, last, max(int(np.ceil(length / SPACING_M)), 2) + 1)


def _even_line(first: Array, last: Array) -> Array:
    length = float(np.linalg.norm(last - first))
    if length < 1e-9:
        return first[None]
    return first + _even(0.0, 1.0, length)[:, None] * (last - first)
