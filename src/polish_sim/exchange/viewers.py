"""A plan as a page for any browser, and as a mesh for 3D viewers (plan -> HTML, PLY, glTF)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from polish_sim.arrays import (
    Array,
    Ints,
    longest_side,
    midpoints,
    perpendicular,
    plane_axes,
    running_sums,
    unit,
)
from polish_sim.exchange.strokes import ExportSetup, feeds_of, forces_of, needed_rows
from polish_sim.geometry.mesh import lighter_mesh
from polish_sim.page.page import (
    Line,
    Motion,
    Page,
    PageBody,
    Plot,
    Solid,
    Wear,
    cylinder,
    free_tool,
    page_html,
)
from polish_sim.planning import PlanResult
from polish_sim.planning.ground import triangulate
from polish_sim.planning.part_plan import EASED, SLOWED
from polish_sim.planning.quality.areas import FAR
from polish_sim.planning.quality.figures import path_table
from polish_sim.planning.toolpath import LINK, PROCESS
from polish_sim.spatial import rotation_to_axis, transform

SIDES = 5  #: Of a rod
RADIUS_SHARE = 0.1  #: Radius of the rods in step-overs
SMALLEST_SHARE = 0.001  #: Its least radius as a share of the part's size
#: Points of the path are left out where the rods move by less than this share of their radius
CHORD_SHARE = 0.25
BEND_RAD = 0.35
PART_COLOR = (176, 182, 190)
FIXTURE_COLOR = (112, 124, 143)
LEAD_COLOR = (230, 120, 20)
LEFT_OUT_COLOR = (230, 159, 0)
FAR_COLOR = (240, 228, 66)
IN_PART_COLOR = (224, 0, 32)
MENDED_COLORS = {SLOWED: (255, 255, 255), EASED: (86, 180, 233)}


def path_rods(result: PlanResult) -> Any:
    """The path as a mesh of a thin rod for each of its chords, coloured along its length in contact."""
    import trimesh  # slow to import
    from matplotlib import colormaps  # slow to import

    path, size = result.path, longest_side(result.mesh.vertices)
    radius = max(RADIUS_SHARE * result.plan.stepover_m, SMALLEST_SHARE * size)
    rows = needed_rows(path, CHORD_SHARE * radius, BEND_RAD, size)
    ends, contact = path.positions_work[rows], np.isin(path.segment[rows], (PROCESS, LINK))
    along = np.diff(ends, axis=0)
    rod: Any = trimesh.creation.cylinder(radius, 1.0, sections=SIDES)
    turned = rod.vertices @ np.stack([*plane_axes(unit(along)), along], axis=1)
    faces = rod.faces + len(rod.vertices) * np.arange(len(along))[:, None, None]
    colors = colormaps["viridis"](midpoints(path.s[rows]) / path.s[-1], bytes=True)[:, :3]
    colors = np.where((contact[1:] & contact[:-1])[:, None], colors, LEAD_COLOR)
    places = midpoints(ends)[:, None] + turned
    return _mesh(places.reshape(-1, 3), faces.reshape(-1, 3), np.repeat(colors, len(rod.vertices), axis=0))


# The plan as a page for the browser, without a robot: part, path, and the pad going along it (plan -> Page).

MM = 1e3
MOST_FACETS = 60_000  #: A finer part is shown by a lighter copy
MOST_NODES = 40_000  #: Of the mesh on which the removal is predicted, about
AIR_SPEED = 0.05  #: Of the tool in the air [m/s]
SHAFT_RADIUS, SHAFT_LENGTH = 0.009, 0.07  #: Of the shaft drawn behind the pad [m]
PAD_COLOR, SHAFT_COLOR = (0.93, 0.62, 0.18), (0.55, 0.57, 0.60)


def html_text(result: PlanResult, setup: ExportSetup) -> str:
    """Write part and path as one interactive HTML page."""
    return page_html(path_page(result, setup))


def path_page(result: PlanResult, setup: ExportSetup) -> Page:
    """The plan as a page: in contact at the feed, through the air at a usual speed."""
    path, (up,) = result.path, rotation_to_axis(result.mesh.up[None], perpendicular(result.mesh.up[None])[0])
    standing = PageBody(-1, transform(up.T, np.zeros(3)).tolist())
    bodies, joints = free_tool(path.positions_work, path.axes_work)
    pace = np.where(path.process, feeds_of(path, setup), AIR_SPEED)
    time = running_sums(np.diff(path.s) / np.minimum(pace[1:], pace[:-1]))
    force = np.where(path.process, forces_of(path, setup), 0.0)
    motion = Motion(
        time=time,
        joints=joints,
        pad=path.positions_work @ up,
        force=force,
        asked=np.where(path.process, force, np.nan),
        speed=pace,
        error=np.zeros(len(time)),
        curvature=path.curvature,
    )
    pad = cylinder(result.tool.pad.radius_m, 0.012, -0.012), PAD_COLOR
    shaft = cylinder(SHAFT_RADIUS, SHAFT_LENGTH, -SHAFT_LENGTH), SHAFT_COLOR
    tool = [Solid("arm", len(bodies), vertices, faces, color) for (vertices, faces), color in (pad, shaft)]
    return Page.of(
        f"{result.plan.pattern} on {result.mesh.name}",
        "a planned path; the removal is predicted from force, speed and spindle",
        [path_table("Figures", result.figures)],
        result.notes,
    )._replace(
        bodies=[standing, *bodies],
        solids=[*part_solids(result), *tool],
        part_body=0,
        motion=motion,
        path=path.positions_work,
        contact=path.process.astype(np.float64),
        wear=predicted_wear(result, setup),
        plots=path_plots(motion),
        view="part",
    )


def part_solids(result: PlanResult) -> list[Solid]:
    """Part and fixture, what is left out of the region, and a chip wherever it is in the part."""
    vertices, faces = lighter_mesh(result.mesh.vertices, result.mesh.faces, MOST_FACETS)
    solids = [_solid("part", vertices, faces, PART_COLOR)]
    if result.tool.fixture:
        fixture = result.tool.fixture.mesh
        solids.append(
            _solid("fixture", *lighter_mesh(fixture.vertices, fixture.faces, MOST_FACETS), FIXTURE_COLOR)
        )
    size = 0.3 * result.plan.stepover_m
    way = np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.3], [0.0, -0.3, 0.9]])
    spots = {"tool in the part": [result.in_part]}
    for what in MENDED_COLORS:
        spots[what] = [np.empty((0, 3)), *(mend.places for mend in result.mends if mend.what == what)]
    chips = {what: np.concatenate(places)[:, None] + size * way for what, places in spots.items()}
    colors = {FAR: FAR_COLOR, "tool in the part": IN_PART_COLOR, **MENDED_COLORS}
    for kind, corners in (result.area.marked | chips).items():
        if len(corners):
            triangles = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
            solids.append(_solid(kind, corners.reshape(-1, 3), triangles, colors.get(kind, LEFT_OUT_COLOR)))
    return solids


def _solid(kind: str, vertices: Array, faces: Ints, color: tuple[int, ...]) -> Solid:
    return Solid(kind, 0, vertices, faces, [value / 255.0 for value in color])


def predicted_wear(result: PlanResult, setup: ExportSetup) -> Wear:
    """The mesh on which the page predicts the removal; the pad is not finer than a tenth of its radius."""
    surface = result.region.surface
    radius = result.tool.pad.radius_m
    longest = max(0.15 * radius, 2.0 * math.sqrt(float(surface.facet_areas.sum()) / MOST_NODES))
    nodes = triangulate(surface, longest)
    spin = setup.spindle.speed_rpm * 2.0 * math.pi / 60.0
    return Wear(
        nodes.vertices,
        nodes.triangles.astype(np.int32),
        np.empty(0),
        "removal, predicted",
        "× its mean",
        2.0,
        radius,
        spin,
    )


def path_plots(motion: Motion) -> list[Plot]:
    """Speed, curvature and force along a plan."""
    pressing = np.isfinite(motion.asked)
    plots = [
        Plot("Tool speed", "mm/s", [Line("speed", MM * motion.speed)]),
        Plot(
            "Curvature along the path",
            "1/m",
            [Line("curvature", np.where(pressing, motion.curvature, np.nan))],
        ),
        Plot("Force to press with", "N", [Line("force", motion.force)]),
    ]
    return [plot for plot in plots if np.nan_to_num(plot.lines[0].values).any()]


# Part and coloured path for 3D viewers: PLY and glTF (plan -> mesh files).

GLTF_FROM_WORK = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""glTF's y is up; the work frame's z mostly is."""


def ply_bytes(result: PlanResult, setup: ExportSetup) -> bytes:
    """Part and path as one binary PLY with a colour per vertex, metres, work frame."""
    import trimesh  # slow to import

    part, path = _meshes(result)
    both: Any = trimesh.util.concatenate([part, path])
    return bytes(both.export(file_type="ply"))


def glb_bytes(result: PlanResult, setup: ExportSetup) -> bytes:
    """Part and path as two named meshes of one binary glTF, metres, y up as glTF has it."""
    import trimesh  # slow to import

    part, path = _meshes(result)
    scene: Any = trimesh.Scene()
    scene.add_geometry(part, geom_name="part", node_name="part", transform=GLTF_FROM_WORK)
    scene.add_geometry(path, geom_name="path", node_name="path", transform=GLTF_FROM_WORK)
    return bytes(scene.export(file_type="glb"))


def _meshes(result: PlanResult) -> tuple[Any, Any]:
    return _mesh(result.mesh.vertices, result.mesh.faces, PART_COLOR), path_rods(result)


def _mesh(vertices: Array, faces: Any, colors: Any) -> Any:
    import trimesh  # slow to import

    return trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
