"""A plan as a picture: the part, the path coloured along its length, leads and tool axes, in 3D and from
above."""

from __future__ import annotations

from collections.abc import Iterator
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
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

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
from polish_sim.geometry.features import facet_cross
from polish_sim.geometry.mesh import lighter_mesh
from polish_sim.planning.part_plan import EASED, SLOWED
from polish_sim.planning.part_plan import LEFT_OUT as CUT
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
ELEVATION, AZIMUTH = 38.0, -62.0
TOWARDS_VIEWER = np.array(
    [
        np.cos(np.radians(ELEVATION)) * np.cos(np.radians(AZIMUTH)),
        np.cos(np.radians(ELEVATION)) * np.sin(np.radians(AZIMUTH)),
        np.sin(np.radians(ELEVATION)),
    ]
)
LIGHT = np.array([-0.57, -0.37, 0.73])
AMBIENT = 0.42
TICKS = 6
LONGEST_EDGE = 0.1  #: Of a facet that is drawn, as a share of the part's size
LEAST_HEIGHT = 0.02  #: Of a 3D drawing, over its width
TINT, FIXTURE_TINT = np.array([0.93, 0.95, 1.0]), np.array([0.55, 0.62, 0.72])


class _Seen(NamedTuple):
    """What of a path a viewer sees, in space and in the flat picture."""

    space: DepthPicture
    above: DepthPicture
    turn: Array  #: From the frame in space to the flat one, shape (3, 3)
    towards: Array  #: Tool axes in the frame in space, shape (n, 3)
    in_space: Bools  #: Points that can be seen, shape (n,)
    from_above: Bools  #: The same in the flat picture

    def flat(self, points: Array) -> Array:
        """Points or directions (..., 3) of the frame in space in the flat one."""
        return points @ self.turn.T


@styled
def plot_plan(result: PlanResult, name: str = "", stop: StopMark | None = None) -> Figure:
    """Draw a plan in 3D and from above; from below if it looks down, along its face if that is a side of the
    part.

    ``name``: of the path, else its own; ``stop``: where a run along it stopped itself.
    """
    figure = new_figure(12.0, 5.8)
    solid: Any = figure.add_subplot(1, 2, 1, projection="3d", computed_zorder=False)
    flat = figure.add_subplot(1, 2, 2)
    path = result.path
    mesh = result.mesh
    fixture = result.tool.fixture
    views = views_of(path.axes_work[path.process], mesh.up)
    frame = views.space
    shown = path.positions_work @ frame.T * MM
    vertices = result.standing[0].vertices @ frame.T * MM
    drawn = [(mesh, TINT), *([] if fixture is None else [(fixture.mesh, FIXTURE_TINT)])]
    light = [lighter_mesh(body.vertices @ frame.T * MM, body.faces, MOST_FACETS) for body, _ in drawn]
    bodies = [_in_small_facets(body.vertices, body.faces) for body in light]
    corners = np.concatenate(bodies)
    if fixture is not None:
        flat.plot([], [], "s", color=FIXTURE_TINT, label="fixture")
    fill_view(solid, np.concatenate([vertices, shown]))
    seen = _look(solid, corners, path, shown, views)
    tints = np.repeat([tint for _, tint in drawn], [len(body) for body in bodies], axis=0)
    _draw_part(solid, flat, corners, seen.flat(corners), tints)
    scale = Normalize(0.0, path.s[-1])
    _draw_reach(solid, flat, result, frame, seen)
    _draw_contact(solid, flat, path, shown, seen, scale)
    _draw_leads(solid, flat, path, shown, seen)
    _draw_axes(solid, path, shown, seen)
    _draw_mends(solid, flat, result, frame, seen)
    if stop:
        cross_out(solid, frame @ stop.on_path(path) * MM)
        cross_out(flat, (views.flat @ stop.on_path(path))[:2] * MM)
    _finish(figure, flat, scale, views)
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
    places, corners = remesh.subdivide_to_size(vertices, faces, LONGEST_EDGE * longest_side(vertices))
    return places[corners]


