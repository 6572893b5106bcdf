"""Which lead-in and lead-out a stroke gets: the one asked for where it keeps clear of the part (Move -> LeadShape)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import place_in_mm
from polish_sim.geometry import Surface
from polish_sim.geometry.distance.signed_distance import signed_distances
from polish_sim.planning.moves.approach import LEADS, LeadShape, Move, landing, normal_lead
from polish_sim.planning.moves.obstacle import rim_depths
from polish_sim.planning.moves.way_out import Ball, ball_around, height_to_keep, way_out
from polish_sim.planning.toolpath import arc_length

Array = NDArray[np.float64]

TOLERANCE_M = 2e-4
"""On its lead the pad may stand this much deeper in the part than where it lands [m]."""
APART_M = 3e-4
"""On its lead the tool point keeps this far from the part, nearer to it half its height above where it lands [m]."""
ROUNDING_M = 1e-9
LOWER = (1.0, 0.5, 0.25, 0.12)
"""Shares of the clearance from which a straight lead begins, tried in this order."""
FURTHER = 14
"""So many points further along are tried as the end of a stroke."""
NEAR = 3
"""So many of them only to keep the pad's rim clear."""
LONGEST_CUT = 0.45
"""No end of a stroke is shortened by more than this share of it."""


class Remark(NamedTuple):
    """Something the user should know, and where."""

    what: str
    place: Array
    """[m], shape (3,)."""


class Air(NamedTuple):
    """What the lifted tool must keep clear of."""

    part: Surface
    """The whole part."""
    pad_radius: float
    """[m]; 0 looks at the tool point only."""
    clearance: float
    """Height of a lifted tool above the part along its axis [m]."""
    up: Array
    """Unit vector away from the table, shape (3,)."""


class Landing(NamedTuple):
    """How a stroke begins or ends."""

    shape: LeadShape
    clearance: float
    """Height it begins from [m]."""
    row: int
    """Point of the stroke at which the tool lands or leaves."""
    remark: Remark | None
    """What is not as asked."""


class ChosenLeads(NamedTuple):
    """How a stroke begins and ends."""

    start: Landing
    end: Landing

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What is not as asked."""
        return tuple(landing.remark for landing in self if landing.remark is not None)


def choose_leads(process: Move, name: str, air: Air, stepover: float) -> ChosenLeads | None:
    """Keep the lead asked for unless the pad would run into the part on it; then come straight along the axis.

    A pad on a hollow already stands in the part with its rim where it presses, and next to a wall it does so on any
    lead: a lead hits when the pad stands deeper on it, or on the straight way above it, than where it touches down.
    Where even the straight lead hits, it begins lower; where that hits too, the stroke is shortened. The tool point
    itself never enters the part, and it can always come from outside in a straight line.

    Args:
        process: Points in contact.
        name: The lead asked for, one of `LEADS`.
        air: What to keep clear of.
        stepover: Steps in which a stroke is shortened [m].

    Returns:
        The leads; None if the tool can land on no part of the stroke, or leave from none.
    """
    ball = ball_around(air.part, air.clearance)
    start, end = (_choose(process, at_start, name, air, ball, stepover) for at_start in (True, False))
    if start is None or end is None or end.row - start.row < 1:
        return None
    return ChosenLeads(start, end)


def _choose(process: Move, at_start: bool, name: str, air: Air, ball: Ball, stepover: float) -> Landing | None:
    """The first landing that is clear: as asked, straight, from lower, further along; last with the pad in a wall."""
    word = "lead-in" if at_start else "lead-out"
    rows = _rows_along(process, at_start, stepover)
    straight: list[tuple[LeadShape, float]] = [(normal_lead, share * air.clearance) for share in LOWER]
    point_only = air._replace(pad_radius=0.0)
    last = 0 if at_start else len(process.positions) - 1
    tries: list[tuple[Air, list[tuple[LeadShape, float]], list[int], str]] = [
        (air, [(LEADS[name], air.clearance)], [last], ""),
        (air, straight[:1], [last], f"the {name} {word} would run into the part, it goes straight along the tool axis"),
        (air, straight[1:], [last], f"there is no room for a {word} of the clearance asked for, it is lower"),
        (air, straight, rows[:NEAR], f"a stroke is shortened to where its {word} is clear of the part"),
        (point_only, straight, [last], f"even straight along the tool axis the pad runs into the part on the {word}"),
        (point_only, straight, rows, f"a stroke is shortened to where its {word} is clear of the part"),
    ]
    for around, shapes, where, told in tries:
        for row in where:
            for shape, clearance in shapes:
                cut = _from(process, at_start, row)
                if _is_clear(cut, at_start, shape, clearance, around, ball):
                    place = process.positions[last]
                    return Landing(shape, clearance, row, Remark(told, place) if told else None)
    return None


def _rows_along(process: Move, at_start: bool, stepover: float) -> list[int]:
    """Points of a stroke further and further from its end: half a step-over, then always half as far again."""
    s = arc_length(process.positions)
    away = 0.5 * stepover * 1.5 ** np.arange(FURTHER)
    away = away[away < LONGEST_CUT * s[-1]]
    rows = np.searchsorted(s, away) if at_start else np.searchsorted(s, s[-1] - away, side="right") - 1
    return [int(row) for row in rows if 0 < row < len(s) - 1]


def _from(process: Move, at_start: bool, row: int) -> Move:
    """A stroke that begins or ends at one of its points."""
    kept = np.s_[row:] if at_start else np.s_[: row + 1]
    return process._replace(
        positions=process.positions[kept], axes=process.axes[kept], pass_index=process.pass_index[kept]
    )


def _is_clear(process: Move, at_start: bool, shape: LeadShape, clearance: float, air: Air, ball: Ball) -> bool:
    """Whether neither the lead nor the way out from it runs into the part."""
    end = slice(0, 1) if at_start else slice(-1, None)
    landed = float(rim_depths(air.part, process.positions[end], process.axes[end], air.pad_radius)[0])
    lead, above = landing(process, at_start, shape, clearance)
    line = np.concatenate([lead.positions, above.positions])
    axes = np.concatenate([lead.axes, above.axes])
    up = np.abs(((line - process.positions[end]) * process.axes[end]).sum(axis=1))
    if (signed_distances(air.part, line) < np.minimum(0.5 * up, APART_M) - ROUNDING_M).any():
        return False
    if rim_depths(air.part, line, axes, air.pad_radius).max() > landed + TOLERANCE_M:
        return False
    top = above.positions[0 if at_start else -1]
    kept = height_to_keep(air.part, top[None], air.clearance)
    return way_out(air.part, ball, top, process.axes[end][0], air.up, kept) is not None


def notes_of(remarks: Sequence[Remark]) -> tuple[str, ...]:
    """Remarks as sentences: the same ones together, with the first place."""
    places: dict[str, list[Array]] = {}
    for remark in remarks:
        places.setdefault(remark.what, []).append(remark.place)
    out = []
    for what, where in places.items():
        more = f" and {len(where) - 1} more places" if len(where) > 1 else ""
        out.append(f"{what}: at {place_in_mm(where[0])}{more}")
    return tuple(out)
