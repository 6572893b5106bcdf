"""A page that shows part and path in any browser, without a network (plan -> one HTML file).

The page is `viewer.html` with the meshes put into it; it fetches nothing.
"""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Mapping
from importlib import resources
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Bools, Indices, Ints
from polish_sim.exchange.strokes import ExportSetup, needed_rows
from polish_sim.geometry.lighter_mesh import lighter_mesh
from polish_sim.planning import PlanResult, ToolPath
from polish_sim.planning.toolpath import LINK, PROCESS
from polish_sim.spatial import perpendicular, unit

# The path as coloured triangles for viewers: a thin tube along it (plan -> Tube).

Colors = NDArray[np.uint8]

SIDES: Final = 5
RADIUS_SHARE: Final = 0.1  #: Radius of the tube in step-overs
SMALLEST_SHARE: Final = 0.001  #: Its least radius as a share of the part's size
CHORD_SHARE: Final = 0.25  #: Points of the path are left out where the tube moves by less than this share of its radius
BEND_RAD: Final = 0.35
PART_COLOR: Final = (176, 182, 190)
FIXTURE_COLOR: Final = (112, 124, 143)
LEAD_COLOR: Final = (230, 120, 20)
LEFT_OUT_COLOR: Final = (230, 159, 0)
IN_PART_COLOR: Final = (224, 0, 32)
VIRIDIS: Final = np.array(
    [(68, 1, 84), (72, 40, 120), (62, 74, 137), (49, 104, 142), (38, 130, 142)]
    + [(31, 158, 137), (53, 183, 121), (109, 205, 89), (180, 222, 44), (253, 231, 37)]
)
"""Ten steps of the colour map viridis."""


class Tube(NamedTuple):
    """The path as a closed surface of triangles."""

    vertices: Array  #: [m], work frame, shape (n, 3)
    faces: Ints  #: Shape (m, 3)
    colors: Colors  #: Red, green, blue of each vertex: along the path in contact, one colour in the air, shape (n, 3)
    s: Array  #: Arc length of the path at each vertex [m], shape (n,)
    contact: Bools  #: Whether the vertex belongs to the path in contact, shape (n,)


def path_tube(result: PlanResult) -> Tube:
    """Wrap the path in a thin tube, coloured along its length; every stretch in contact or in the air on its own."""
    size = float(np.ptp(result.mesh.vertices, axis=0).max())
    radius = max(RADIUS_SHARE * result.plan.stepover_m, SMALLEST_SHARE * size)
    path = result.path
    rows = needed_rows(path, CHORD_SHARE * radius, BEND_RAD, size)
    contact = np.isin(path.segment[rows], (PROCESS, LINK))
    changes = np.flatnonzero(np.diff(contact)) + 1
    pieces = []
    for first, last in zip([0, *changes], [*changes, len(rows)], strict=True):
        # Stretches in the air reach to the contact before and after them.
        reach = slice(first, last) if contact[first] else slice(max(first - 1, 0), min(last + 1, len(rows)))
        if len(rows[reach]) > 1:
            pieces.append(_stretch(path, rows[reach], bool(contact[first]), radius))
    return _joined(pieces)


def _stretch(path: ToolPath, rows: Indices, contact: bool, radius: float) -> Tube:
    middle = path.positions_work[rows]
    around = _rings(middle, path.axes_work[rows])
    vertices = (middle[:, None] + radius * around).reshape(-1, 3)
    s = np.repeat(path.s[rows], SIDES)
    colors = colors_along(s / path.s[-1]) if contact else np.tile(np.array(LEAD_COLOR, dtype=np.uint8), (len(s), 1))
    return Tube(vertices, _tube_faces(len(rows)), colors, s, np.full(len(s), contact))