def _look(solid: Any, corners: Array, path: ToolPath, shown: Array, views: Views) -> _Seen:
    """Find what the part hides, in the view in space and in the flat one."""
    projection = solid.get_proj()
    towards = path.axes_work @ views.space.T
    turn = views.flat @ views.space.T

    def in_space(points: Array) -> Array:
        across, up, away = proj3d.proj_transform(*points.T, projection)
        return np.column_stack([across, up, -np.asarray(away)])

    space = depth_picture(corners, in_space)
    above = depth_picture(corners, lambda points: points @ turn.T)
    from_above = seen_in(above, shown, towards)
    facing = from_above & (towards @ turn[2] > EDGE_ON)
    # A path on walls alone is better seen edge-on than not at all.
    from_above = facing if (facing & path.process).any() else from_above
    return _Seen(space, above, turn, towards, seen_in(space, shown, towards), from_above)


def _shaded(corners: Array, towards: Array, tints: Array) -> tuple[Array, Array]:
    """The facets that face the viewer, far ones first, (m, 3, 3), and their colours, (m, 4)."""
    normals = unit(facet_cross(corners))
    front = np.flatnonzero(normals @ towards > 0.0)
    front = front[np.argsort(corners[front].mean(axis=1) @ towards)]
    bright = AMBIENT + (1.0 - AMBIENT) * np.clip(normals[front] @ LIGHT, 0.0, 1.0) ** 1.5
    colors = np.column_stack([np.clip(bright[:, None] * tints[front], 0.0, 1.0), np.ones(len(front))])
    return corners[front], colors


def _draw_part(solid: Any, flat: Axes, corners: Array, flat_corners: Array, tints: Array) -> None:
    near, colors = _shaded(corners, TOWARDS_VIEWER, tints)
    solid.add_collection3d(Poly3DCollection(near, facecolors=colors, edgecolors=colors, lw=0.3, zorder=1))
    near, colors = _shaded(flat_corners, np.array([0.0, 0.0, 1.0]), tints)
    flat.add_collection(PolyCollection(list(near[..., :2]), facecolors=colors, edgecolors=colors, lw=0.7))


def _draw_reach(solid: Any, flat: Axes, result: PlanResult, frame: Array, seen: _Seen) -> None:
    """What is left out in a colour for each reason, and in red where the tool is in the part."""
    for (reason, row), color in zip(result.area.left_out.items(), cycle(LEFT_OUT), strict=False):
        out = row.triangles @ frame.T * MM
        if not len(out):
            continue
        normals = unit(facet_cross(out))
        near = out[seen_in(seen.space, out.mean(axis=1), normals)]
        solid.add_collection3d(Poly3DCollection(near, facecolors=color, edgecolors=color, lw=0.3, zorder=2))
        flat.add_collection(
            PolyCollection(list(seen.flat(out)[..., :2]), facecolors=color, edgecolors=color, lw=0.3)
        )
        flat.plot([], [], "s", color=color, label=f"left out: {reason}")
    if len(result.in_part):
        at = result.in_part @ frame.T * MM
        solid.plot(*at.T, ".", color=RED, ms=5.0, zorder=30)
        flat.plot(*seen.flat(at).T[:2], ".", color=RED, ms=5.0, zorder=30, label="tool in the part")


def _draw_contact(
    solid: Any, flat: Axes, path: ToolPath, shown: Array, seen: _Seen, scale: Normalize
) -> None:
    """The path in contact, coloured along its length, where the part does not stand before it."""
    style: dict[str, Any] = {"cmap": COLORS, "norm": scale, "capstyle": "round"}
    for lines, at in _chords(path.process & seen.in_space, shown, path.s):
        solid.add_collection3d(Line3DCollection(lines, array=at, lw=1.4, zorder=5, **style))
    for lines, at in _chords(path.process & seen.from_above, shown, path.s):
        flat.add_collection(LineCollection(list(seen.flat(lines)[..., :2]), array=at, lw=1.5, **style))


