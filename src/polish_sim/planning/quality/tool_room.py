"""Where the tool stands in the part: pad, shaft, spindle, sensor and wrist beside their work (path ->
places)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, Indices, dots, plane_axes, some_rows
from polish_sim.config import HeadConfig, PadConfig
from polish_sim.config.cell import PAD_TOP
from polish_sim.errors import place_in_mm
from polish_sim.geometry import Surface
from polish_sim.geometry.closest import box_distance2
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.geometry.fit import Fixture
from polish_sim.kernel_cache import njit
from polish_sim.kernels import cross, dot, matvec, minus, plus, scaled, set_to
from polish_sim.planning.quality.coverage import checked_rows
from polish_sim.planning.quality.located import PathOnSurface, UnderPad
from polish_sim.planning.toolpath import arc_length


class Body(NamedTuple):
    """A body of the tool as the cylinder about the tool axis that holds it, however the tool is turned."""

    name: str
    low: float  #: Height of its lower end above the pad's face [m]
    high: float  #: And of its upper end [m]
    radius: float  #: [m]


BEHIND_PAD = (
    Body("shaft", PAD_TOP, 0.060, 0.009),
    Body("spindle", 0.060, 0.102, 0.0325),
    Body("spindle with its connector", 0.102, 0.125, 0.0602),
    Body("sensor", 0.125, 0.2655, 0.0401),
    Body("wrist", 0.2655, 0.400, 0.1435),
)
"""What stands above the pad in the model file with the head's spring at rest, up to the arm's fourth link."""
HOLLOW_SHARE = 0.2
MOST_HOLLOW_M = 0.005
"""On hollow ground the part may stand above the pad's face by this share of its radius, and by no more than
this [m]: the rim carries there, and with the ground more hollow than 2.5 pad radii the pad would be held off
it."""


def most_hollow(pad: PadConfig) -> float:
    """How high the ground under a pad may stand above its face [m]."""
    return min(HOLLOW_SHARE * pad.radius_m, MOST_HOLLOW_M)


def hollow_radius(pad: PadConfig) -> float:
    """Least radius of hollow ground a pad follows [m]."""
    return pad.radius_m**2 / (2.0 * most_hollow(pad))


class Places(NamedTuple):
    """Where the tool stands, and what the pad yields there."""

    middles: Array  #: Middle of the pad's face [m], shape (n, 3)
    axes: Array  #: Unit tool axes, shape (n, 3)
    lows: Array  #: What stands no higher above the pad's face is pressed, not run into [m], shape (n,)
    yields: Array  #: The pad may be this deep in the part [m], shape (n,)


class Standing(NamedTuple):
    """How deep the tool is in the part; zeros where it is clear."""

    depths: Array  #: [m], shape (n,)
    reaches: Array  #: How far it would have to move aside [m], shape (n,)
    bodies: Indices  #: Number of the body that is deepest, shape (n,)


PART, FIXTURE = "part", "fixture"
UNSURE_M = 0.003
"""How far a part may lie otherwise in its fixture than drawn, and the arm with it: besides the clearance, the
tool keeps this from the fixture, its pad only from what is below [m]."""


class Tool(NamedTuple):
    """Pad, head, spindle, sensor and wrist, pressed on, and what they must keep clear of beside the part."""

    pad: PadConfig
    force: float  #: [N]; the head's spring lets everything behind the pad sink by what it yields
    fixture: Fixture | None = None

    @property
    def bodies(self) -> tuple[Body, ...]:
        """From the pad up."""
        sunk = self.force / HeadConfig().stiffness_n_m
        behind = (body._replace(low=body.low - sunk) for body in BEHIND_PAD)
        return (Body("pad", 0.0, PAD_TOP, self.pad.radius_m), *behind)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Each body with what it must keep clear of, the part or the fixture."""
        beside = (PART, FIXTURE) if self.fixture else (PART,)
        return tuple((body.name, what) for what in beside for body in self.bodies)

    def rooms(self, part: Surface, places: Places, clearance: float, beyond: float) -> Array:
        """Distance from each body's side, less a clearance [m], at most ``beyond``, shape (n, pairs)."""
        rooms = [self._room(part, places, body, clearance, beyond) for body in self.bodies]
        if self.fixture:
            around = self.fixture.surface
            inside = self._in_fixture(places)
            for number, body in enumerate(self.bodies):
                aside = clearance + (UNSURE_M if number else 0.0)
                room = self._room(around, _on_fixture(places, clearance + UNSURE_M), body, aside, beyond)
                rooms.append(np.where(inside & (number == 0), -body.radius - aside, room))
        return np.stack(rooms, axis=1)

    def _room(self, part: Surface, places: Places, body: Body, clearance: float, beyond: float) -> Array:
        wide = body.radius + clearance + beyond
        found = standing_above(part, _discs(places, body, clearance)._replace(radius=wide), deep=False)
        return beyond - found.reaches

    def _in_fixture(self, places: Places) -> Bools:
        """Whether the pad is inside the fixture, far from its skin or not; of an open one nothing is
        inside."""
        assert self.fixture
        if self.fixture.surface.is_open:
            return np.zeros(len(places.middles), dtype=bool)
        return signed_distances(self.fixture.surface, places.middles + 0.5 * PAD_TOP * places.axes) < 0.0

    def stands_in(self, part: Surface, places: Places) -> Standing:
        """Find where the tool is deeper in the part than the pad yields, or in the fixture at all."""
        count = len(places.middles)
        worst = Standing(np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64))
        around = [(self.fixture.surface, _on_fixture(places, 0.0))] if self.fixture else []
        for beside, (what, there) in enumerate([(part, places), *around]):
            for number, body in enumerate(self.bodies):
                found = standing_above(what, _discs(there, body, 0.0))
                deeper = found.depths > np.maximum(there.yields if number == 0 else 0.0, worst.depths)
                worst.depths[deeper], worst.reaches[deeper] = found.depths[deeper], found.reaches[deeper]
                worst.bodies[deeper] = beside * len(self.bodies) + number
        if self.fixture:
            within = self._in_fixture(places) & (worst.depths < 0.5 * PAD_TOP)
            worst.depths[within] = 0.5 * PAD_TOP
            worst.reaches[within] = self.pad.radius_m
            worst.bodies[within] = len(self.bodies)
        return worst


