"""A plan as a picture: the part, the path coloured along its length, leads and tool axes, in 3D and from
above."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from polish_sim.analysis.style import (
    EDGE_ON,
    GREY,
    ORANGE,
    PINK,
    RED,
    SKY,
    YELLOW,
    DepthPicture,
    Views,
    depth_picture,
    head,
    new_figure,
    say_stop,
    seen_in,
    styled,
    views_of,
)
from polish_sim.arrays import Array, Bools, Indices, Ints, longest_side, unit
from polish_sim.exchange.viewers import FAR_COLOR
from polish_sim.geometry.features import facet_cross
from polish_sim.geometry.mesh import lighter_mesh
from polish_sim.planning.part_plan import EASED, SLOWED
from polish_sim.planning.part_plan import LEFT_OUT as CUT
from polish_sim.planning.quality.areas import FAR
from polish_sim.planning.toolpath import (
    APPROACH,
    LEAD_IN,
    LEAD_OUT,
    RETRACT,
    ToolPath,
    arc_length,
    interpolate,
    stretches,
)

if TYPE_CHECKING:
    from polish_sim.analysis.run_record import StopMark
    from polish_sim.planning import PlanResult


MM = 1e3
COLORS = "viridis"
LANDING, LEAVING = ORANGE, PINK
LEFT_OUT = (YELLOW, SKY, GREY, "#8C564B", "#B7A800", "#7B3FA0")  #: What is left out, a colour for each reason
MOST_FACETS = 8_000  #: Finer parts are drawn by a lighter copy: matplotlib takes 20 us for each, twice
MOST_CHORDS = 3_000  #: Chords that draw the path in contact at most, for the same reason
AXES_SHOWN = 90
MOST_MARKS = 150  #: Of a kind of mend
LEAD_POINTS = 120  #: Least number of points along a lead: each is seen or hidden by itself
#: The way to the viewer of the slanted view, in the frame of `Views.space`: 38 deg above the table
TOWARDS_VIEWER = np.array([0.370, -0.696, 0.616])
_RIGHT = unit(np.cross([0.0, 0.0, 1.0], TOWARDS_VIEWER))
SLANTED = np.stack([_RIGHT, np.cross(TOWARDS_VIEWER, _RIGHT), TOWARDS_VIEWER])
LIGHT = np.array([-0.57, -0.37, 0.73])  #: Where it comes from, in the same frame
AMBIENT = 0.42
TICKS = 6
LONGEST_EDGE = 0.1  #: Of a facet that is drawn, as a share of the part's size
TINT, FIXTURE_TINT = np.array([0.93, 0.95, 1.0]), np.array([0.55, 0.62, 0.72])


class _View(NamedTuple):
    """A look at a plan from one side, without perspective."""

    axes: Axes
    frame: Array  #: R, its rows the picture's right, its up and the way to the viewer, work frame, (3, 3)
    depths: DepthPicture

    def places(self, points: Array) -> Array:
        """Points (..., 3) [m] in the picture [mm], shape (..., 2)."""
        return MM * (points @ self.frame.T)[..., :2]

    def sees(self, points: Array, off: Array) -> Bools:
        """Whether the part does not stand before points (n, 3) [m]; ``off``: unit vectors away from it."""
        return seen_in(self.depths, points @ self.frame.T, off @ self.frame.T)

    def mark(self, points: Array, label: str, **look: Any) -> None:
        """Mark some points (n, 3) [m], if there are any."""
        if len(points):
            self.axes.plot(*self.places(points).T, linestyle="none", zorder=25, label=label, **look)


@styled
def plot_plan(result: PlanResult, name: str = "", stop: StopMark | None = None) -> Figure:
    """Draw a plan in 3D and from above; from below if it looks down, along its face if that is a side of the
    part.

    ``name``: of the path, else its own; ``stop``: where a run along it stopped itself.
    """
    figure = new_figure(12.0, 5.8)
    slanted, flat = figure.subplots(1, 2)
    path, mesh, fixture = result.path, result.mesh, result.tool.fixture
    bodies = [(mesh, TINT), *([(fixture.mesh, FIXTURE_TINT)] if fixture else [])]
    facets = [_in_small_facets(body.vertices, body.faces) for body, _ in bodies]
    corners = np.concatenate(facets)
    tints = np.repeat([tint for _, tint in bodies], [len(body) for body in facets], axis=0)
    views = views_of(path.axes_work[path.process], mesh.up)
    bright = np.clip(unit(facet_cross(corners)) @ views.space.T @ LIGHT, 0.0, 1.0) ** 1.5
    colors = np.minimum((AMBIENT + (1.0 - AMBIENT) * bright[:, None]) * tints, 1.0)
    scale = Normalize(0.0, path.s[-1])
    for axes, frame in ((slanted, SLANTED @ views.space), (flat, views.flat)):
        view = _View(axes, frame, depth_picture(corners @ frame.T))
        _draw_part(view, corners, colors)
        _draw_reach(view, result)
        seen = _draw_contact(view, path, scale)
        _draw_leads(view, path, seen)
        if axes is slanted:
            _draw_axes(view, path, seen)
        _draw_mends(view, result)
        if stop:
            cross_out(axes, view.places(stop.on_path(path)))
        axes.autoscale_view()
        scale_flat(axes, views)
    slanted.set_axis_off()
    if fixture:
        flat.plot([], [], "s", color=FIXTURE_TINT, label="fixture")
    figure.colorbar(ScalarMappable(scale, COLORS), ax=flat, label="along the path [m]", shrink=0.85, pad=0.02)
    # The file of a path that was given: its pattern is not known.
    plan = result.plan
    _head(figure, flat, result, name or Path(plan.file).name or plan.pattern.capitalize(), views)
    if stop:
        say_stop(figure, stop.text)
    return figure


def _in_small_facets(vertices: Array, faces: Ints) -> Array:
    """Corners of facets without long edges, shape (m, 3, 3): long facets cannot be drawn in order of their
    distance."""
    import trimesh  # slow to import

    remesh: Any = trimesh.remesh
    light = lighter_mesh(vertices, faces, MOST_FACETS)
    places, corners = remesh.subdivide_to_size(*light, LONGEST_EDGE * longest_side(vertices))
    return places[corners]


def _draw_part(view: _View, corners: Array, colors: Array) -> None:
    """The facets that face the viewer, far ones first."""
    turned = corners @ view.frame.T
    front = np.flatnonzero(facet_cross(turned)[:, 2] > 0.0)
    front = front[np.argsort(turned[front, :, 2].mean(axis=1))]
    _fill(view, corners[front], colors[front], 0.7)


def _fill(view: _View, triangles: Array, color: Any, width: float) -> None:
    shown = list(view.places(triangles))
    view.axes.add_collection(PolyCollection(shown, facecolors=color, edgecolors=color, lw=width))


def _draw_reach(view: _View, result: PlanResult) -> None:
    """What is left out in a colour for each reason, what is far from the path, and in red where the tool is
    in the part."""
    for (label, out), color in zip(result.area.marked.items(), cycle(LEFT_OUT), strict=False):
        if len(out):
            tint: Any = np.array(FAR_COLOR) / 255.0 if label == FAR else color
            _fill(view, out[view.sees(out.mean(axis=1), unit(facet_cross(out)))], tint, 0.3)
            view.axes.plot([], [], "s", color=tint, label=label)
    view.mark(result.in_part, "tool in the part", marker=".", color=RED, ms=5.0)


def _draw_contact(view: _View, path: ToolPath, scale: Normalize) -> Bools:
    """The path in contact, coloured along its length, where the part does not stand before it; which of all
    its points are seen, shape (n,)."""
    seen = view.sees(path.positions_work, path.axes_work)
    facing = seen & (path.axes_work @ view.frame[2] > EDGE_ON)
    # A path on walls alone is better seen edge-on than not at all.
    seen = facing if (facing & path.process).any() else seen
    rows, places = path.process & seen, view.places(path.positions_work)
    apart = max(1, int(np.count_nonzero(rows)) // MOST_CHORDS)
    for first, last in stretches(rows):
        at = np.unique(np.append(np.arange(first, last + 1, apart), last))
        chords = np.stack([places[at[:-1]], places[at[1:]]], axis=1)
        look: Any = {"array": path.s[at[:-1]], "cmap": COLORS, "norm": scale}
        view.axes.add_collection(LineCollection(list(chords), lw=1.5, capstyle="round", **look))
    return seen


def _draw_leads(view: _View, path: ToolPath, seen: Bools) -> None:
    """Approach and lead-in in one colour, lead-out and retract in another, with a mark where contact begins,
    ends."""
    # A ring, so that an end in the same place shows within it.
    ring: dict[str, Any] = {"mfc": "none", "mew": 2.0, "ms": 10}
    square: dict[str, Any] = {"mec": "white", "mew": 0.8, "ms": 6}
    for codes, color, label, marker, style, at_end in (
        ((APPROACH, LEAD_IN), LANDING, "approach, lead-in", "o", ring, True),
        ((LEAD_OUT, RETRACT), LEAVING, "lead-out, retract", "s", square, False),
    ):
        view.axes.plot([], [], marker, color=color, **style, label=label)
        for first, last in stretches(np.isin(path.segment, codes)):
            rows = np.arange(max(first - (not at_end), 0), min(last + 1 + at_end, len(path.s)))
            line, off = _finer(path.positions_work[rows], path.axes_work[rows])
            for a, b in stretches(view.sees(line, off)):
                view.axes.plot(*view.places(line[a : b + 1]).T, color=color, lw=1.6)
            touch = rows[-1] if at_end else rows[0]
            if seen[touch]:
                place = view.places(path.positions_work[touch])
                view.axes.plot(*place, marker, color=color, **style, zorder=20 + at_end)


def _finer(line: Array, off: Array) -> tuple[Array, Array]:
    """A line and its tool axes with points in between, so that it can go out of sight anywhere."""
    along = arc_length(line)
    places = np.union1d(along, np.linspace(0.0, along[-1], LEAD_POINTS))
    return interpolate(places, along, line), interpolate(places, along, off)


def _draw_axes(view: _View, path: ToolPath, seen: Bools) -> None:
    """Some tool axes as thin lines that stand on the path where it is seen."""
    process = np.flatnonzero(path.process)
    s = path.s[process]
    rows = process[
        np.unique(np.searchsorted(s, np.linspace(s[0], s[-1], AXES_SHOWN)).clip(0, len(process) - 1))
    ]
    feet = path.positions_work[rows[seen[rows]]]
    tips = feet + 0.06 * longest_side(path.positions_work[process]) * path.axes_work[rows[seen[rows]]]
    lines = view.places(np.stack([feet, tips], axis=1))
    view.axes.add_collection(LineCollection(list(lines), colors=GREY, lw=0.6))


def _draw_mends(view: _View, result: PlanResult) -> None:
    """Where the path was slowed, pressed with less or left out after it had been played in the cell."""
    slowed: dict[str, Any] = {"marker": "o", "mfc": "white", "mec": "black", "mew": 0.6, "ms": 3.0}
    eased = slowed | {"marker": "v", "mfc": SKY}
    left_out: dict[str, Any] = {"marker": "x", "color": "black", "mew": 0.9, "ms": 3.5}
    for what, look in ((SLOWED, slowed), (EASED, eased), (CUT, left_out)):
        places = [np.empty((0, 3)), *(mend.places for mend in result.mends if mend.what == what)]
        at = np.concatenate(places)
        view.mark(at[:: max(1, len(at) // MOST_MARKS)], f"{what} after playing it", **look)


def cross_out(axes: Axes, place: Array) -> None:
    """Mark a protective stop's place in a picture [mm], shape (2,)."""
    axes.plot(*place, "X", color=RED, ms=12, mec="white", mew=1.0, zorder=40, label="protective stop")


