"""Where every cm^2 of the region asked for is: polished, or left out for one reason (AskedRegion ->
AreaAccount)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Figures, Indices, next_corners, norms
from polish_sim.config import PadConfig
from polish_sim.errors import place_in_mm
from polish_sim.planning.ground import Ground

NARROW = "component narrower than half the pad"
MARGIN = "edge margin"
UNCOVERED = "not covered by the pattern"
BORDER = "at the border"
FAR = "further than a step-over from the path"
UNTOUCHED, UNPLAYED = "not touched when it was run", "not touched when it was played"
OVER = "; --overrun leads the pad beyond it"
SAME_M = 1e-6  #: Places this close are the same vertex [m]
WORTH_A_NOTE = 1e-3  #: A reason gets a note if it leaves out more than this share of the region


class CutOut(NamedTuple):
    """A stretch of a path, or a place of the region, that is not followed."""

    reason: str  #: Its row of the account
    positions: Array  #: Tool points [m], shape (k, 3)


@dataclass(frozen=True, eq=False)
class AskedRegion:
    """All of the region asked for, and what of it was left out before a path was planned."""

    ground: Ground  #: All of it, prepared
    reasons: tuple[str, ...] = ()
    why: Indices | int = -1  #: Number of each vertex's reason, -1: it may be polished, shape (v,) or of all
    touched: Array | float = 1.0  #: Share of each vertex's area that the pad can touch, shape (v,) or of all
    unreachable_m2: float = 0.0  #: The area it cannot touch
    #: Distance of each vertex from a path that was followed before [m], shape (v,) or of all
    before: Array | float = np.inf

    def without(self, out: Bools, reason: str) -> AskedRegion:
        """The same with some more vertices (v,) left out; an edge margin is under the pad all the same."""
        why = np.where(out & (self.why < 0), len(self.reasons), self.why)
        touched = self.touched if reason == MARGIN else np.where(out, 0.0, self.touched)
        return replace(self, reasons=(*self.reasons, reason), why=why, touched=touched)

    def after(self, whole: AreaAccount, begin: AreaAccount, reason: str) -> AskedRegion:
        """The same for the rest of a ``whole`` path: what its ``begin`` polishes may be left out for a
        reason."""
        why = np.where((whole.why < 0) & (begin.why < 0), len(whole.reasons), whole.why)
        return replace(self, reasons=(*whole.reasons, reason), why=why, before=whole.distances)

    @property
    def area_m2(self) -> float:
        """Area of the region asked for [m^2]."""
        return self.ground.region.area_m2

    @property
    def areas(self) -> Array:
        """What each vertex of the ground stands for, in all the region's area [m^2], shape (v,)."""
        flat = self.ground.part_areas
        return flat * (self.area_m2 / flat.sum())


class LeftOutRow(NamedTuple):
    """What is left out for one reason."""

    area_m2: float
    triangles: Array  #: [m], shape (t, 3, 3)
    place: Array  #: A place of it [m], shape (3,)


@dataclass(frozen=True, eq=False)
class AreaAccount:
    """The region's area in rows that add up to it."""

    region_m2: float
    polished_m2: float
    left_out: Mapping[str, LeftOutRow]  #: By reason, the largest first
    reasons: tuple[str, ...]
    why: Indices  #: Number of each vertex's reason, -1: it is polished, shape (v,)
    #: What is polished further than a step-over from the path, outside what was left out before
    far: LeftOutRow
    far_m: float  #: Distance of its place, the furthest, from the path [m]
    distances: Array  #: Of each polished vertex from the path [m], shape (v,)
    furthest: Array  #: Where they are largest [m], shape (3,)
    beside: bool  #: Whether stretches of the path run beside each other: else no step-over is its own

    @property
    def figures(self) -> dict[str, Any]:
        """The keys of metrics.json."""
        lost = {reason: row.area_m2 for reason, row in self.left_out.items()}
        return {
            **area_figures(self.region_m2, self.polished_m2, lost),
            "beyond_stepover_area_m2": self.far.area_m2,
            "furthest_from_path_m": self.distances.max(),
            "furthest_from_path_at_m": self.furthest.tolist(),
        }

    @property
    def notes(self) -> list[str]:
        """What is left out, why, and where; and what is polished far from the path."""
        found = [
            f"left out {1e4 * row.area_m2:.3g} cm^2 of the region, at {place_in_mm(row.place)} and about: "
            f"{reason}{OVER * (reason == BORDER)}"
            for reason, row in self.left_out.items()
            if row.area_m2 > WORTH_A_NOTE * self.region_m2
        ]
        if self.beside and self.far.area_m2 > 0.0:
            found.append(
                f"{FAR}: {1e4 * self.far.area_m2:.3g} cm^2 of what is polished, up to "
                f"{1e3 * self.far_m:.3g} mm at {place_in_mm(self.far.place)}. Only the pad's outer part "
                "polishes it: a turn there comes nearer or, where the tool has no room for one, a plan with "
                "a smaller --pad-diameter"
            )
        return found

    @property
    def marked(self) -> dict[str, Array]:
        """Triangles (t, 3, 3) [m] to show in a picture, by what they are."""
        out = {f"left out: {reason}": row.triangles for reason, row in self.left_out.items()}
        return out | {FAR: self.far.triangles}