def _chords(rows: Bools, shown: Array, s: Array) -> Iterator[tuple[Array, Array]]:
    """Chords of each stretch of rows, (k, 2, 3), and where along the path they are, (k,)."""
    apart = max(1, int(np.count_nonzero(rows)) // MOST_CHORDS)
    for first, last in stretches(rows):
        if last > first:
            at = np.unique(np.append(np.arange(first, last + 1, apart), last))
            yield np.stack([shown[at[:-1]], shown[at[1:]]], axis=1), s[at[:-1]]


def _draw_leads(solid: Any, flat: Axes, path: ToolPath, shown: Array, seen: _Seen) -> None:
    """Approach and lead-in in one colour, lead-out and retract in another, with a mark where contact begins,
    ends."""
    # A ring, so that an end in the same place shows within it.
    ring: dict[str, Any] = {"mfc": "none", "mew": 2.0, "ms": 10}
    square: dict[str, Any] = {"mec": "white", "mew": 0.8, "ms": 6}
    for codes, color, label, marker, style, at_end in (
        ((APPROACH, LEAD_IN), LANDING, "approach, lead-in", "o", ring, True),
        ((LEAD_OUT, RETRACT), LEAVING, "lead-out, retract", "s", square, False),
    ):
        flat.plot([], [], marker, color=color, **style, label=label)
        for first, last in stretches(np.isin(path.segment, codes)):
            rows = np.arange(max(first - (not at_end), 0), min(last + 1 + at_end, len(shown)))
            line, off = _finer(shown[rows], seen.towards[rows])
            for a, b in stretches(seen_in(seen.space, line, off)):
                solid.plot(*line[a : b + 1].T, color=color, lw=1.8, zorder=20)
            for a, b in stretches(seen_in(seen.above, line, off)):
                flat.plot(*seen.flat(line[a : b + 1]).T[:2], color=color, lw=1.4)
            touch = rows[-1] if at_end else rows[0]
            if seen.from_above[touch]:
                flat.plot(*seen.flat(shown[touch])[:2], marker, color=color, **style, zorder=20 + at_end)


def _finer(line: Array, off: Array) -> tuple[Array, Array]:
    """A line and its tool axes with points in between, so that it can go out of sight anywhere."""
    along = arc_length(line)
    places = np.union1d(along, np.linspace(0.0, along[-1], LEAD_POINTS))
    return interpolate(places, along, line), interpolate(places, along, off)


def _draw_axes(solid: Any, path: ToolPath, shown: Array, seen: _Seen) -> None:
    """Some tool axes as thin lines that stand on the path where it is seen."""
    process = np.flatnonzero(path.process)
    s = path.s[process]
    rows = process[
        np.unique(np.searchsorted(s, np.linspace(s[0], s[-1], AXES_SHOWN)).clip(0, len(process) - 1))
    ]
    rows = rows[seen.in_space[rows]]
    if not len(rows):
        return  # the part stands before all of them
    height = 0.06 * longest_side(shown[process])
    tips = shown[rows] + height * seen.towards[rows]
    lines = np.stack([shown[rows], tips], axis=1)
    solid.add_collection3d(Line3DCollection(lines, colors=GREY, lw=0.6, zorder=4))


def _draw_mends(solid: Any, flat: Axes, result: PlanResult, frame: Array, seen: _Seen) -> None:
    """Where the path was slowed, pressed with less or left out after it had been played in the cell."""
    slowed: dict[str, Any] = {"marker": "o", "mfc": "white", "mec": "black", "mew": 0.6, "ms": 3.0}
    eased = slowed | {"marker": "v", "mfc": SKY}
    left_out: dict[str, Any] = {"marker": "x", "color": "black", "mew": 0.9, "ms": 3.5}
    for what, style in ((SLOWED, slowed), (EASED, eased), (CUT, left_out)):
        places = [mend.places for mend in result.mends if mend.what == what]
        if not places:
            continue
        at = np.concatenate(places)
        at = at[:: max(1, len(at) // MOST_MARKS)] @ frame.T * MM
        solid.plot(*at.T, linestyle="none", zorder=25, **style)
        flat.plot(
            *seen.flat(at).T[:2], linestyle="none", zorder=25, label=f"{what} after playing it", **style
        )


def cross_out(axes: Any, place: Array) -> None:
    """Mark a protective stop's place in a picture's own frame [mm], shape (2,) or (3,)."""
    axes.plot(
        *place[:, None], "X", color=RED, ms=12, mec="white", mew=1.0, zorder=40, label="protective stop"
    )


def fill_view(solid: Any, points: Array) -> None:
    """Zoom and shift the view so that points (n, 3) fill it."""
    low, high = points.min(axis=0), points.max(axis=0)
    # A level part has no height of its own, a view needs some.
    high = np.maximum(high, low + LEAST_HEIGHT * (high - low).max())
    solid.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    solid.set_box_aspect(high - low)
    solid.view_init(elev=ELEVATION, azim=AZIMUTH)
    solid.set_axis_off()
    across = np.array(proj3d.proj_transform(*points.T, solid.get_proj())[:2])
    middle = 0.5 * (across.max(axis=1) + across.min(axis=1))
    half = 0.52 * np.ptp(across, axis=1).max()
    # The view is a square; its limits across are those of the picture plane, not of the part.
    for axis, place in zip(("intervalx", "intervaly"), middle, strict=True):
        setattr(solid.viewLim, axis, (place - half, place + half))


SMOOTH: dict[str, Any] = {"shading": "gouraud", "rasterized": True}  #: Colours between vertices


def seen_triangles(vertices: Array, normals: Array, triangles: Indices, views: Views) -> Triangulation:
    """The triangles (m, 3) of a mesh that face the viewer of its flat picture [mm]; all if none does."""
    places = vertices @ views.flat.T * MM
    facing = (normals[triangles] @ views.flat[2]).min(axis=1) > 0.0
    return Triangulation(places[:, 0], places[:, 1], triangles[facing if facing.any() else slice(None)])


def scale_flat(flat: Axes, views: Views) -> None:
    """Give a flat picture of a part equal scales in mm, its axes named after the part's."""
    flat.set_aspect("equal")
    flat.set(xlabel=views.labels[0], ylabel=views.labels[1])
    flat.xaxis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 5, 10]))


def _finish(figure: Figure, flat: Axes, scale: Normalize, views: Views) -> None:
    flat.autoscale_view()
    scale_flat(flat, views)
    figure.colorbar(ScalarMappable(scale, COLORS), ax=flat, label="along the path [m]", shrink=0.85, pad=0.02)


def _head(figure: Figure, flat: Axes, result: PlanResult, name: str, views: Views) -> None:
    """The heading, and under it how long and how dense the path is."""
    m = result.figures
    near, far = MM * m["stepover_p5_m"], MM * m["stepover_p95_m"]
    # A path without neighbouring turns has no spacing to show.
    beside = np.isfinite([near, far]).all()
    facts = (
        f"{m['path_length_m']:.2f} m in {m['retracts']} run{'s' if m['retracts'] != 1 else ''}",
        *(
            [f"step-over {MM * result.plan.stepover_m:g} mm, p5-p95 {near:.2f}-{far:.2f} mm"]
            if beside
            else []
        ),
        f"{100.0 * m['coverage']:.1f}% covered",
        f"right: {views.name}",
    )
    head(figure, f"{name} on {result.mesh.name}", facts, legend=(flat,))
