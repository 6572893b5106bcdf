"""Which lead-in and lead-out a stroke gets: the one asked for where it keeps clear of the part (Move -> LeadShape)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import place_in_mm
from polish_sim.geometry import Surface
from polish_sim.planning.moves.approach import LEADS, LeadShape, Move, landing, normal_lead
from polish_sim.planning.moves.obstacle import rim_depths

Array = NDArray[np.float64]

TOLERANCE_M = 2e-4
"""On its lead the pad may stand this much deeper in the part than where it lands [m]."""


class Remark(NamedTuple):
    """Something the user should know, and where."""

    what: str
    place: Array
    """[m], shape (3,)."""


class ChosenLeads(NamedTuple):
    """How a stroke begins and ends."""

    shape_in: LeadShape
    shape_out: LeadShape
    remarks: tuple[Remark, ...]
    """Where the lead asked for would have hit the part."""


def choose_leads(process: Move, name: str, clearance: float, part: Surface, pad_radius: float) -> ChosenLeads:
    """Keep the lead asked for unless the pad would run into the part on it; then come straight along the axis.

    A pad on a hollow already stands in the part with its rim where it presses, and next to a wall it does so on any
    lead: a lead hits when the pad stands deeper on it, or on the straight way above it, than where it touches down.

    Args:
        process: Points in contact.
        name: The lead asked for, one of `LEADS`.
        clearance: Height of the approach above the part [m].
        part: The whole part.
        pad_radius: [m]; 0 looks at the tool point only.

    Returns:
        The leads, and remarks.
    """
    shapes, remarks = [], []
    for at_start, word in ((True, "lead-in"), (False, "lead-out")):
        shape = LEADS[name]
        if not _clear(process, at_start, shape, clearance, part, pad_radius):
            what = f"even straight along the tool axis the {word} runs into the part"
            if shape is not normal_lead and _clear(process, at_start, normal_lead, clearance, part, pad_radius):
                what = f"the {name} {word} would run into the part, it goes straight along the tool axis"
            remarks.append(Remark(what, process.positions[0 if at_start else -1]))
            shape = normal_lead
        shapes.append(shape)
    return ChosenLeads(shapes[0], shapes[1], tuple(remarks))


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


def _clear(process: Move, at_start: bool, shape: LeadShape, clearance: float, part: Surface, pad_radius: float) -> bool:
    end = slice(0, 1) if at_start else slice(-1, None)
    landed = float(rim_depths(part, process.positions[end], process.axes[end], pad_radius)[0])
    lead, above = landing(process, at_start, shape, clearance)
    line = np.concatenate([lead.positions, above.positions])
    axes = np.concatenate([lead.axes, above.axes])
    return bool(rim_depths(part, line, axes, pad_radius).max() <= landed + TOLERANCE_M)