def _on_fixture(places: Places, below: float) -> Places:
    """The same places where nothing may be pressed, down to ``below`` [m] under the pad."""
    return places._replace(lows=-places.yields - below, yields=np.zeros_like(places.yields))


def _discs(places: Places, body: Body, clearance: float) -> Discs:
    """The layer a body fills above the pad's face; the pad's begins where it yields no more."""
    lows = places.lows if body.low == 0.0 else np.full(len(places.lows), body.low - clearance)
    highs = np.maximum(lows + 1e-3, body.high + clearance)
    return Discs(places.middles.copy(), places.axes, lows, highs, body.radius)  # a path's are frozen


def pressed_places(
    middles: Array, axes: Array, ground: UnderPad, pad: PadConfig, forces: float | Array
) -> Places:
    """The tool pressed on: the pad yields by F / k, over hollow ground or tilted by what that makes it.

    Tool points (n, 3) [m] on the surface, unit axes (n, 3), forces [N], one or (n,). Ground more hollow than
    the pad follows counts as the most it does.
    """
    yields = np.full(len(middles), forces / pad.stiffness_n_m)
    return Places(middles, axes, _own_heights(axes, ground, pad) + yields, yields)


RIM_POINTS = 32
FLATTEST = 0.1  #: Cosine between tool axis and normal from which on the tool's tilt cannot be seen
RINGS = (0.25, 0.5, 0.75, 1.0)  #: Where on the pad its own place's hollow and the tool's tilt are looked at


def _own_heights(axes: Array, ground: UnderPad, pad: PadConfig) -> Array:
    """How high the place under the pad stands above its face by its curvatures and the tool's tilt [m],
    (n,)."""
    radius = pad.radius_m
    # A tool that lies along the part has no height of its own; it is in the part by its rim.
    lean = axes / np.maximum(dots(axes, ground.normals)[:, None], FLATTEST)
    tilt, beside = ground.slopes(lean).T[..., None]
    bend = np.maximum(ground.curvatures, -1.0 / hollow_radius(pad))
    angle = np.arange(RIM_POINTS) * (2.0 * np.pi / RIM_POINTS)
    highest = np.zeros(len(axes))
    for ring in RINGS:
        x, y = ring * radius * np.cos(angle), ring * radius * np.sin(angle)
        height = tilt * x + beside * y - 0.5 * (bend[:, :1] * x**2 + bend[:, 1:] * y**2)
        highest = np.maximum(highest, height.max(axis=1))
    return highest


CHECKED_APART = 0.25  #: Spacing along the path at which the tool is checked [pad radii]