def _rings(middle: Array, axes: Array) -> Array:
    """Unit vectors around each point, across the path, shape (n, SIDES, 3)."""
    tangent = unit(np.gradient(middle, axis=0))
    # Where the tool moves along its own axis the reference is any way across it.
    along = np.abs(np.sum(tangent * axes, axis=1, keepdims=True)) > 0.95
    side = unit(np.cross(tangent, np.where(along, perpendicular(axes), axes)))
    other = np.cross(side, tangent)
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    return np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * other[:, None]


def _tube_faces(rings: int) -> Ints:
    """Triangles between neighbouring rings and the two ends, outward."""
    k = np.arange(SIDES)
    here = (np.arange(rings - 1) * SIDES)[:, None] + k
    beside = (np.arange(rings - 1) * SIDES)[:, None] + (k + 1) % SIDES
    walls = np.concatenate(
        [
            np.stack([here, beside + SIDES, beside], axis=-1).reshape(-1, 3),
            np.stack([here, here + SIDES, beside + SIDES], axis=-1).reshape(-1, 3),
        ]
    )
    fan = np.stack([np.zeros(SIDES - 2, dtype=int), k[1:-1], k[2:]], axis=1)
    return np.concatenate([walls, fan, (rings - 1) * SIDES + fan[:, ::-1]]).astype(np.int32)


def colors_along(share: Array) -> Colors:
    """Colour of a share of the path, 0 to 1, shape (n, 3)."""
    steps = np.linspace(0.0, 1.0, len(VIRIDIS))
    return np.stack([np.interp(share, steps, VIRIDIS[:, k]) for k in range(3)], axis=1).round().astype(np.uint8)


def _joined(pieces: list[Tube]) -> Tube:
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces[:-1])])
    faces = [piece.faces + start for piece, start in zip(pieces, starts, strict=True)]
    return Tube(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate(faces).astype(np.int32),
        np.concatenate([piece.colors for piece in pieces]),
        np.concatenate([piece.s for piece in pieces]),
        np.concatenate([piece.contact for piece in pieces]),
    )


MM: Final = 1e3
MOST_FACETS: Final = 60_000  #: A finer part is shown by a lighter copy: the page stays below some 3 MB
FIGURES: Final[tuple[tuple[str, str, float, str], ...]] = (
    ("path in contact", "path_length_m", 1.0, "{:.2f} m"),
    ("cycle time", "cycle_time_s", 1.0, "{:.0f} s"),
    ("step-over, mean", "stepover_mean_m", MM, "{:.2f} mm"),
    ("step-over, p5", "stepover_p5_m", MM, "{:.2f} mm"),
    ("step-over, p95", "stepover_p95_m", MM, "{:.2f} mm"),
    ("covered by the pad", "coverage", 100.0, "{:.1f} %"),
    ("within 0.55 step-overs", "coverage_stepover", 100.0, "{:.1f} %"),
    ("out of the tool's reach", "unreachable_area_m2", 1e4, "{:.3g} cm²"),
    ("tool in the part, at most", "pad_in_part_max_m", MM, "{:.3g} mm"),
    ("crossings", "self_crossings", 1.0, "{:.0f}"),
    ("retracts", "retracts", 1.0, "{:.0f}"),
    ("facets of the part", "facets", 1.0, "{:.0f}"),
)
"""Rows of the page's table: name, key in metrics.json, factor, format."""


def html_text(result: PlanResult, setup: ExportSetup) -> str:
    """Write part and path as one interactive HTML page; every writer takes a setup, this one needs none."""
    page = resources.files("polish_sim.exchange").joinpath("viewer.html").read_text(encoding="utf-8")
    title = html.escape(f"{result.plan.pattern} on {result.mesh.name}")
    # "<" must not appear in a script element: the part's name could close it.
    data = json.dumps(_data(result), separators=(",", ":")).replace("<", "\\u003c")
    return page.replace("@TITLE@", title).replace("@DATA@", data)