def area_figures(region_m2: float, polished_m2: float, lost: Mapping[str, float]) -> Figures:
    """What metrics.json says of a region's area, polished and ``lost`` by reason [m^2]."""
    return {
        "region_area_m2": region_m2,
        "polished_area_m2": polished_m2,
        "left_out_area_m2": sum(lost.values()),
        "left_out": dict(lost),
        "coverage": polished_m2 / region_m2,
    }


def account_for(
    asked: AskedRegion,
    polished: Bools,
    pad: PadConfig,
    cuts: Sequence[CutOut],
    distances: Array,
    stepover: float,
    beside: bool,
) -> AreaAccount:
    """Sort the area of a region into rows.

    What is not ``polished`` (v,) and was not left out before takes the reason of the nearest stretch within
    the pad's radius that was left out; else it is at the region's border, or the pattern does not cover it.
    ``distances`` (v,) [m] of the vertices from the path are far if they are more than a ``stepover`` [m],
    outside what was left out before; a note says so if stretches of the path run ``beside`` each other.
    Vertices at the places of a cut for `UNPLAYED` are not polished either.
    """
    mesh, areas, radius = asked.ground.mesh, asked.areas, pad.radius_m
    bare = [np.empty((0, 3)), *(cut.positions for cut in cuts if cut.reason == UNPLAYED)]
    skipped = polished & (_within(np.concatenate(bare), mesh.vertices, SAME_M) >= 0)
    cuts = [cut for cut in cuts if cut.reason != UNPLAYED]
    reasons = (*asked.reasons, *(cut.reason for cut in cuts), UNPLAYED, BORDER, UNCOVERED)
    polished = polished & ~skipped
    why = np.where(polished, -1, asked.why)
    # The pad that polishes a vertex may touch only a part of its area.
    lost = np.where(polished == (asked.touched >= 0.5), 1.0 - asked.touched, ~polished) * (areas > 0.0)
    missed = np.flatnonzero((lost > 0.0) & (why < 0))
    if len(missed):
        before = why >= 0
        sources = np.concatenate([mesh.vertices[before], *(cut.positions for cut in cuts)])
        numbers = np.repeat(len(asked.reasons) + np.arange(len(cuts)), [len(cut.positions) for cut in cuts])
        numbers = np.concatenate([why[before], numbers])
        near_border = _within(mesh.vertices[mesh.border[:, 0]], mesh.vertices[missed], radius) >= 0
        why[missed] = len(reasons) - np.where(near_border, 2, 1)
        nearest = _within(sources, mesh.vertices[missed], radius)
        why[missed[nearest >= 0]] = numbers[nearest[nearest >= 0]]
        why[skipped & (asked.why < 0)] = len(reasons) - 3
    rows: dict[str, Array] = {}
    for number, reason in enumerate(reasons):
        rows[reason] = rows.get(reason, 0.0) + np.where(why == number, lost, 0.0)
    left_out = {
        reason: _row(asked, share, _middle(mesh.vertices[share > 0.0]))
        for reason, share in rows.items()
        if share.any()
    }
    why[polished] = -1
    left_out = dict(sorted(left_out.items(), key=lambda named: -named[1].area_m2))
    off = np.where((why < 0) & (areas > 0.0), np.minimum(distances, asked.before), 0.0)
    gaps = np.where(asked.why >= 0, 0.0, off)
    far = _row(asked, (gaps > stepover).astype(np.float64), mesh.vertices[gaps.argmax()])
    polished_m2 = asked.area_m2 - sum(row.area_m2 for row in left_out.values())
    shown = far, gaps.max(), off, mesh.vertices[off.argmax()], beside
    return AreaAccount(asked.area_m2, polished_m2, left_out, reasons, why, *shown)


def _row(asked: AskedRegion, share: Array, place: Array) -> LeftOutRow:
    """The row of a share of each vertex's area (v,); shown is where it is above a half."""
    mesh = asked.ground.mesh
    corners = mesh.triangles[asked.ground.of_part[mesh.owners]]
    shown = _above_zero(mesh.vertices[corners], share[corners] - 0.5)
    return LeftOutRow((asked.areas * share).sum(), shown, place)


def _above_zero(triangles: Array, values: Array) -> Array:
    """What of triangles (t, 3, 3) has values (t, 3) above zero, linear over each, as triangles (k, 3, 3)."""
    above, size = values > 0.0, np.abs(values) + 1e-300
    count: Indices = above.sum(axis=1)
    # On each edge its zero, or any place where it has none: pieces are corners, and what is between two.
    share = size / (size + next_corners(size))
    between = triangles + share[:, :, None] * (next_corners(triangles) - triangles)
    pieces = np.stack([triangles, between, np.roll(between, 1, axis=1)], axis=2)
    return np.concatenate([triangles[count == 3], pieces[above & (count < 3)[:, None]], between[count == 2]])


def _middle(places: Array) -> Array:
    """That of some places (k, 3) which is nearest to their mean, shape (3,)."""
    return places[norms(places - places.mean(axis=0)).argmin()]


def _within(sources: Array, points: Array, reach: float) -> Indices:
    """Row of the source (k, 3) nearest to each point (n, 3), -1 where none is within reach [m], shape
    (n,)."""
    found, nearest = cKDTree(sources).query(points, distance_upper_bound=reach)
    return np.where(np.isfinite(found), nearest, -1)