class PadInPart(NamedTuple):
    """Tool points at which the tool is in the part."""

    positions: Array  #: [m], shape (k, 3)
    depths: Array  #: How deep it is [m], shape (k,)
    reaches: Array  #: How much further away from there the tool point would have to be [m], shape (k,)
    lengths: Array  #: Length of the path each stands for [m], shape (k,)
    pairs: tuple[tuple[str, str], ...]  #: What is deepest there, and in what
    pad_radius: float  #: [m]

    @property
    def max_m(self) -> float:
        """Deepest [m]; 0 if the tool is nowhere in the part."""
        return self.depths.max(initial=0.0)

    @property
    def figures(self) -> dict[str, Any]:
        """For metrics.json; place and body are empty if the tool is nowhere in the part."""
        place, (body, beside) = [], ("", "")
        if self.pairs:
            worst = self.depths.argmax()
            place, (body, beside) = self.positions[worst].tolist(), self.pairs[worst]
        return {
            "pad_in_part_max_m": self.max_m,
            "pad_in_part_length_m": self.lengths.sum(),
            "pad_in_part_at_m": place,
            "pad_in_part_body": body,
            "pad_in_part_beside": beside,
        }


def find_pad_in_part(on: PathOnSurface, part: Surface, pad: PadConfig, fixture: Fixture | None) -> PadInPart:
    """Carry the tool along the path and look for what of part and fixture stands where its bodies are.

    The pad yields as far as the force presses it, F / k, and over a hollow place or tilted as far as that
    place's curvatures and the tilt make it: what stands no higher than both together is polished, not run
    into, nor is what the pad is in no deeper than it yields. A place more hollow than the pad follows counts
    as the most it does.
    """
    s = arc_length(on.positions)
    rows = checked_rows(on, s, CHECKED_APART * pad.radius_m)
    places = pressed_places(
        on.positions[rows], on.axes[rows], some_rows(on.under, rows), pad, on.forces[rows]
    )
    tool = Tool(pad, on.forces.max(), fixture)
    found = tool.stands_in(part, places)
    way = np.where(np.diff(on.stretch_of[rows]) == 0, np.diff(s[rows]), 0.0)
    lengths = 0.5 * (np.append(way, 0.0) + np.append(0.0, way))
    hit = np.flatnonzero(found.depths)
    pairs = tuple(tool.pairs[number] for number in found.bodies[hit])
    at = places.middles[hit], found.depths[hit], found.reaches[hit], lengths[hit]
    return PadInPart(*at, pairs, pad.radius_m)


def pad_in_part_warning(figures: Mapping[str, Any]) -> str:
    """The figures as a sentence with the worst place; empty if the tool is nowhere in the part."""
    deepest, body, beside = (figures[f"pad_in_part_{name}"] for name in ("max_m", "body", "beside"))
    if deepest <= 0.0:
        return ""
    return (
        f"the {body} runs up to {1e3 * deepest:.3g} mm into the {beside} over "
        f"{figures['pad_in_part_length_m']:.3g} m of the path, worst at "
        f"{place_in_mm(figures['pad_in_part_at_m'])}"
    )


# What of the part stands in a layer above a disc: the test behind all of it.


class Discs(NamedTuple):
    """Discs and the layer above each in which nothing of the part may be."""

    middles: Array  #: [m], shape (n, 3)
    axes: Array  #: Unit vectors away from the part, shape (n, 3)
    lows: Array  #: Where the layer begins above the disc's plane [m], shape (n,)
    highs: Array  #: And where it ends [m], shape (n,)
    radius: float  #: [m]


class Intrusion(NamedTuple):
    """What is in the layers; zeros where there is nothing."""

    depths: Array
    """How deep a disc stands in the part [m], shape (n,): behind the plane of a face, beside or below its
    edge."""
    reaches: Array  #: How far the part reaches into a disc from its rim [m], shape (n,)


def standing_above(part: Surface, discs: Discs, deep: bool = True) -> Intrusion:
    """Find the faces of a part that stand in the layers above discs, and how far each disc is in the part.

    Without ``deep`` depths are not all looked for: reaches are found much sooner.
    Only the flat triangles between the patches' corners are tested: a wall is found however thin it is.
    """
    frames = np.stack([*plane_axes(discs.axes), discs.axes], axis=1)
    depths, reaches = _look(part.control, part.tree, discs, np.ascontiguousarray(frames), deep)
    return Intrusion(depths, reaches)