def _data(result: PlanResult) -> dict[str, Any]:
    tube = path_tube(result)
    vertices, faces = lighter_mesh(result.mesh.vertices, result.mesh.faces, MOST_FACETS)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = 0.5 * (low + high)
    return {
        "part": _solid_data(vertices, faces, middle, PART_COLOR),
        "fixture": _solid_data(*_fixture_mesh(result), middle, FIXTURE_COLOR),
        "path": _tube_data(tube, tube.contact, middle),
        "leads": _tube_data(tube, ~tube.contact, middle),
        "marks": _marks(result, middle),
        "mark_colors": [LEFT_OUT_COLOR, IN_PART_COLOR],
        "scale": VIRIDIS.tolist(),
        "lead_color": LEAD_COLOR,
        "length_m": result.path.length_m,
        "size_mm": MM * float(np.linalg.norm(high - low)),
        # The lighter part may stand above the path by some of its grid: the path is drawn that much nearer.
        "lift_mm": MM * 0.004 * float(np.ptp(vertices, axis=0).max()),
        "up": [float(value) for value in result.mesh.up],
        "figures": _figures(result.figures),
    }


def _fixture_mesh(result: PlanResult) -> tuple[Array, Ints]:
    """Vertices and faces of what holds the part, of no triangles if nothing does."""
    fixture = result.tool.fixture
    if fixture is None:
        return np.empty((0, 3)), np.empty((0, 3), np.int32)
    return lighter_mesh(fixture.mesh.vertices, fixture.mesh.faces, MOST_FACETS)


def _solid_data(vertices: Array, faces: Ints, middle: Array, color: tuple[int, ...]) -> dict[str, Any]:
    return {"vertices": _packed(MM * (vertices - middle), "<f4"), "faces": _packed(faces, "<u4"), "color": color}


def _tube_data(tube: Tube, kept: Bools, middle: Array) -> dict[str, str]:
    """The part of the tube made of some vertices, numbered anew."""
    faces = tube.faces[kept[tube.faces].all(axis=1)]
    numbers = np.cumsum(kept) - 1
    return {
        "vertices": _packed(MM * (tube.vertices[kept] - middle), "<f4"),
        "faces": _packed(numbers[faces], "<u4"),
        "colors": _packed(tube.colors[kept], "u1"),
        "along": _packed(tube.s[kept], "<f4"),
    }


def _marks(result: PlanResult, middle: Array) -> dict[str, str]:
    """What the tool does not reach, and a red chip wherever it is in the part."""
    out = np.empty((0, 3, 3)) if result.access is None else result.access.triangles
    size, way = 0.3 * result.plan.stepover_m, np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.3], [0.0, -0.3, 0.9]])
    corners = np.concatenate([out, result.in_part[:, None] + size * way])
    colors = np.repeat([LEFT_OUT_COLOR, IN_PART_COLOR], [3 * len(out), 3 * len(result.in_part)], axis=0)
    return {
        "vertices": _packed(MM * (corners.reshape(-1, 3) - middle), "<f4"),
        "faces": _packed(np.arange(3 * len(corners)), "<u4"),
        "colors": _packed(colors, "u1"),
    }


def _packed(values: NDArray[Any], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def _figures(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = []
    for name, key, factor, form in FIGURES:
        value = figures.get(key)
        if value is not None:
            rows.append((name, "-" if math.isnan(value) else form.format(factor * value)))
    return rows


# Part and coloured path for 3D viewers: PLY and glTF (plan -> mesh files).

GLTF_FROM_WORK = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
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
    tube = path_tube(result)
    grey = np.tile(np.array(PART_COLOR, dtype=np.uint8), (len(result.mesh.vertices), 1))
    return _mesh(result.mesh.vertices, result.mesh.faces, grey), _mesh(tube.vertices, tube.faces, tube.colors)


def _mesh(vertices: Array, faces: Ints, colors: NDArray[np.uint8]) -> Any:
    import trimesh  # slow to import

    return trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
