"""How the tool comes to the part and leaves it: lead-in, lead-out, approach and retract (paper 1, 1.4, fig. 14)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.toolpath import APPROACH, LEAD_IN, LEAD_OUT, PROCESS, RETRACT
from polish_sim.spatial import unit

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
    down = evenly(height, 0.0, height)
    return np.stack([np.zeros_like(down), down], axis=1)


def tangent_lead(height: float) -> Array:
    """A shallow ramp along the path."""
    down = evenly(height, 0.0, height / np.sin(RAMP))
    return np.stack([down / np.tan(RAMP), down], axis=1)


def arc_lead(height: float) -> Array:
    """A quarter circle that ends along the path."""
    angle = evenly(0.5 * np.pi, 0.0, 0.5 * np.pi * height)
    return height * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)


LEADS: Final[Mapping[str, LeadShape]] = {"normal": normal_lead, "tangent": tangent_lead, "arc": arc_lead}


def with_leads(
    process: Move,
    shape: LeadShape,
    clearance: float,
    shape_out: LeadShape | None = None,
    clearance_out: float | None = None,
) -> list[Move]:
    """Put approach and lead-in before a process move and lead-out and retract after it.

    Args:
        process: Points in contact.
        shape: How the tool lands.
        clearance: Height of the first point, and of the last, above the part along the tool axis [m].
        shape_out: How it leaves, mirrored; as it lands if not given.
        clearance_out: Height of the last point [m]; that of the first if not given.

    Returns:
        The five moves in order.
    """
    lead_in, approach = landing(process, True, shape, clearance)
    lead_out, retract = landing(process, False, shape_out or shape, clearance_out or clearance)
    return [approach, lead_in, process, lead_out, retract]


def landing(process: Move, at_start: bool, shape: LeadShape, clearance: float) -> tuple[Move, Move]:
    """The lead at one end of a process move and the straight way above it, in the order they are walked.

    Args:
        process: Points in contact.
        at_start: Whether the tool lands there; else it leaves.
        shape: Shape of the lead.
        clearance: Height of the furthest point above the part along the tool axis [m].

    Returns:
        The lead, which keeps the tool axis of its end, and the approach or retract.
    """
    height = LEAD_SHARE * clearance
    profile = shape(height)[:-1]
    rise = evenly(clearance, height, clearance - height)[:-1]
    above = np.stack([np.full_like(rise, profile[0, 0]), rise], axis=1)
    end, inner, codes = (0, 1, (LEAD_IN, APPROACH)) if at_start else (-1, -2, (LEAD_OUT, RETRACT))
    axis = process.axes[end]
    back = process.positions[end] - process.positions[inner]
    back = unit(back - axis * (back @ axis))
    moves = []
    for points, code in ((profile, codes[0]), (above, codes[1])):
        line = process.positions[end] + points[:, :1] * back + points[:, 1:] * axis
        line = line if at_start else line[::-1]
        turn = np.full(len(line), process.pass_index[end])
        moves.append(Move(line, np.tile(axis, (len(line), 1)), code, turn))
    return moves[0], moves[1]


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


def evenly(first: float, last: float, length: float) -> Array:
    """Values from first to last, about `SPACING_M` apart over a length."""
    return np.linspace(first, last, max(int(np.ceil(length / SPACING_M)), 2) + 1)