SMOOTH: dict[str, Any] = {"shading": "gouraud", "rasterized": True}  #: Colours between vertices


def seen_triangles(vertices: Array, normals: Array, triangles: Indices, views: Views) -> Triangulation:
    """The triangles (m, 3) of a mesh that face the viewer of its flat picture [mm]; all if none does."""
    places = views.places(vertices)
    facing = (normals[triangles] @ views.flat[2]).min(axis=1) > 0.0
    return Triangulation(places[:, 0], places[:, 1], triangles[facing if facing.any() else slice(None)])


def scale_flat(flat: Axes, views: Views) -> None:
    """Give a flat picture of a part equal scales in mm, its axes named after the part's."""
    flat.set_aspect("equal")
    flat.set(xlabel=views.labels[0], ylabel=views.labels[1])
    flat.xaxis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 5, 10]))


def _head(figure: Figure, flat: Axes, result: PlanResult, name: str, views: Views) -> None:
    """The heading, and under it how long and how dense the path is."""
    m = result.figures
    near, far = MM * m["stepover_p5_m"], MM * m["stepover_p95_m"]
    # A path without neighbouring turns has no spacing to show.
    beside = np.isfinite([near, far]).all()
    facts = (
        f"{m['path_length_m']:.2f} m in {m['retracts']} run{'s' if m['retracts'] != 1 else ''}",
        *(
            [f"step-over {MM * result.plan.stepover_m:.4g} mm, p5-p95 {near:.2f}-{far:.2f} mm"]
            if beside
            else []
        ),
        f"planned coverage {100.0 * m['coverage']:.1f}%",
        f"right: {views.name}",
    )
    head(figure, f"{name} on {result.mesh.name}", facts, legend=(flat,))