@njit
def _look(control, tree, discs, frames, deep):  # type: ignore[no-untyped-def]
    count = len(discs.middles)
    radius = discs.radius
    depths, reaches = np.zeros(count), np.zeros(count)
    nodes, corner, layer, cut = np.empty(64, np.int32), np.empty((3, 3)), np.empty((6, 3)), np.empty((6, 3))
    for i in range(count):
        middle, axis = discs.middles[i], discs.axes[i]
        low, high = discs.lows[i], discs.highs[i]
        around2 = radius * radius + high * high
        nodes[0], top = 0, 1
        while top > 0:
            top -= 1
            node = nodes[top]
            if box_distance2(tree.low, tree.high, node, middle) > around2:
                continue
            if _top_of_box(tree, node, middle, axis, 1.0) <= low:
                continue
            if _top_of_box(tree, node, middle, axis, -1.0) <= -high:
                continue
            # What is further from the axis than what was found already adds nothing.
            if _beside(tree, node, middle, axis) >= radius - (depths[i] if deep else reaches[i]):
                continue
            if tree.right[node] >= 0:
                one = tree.right[node]
                two = node + 1
                near = box_distance2(tree.low, tree.high, one, middle)
                if near < box_distance2(tree.low, tree.high, two, middle):
                    one, two = two, one
                nodes[top], nodes[top + 1] = one, two
                top += 2
                continue
            for k in range(tree.first[node], tree.first[node] + tree.size[node]):
                _seen_from(control[tree.items[k]], middle, frames[i], corner)
                gap = _distance_in_layer(corner, low, high, layer, cut)
                if gap < radius:
                    reaches[i] = max(reaches[i], radius - gap)
                    depths[i] = max(depths[i], min(radius - gap, _depth_behind(corner, radius)))
    return depths, reaches


@njit
def _top_of_box(tree, node, middle, axis, up):  # type: ignore[no-untyped-def]
    """Height of a box's highest corner above a disc's plane [m]; with ``up`` -1 of its lowest one,
    negative."""
    height = 0.0
    for k in range(3):
        corner = tree.high[node, k] if up * axis[k] > 0.0 else tree.low[node, k]
        height += up * axis[k] * (corner - middle[k])
    return height


@njit
def _beside(tree, node, middle, axis):  # type: ignore[no-untyped-def]
    """Least distance a ball round a box has from a disc's axis [m]; negative if the axis meets the ball."""
    half = scaled(0.5, minus(tree.high[node], tree.low[node]))
    offset = minus(plus(tree.low[node], half), middle)
    along = dot(axis, offset)
    away2, radius2 = dot(offset, offset), dot(half, half)
    return np.sqrt(max(away2 - along * along, 0.0)) - np.sqrt(radius2)


@njit
def _seen_from(patch, middle, frame, corner):  # type: ignore[no-untyped-def]
    """Write the corners of a patch in a disc's frame."""
    for a in range(3):
        set_to(corner[a], matvec(frame, minus(patch[a], middle)))


@njit
def _distance_in_layer(corner, low, high, layer, cut):  # type: ignore[no-untyped-def]
    """Distance from the axis to the part of a triangle between two heights [m]; inf if there is none."""
    if (
        max(corner[0, 2], corner[1, 2], corner[2, 2]) <= low
        or min(corner[0, 2], corner[1, 2], corner[2, 2]) >= high
    ):
        return np.inf
    count = _cut_off(corner, 3, 1.0, low, layer)
    count = _cut_off(layer, count, -1.0, -high, cut)
    nearest2, left, right = np.inf, 0, 0
    for a in range(count):
        b = (a + 1) % count
        px, py = cut[a, 0], cut[a, 1]
        dx, dy = cut[b, 0] - px, cut[b, 1] - py
        t = min(max(-(px * dx + py * dy) / max(dx * dx + dy * dy, 1e-300), 0.0), 1.0)
        nearest2 = min(nearest2, (px + t * dx) ** 2 + (py + t * dy) ** 2)
        side = dx * py - dy * px
        left += side > 0.0
        right += side < 0.0
    if count >= 3 and (left == count or right == count):
        return 0.0
    return np.sqrt(nearest2)


@njit
def _cut_off(points, count, sign, limit, out):  # type: ignore[no-untyped-def]
    """Keep what of a polygon has sign * z > limit; returns its number of corners."""
    kept = 0
    for a in range(count):
        b = (a + 1) % count
        here, there = sign * points[a, 2] - limit, sign * points[b, 2] - limit
        if here > 0.0:
            for k in range(3):
                out[kept, k] = points[a, k]
            kept += 1
        if (here > 0.0) != (there > 0.0):
            t = here / (here - there)
            for k in range(3):
                out[kept, k] = points[a, k] + t * (points[b, k] - points[a, k])
            kept += 1
    return kept


@njit
def _depth_behind(corner, radius):  # type: ignore[no-untyped-def]
    """How deep the disc can be in the part at a face [m]: not deeper than the face is high, nor than its
    slope lets."""
    highest = max(corner[0, 2], corner[1, 2], corner[2, 2])
    n = nx, ny, nz = cross(minus(corner[1], corner[0]), minus(corner[2], corner[0]))
    size = max(np.sqrt(dot(n, n)), 1e-300)
    offset = dot(corner[0], n) / size
    # The rim's deepest point behind the plane of a face that looks up or to the side, towards the disc.
    behind = radius * np.sqrt(nx * nx + ny * ny) / size + offset
    if nz >= -1e-9 * size and behind > 0.0:
        return min(highest, behind)
    return highest
