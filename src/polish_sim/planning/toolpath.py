"""The tool path: what planning hands to motion, as read-only arrays in the work frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Bools, Indices, chord_lengths, evenly_to, running_sums
from polish_sim.errors import PlanError

SEGMENTS = ("approach", "lead_in", "process", "link", "lead_out", "retract")
APPROACH, LEAD_IN, PROCESS, LINK, LEAD_OUT, RETRACT = range(len(SEGMENTS))
BEFORE = "it was polished before (--from)"  #: Why the begin of a path is left out that is not lost by that


class ContactPoints(NamedTuple):
    """Points of a path at which the tool is on the part."""

    positions: Array  #: [m], shape (n, 3)
    axes: Array  #: Of the tool, shape (n, 3)


@dataclass(frozen=True)
class ToolPath:
    """The path of the tool point on the nominal surface, with lead-in and lead-out; not pressed into the
    part."""

    positions_work: Array  #: Tool point in the work frame [m], shape (n, 3)
    #: Unit tool axis from the part to the tool (the outward normal unless tilted), shape (n, 3)
    axes_work: Array
    s: Array  #: Arc length from the first point [m], strictly increasing, shape (n,)
    pass_index: Indices  #: Turn of the spiral or line of the raster the point belongs to, shape (n,)
    segment: NDArray[np.int8]  #: Code of the segment, an index into `SEGMENTS`, shape (n,)
    #: Normal curvature of the surface along the path [1/m], positive on a convex part, shape (n,)
    curvature: Array
    #: Contact force to hold at each point [N], shape (n,); None: as the process says
    force: Array | None = None
    feed: Array | None = None  #: Feed at each point [m/s], shape (n,); None: as the process says

    def __post_init__(self) -> None:
        n = len(self.positions_work)
        for name, array in self.columns.items():
            wanted = (n, 3) if name.endswith("_work") else (n,)
            if array.shape != wanted:
                raise PlanError(f"tool path: {name} has shape {array.shape}, expected {wanted}.")
            array.flags.writeable = False

    @property
    def columns(self) -> dict[str, Any]:
        """Its arrays by their names, force and feed only where it has them."""
        return {name: column for name, column in vars(self).items() if column is not None}

    def rows(self, kept: Bools | Indices) -> ToolPath:
        """The path of some of its points only, mask (n,) or numbers; arc lengths stay."""
        return ToolPath(**{name: column[kept] for name, column in self.columns.items()})

    def force_at(self, s: Array, usual: float) -> Array:
        """Force to hold at arc lengths [m], (k,) -> (k,) [N]; the usual one where the path names none."""
        return np.full(len(s), usual) if self.force is None else np.interp(s, self.s, self.force)

    def feeds(self, usual: float) -> Array:
        """Feed at the points [m/s], (n,); the usual one where the path names none."""
        return np.full(len(self.s), usual) if self.feed is None else self.feed

    def largest_force(self, usual: float) -> float:
        """The largest force to hold [N], which limits and part must bear; ``usual`` as of `force_at`."""
        return self.force_at(self.s[self.process], usual).max()

    @property
    def process(self) -> Bools:
        """Mask of the points at which the tool is pressed on the part, shape (n,)."""
        return (self.segment == PROCESS) | (self.segment == LINK)

    @property
    def in_contact(self) -> ContactPoints:
        """The points at which the tool is on the part."""
        return ContactPoints(self.positions_work[self.process], self.axes_work[self.process])

    def length_along(self, rows: Bools) -> float:
        """Length along some of its points, mask (n,): of the chords between two of them [m]."""
        return np.diff(self.s)[rows[1:] & rows[:-1]].sum()

    @property
    def length_m(self) -> float:
        """Length from the first point to the last [m]."""
        return self.s[-1]


def arc_length(positions: Array) -> Array:
    """Length of a polyline (n, 3) [m] from its first point, along its chords [m], shape (n,)."""
    return running_sums(chord_lengths(positions))


def rows_apart(s: Array, spacing: float) -> Indices:
    """Rows of growing arc lengths (n,) [m] no further apart than the points or a spacing, both ends among
    them."""
    marks = evenly_to(s[-1], spacing, 1, s[0])
    return np.unique([0, *np.searchsorted(s, marks[1:-1]), len(s) - 1])


def interpolate(where: Array, s: Array | Indices, columns: Array) -> Array:
    """Columns (n, k) given at growing ``s`` (n,), linearly in between, at places ``where`` (m,): shape (m,
    k)."""
    return np.stack([np.interp(where, s, column) for column in columns.T], axis=1)


def stretches(wanted: Bools) -> list[tuple[int, int]]:
    """First and last row of every run of true values, (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wanted, [False]])))
    return [(int(first), int(stop) - 1) for first, stop in edges.reshape(-1, 2)]


def pressed(path: ToolPath, depth: float | Array) -> ToolPath:
    """Move the process points into the part against the tool axis: D = F / k (paper 1, section 1.5).

    ``depth`` is D [m], positive into the part, one for all points or (n,). Lead-in and lead-out stay where
    they are.
    """
    moved = path.positions_work - np.where(path.process, depth, 0.0)[:, None] * path.axes_work
    return replace(path, positions_work=moved, s=arc_length(moved))
