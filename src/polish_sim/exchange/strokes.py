"""A path as a robot runs it: come down, press along, go up, once per stroke (ToolPath -> strokes)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import PlanError
from polish_sim.planning.toolpath import LEAD_OUT, RETRACT, ToolPath

Rows = NDArray[np.int64]


class StrokeRows(NamedTuple):
    """Rows of one stretch in contact and of the ways to it and from it; the ways may be empty."""

    down: Rows
    contact: Rows
    up: Rows


def strokes_of(path: ToolPath) -> list[StrokeRows]:
    """Split a path where the tool leaves the part.

    Raises:
        PlanError: The path has no point in contact, or a stroke of one point.
    """
    pressed = np.flatnonzero(path.process)
    if not len(pressed):
        raise PlanError("the path has no process point: nothing to press on. Plan it again.")
    pieces = np.split(pressed, np.flatnonzero(np.diff(pressed) > 1) + 1)
    strokes, free = [], 0
    for number, contact in enumerate(pieces):
        if len(contact) < 2:
            raise PlanError(f"stroke {number + 1} of the path is a single point: there is nothing to run along.")
        follow = int(pieces[number + 1][0]) if number + 1 < len(pieces) else len(path.s)
        after = np.arange(contact[-1] + 1, follow)
        leaving = np.isin(path.segment[after], (LEAD_OUT, RETRACT))
        last = int(leaving.argmin()) if not leaving.all() else len(after)
        strokes.append(StrokeRows(np.arange(free, contact[0]), contact, after[:last]))
        free = int(contact[-1]) + 1 + last
    return strokes
