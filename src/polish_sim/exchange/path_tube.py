"""The path as coloured triangles for viewers: a thin tube along it (plan -> Tube)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.exchange.needed_rows import needed_rows
from polish_sim.planning import PlanResult, ToolPath
from polish_sim.planning.toolpath import LINK, PROCESS
from polish_sim.spatial import perpendicular, unit

Array = NDArray[np.float64]
Colors = NDArray[np.uint8]

SIDES: Final = 5
RADIUS_SHARE: Final = 0.1
"""Radius of the tube in step-overs."""
SMALLEST_SHARE: Final = 0.001
"""Its least radius as a share of the part's size."""
CHORD_SHARE: Final = 0.25
"""Points of the path are left out where the tube moves by less than this share of its radius."""
BEND_RAD: Final = 0.35
PART_COLOR: Final = (176, 182, 190)
LEAD_COLOR: Final = (230, 120, 20)
VIRIDIS: Final = np.array(
    [(68, 1, 84), (72, 40, 120), (62, 74, 137), (49, 104, 142), (38, 130, 142)]
    + [(31, 158, 137), (53, 183, 121), (109, 205, 89), (180, 222, 44), (253, 231, 37)]
)
"""Ten steps of the colour map viridis."""


class Tube(NamedTuple):
    """The path as a closed surface of triangles."""

    vertices: Array
    """[m], work frame, shape (n, 3)."""
    faces: NDArray[np.int32]
    """Shape (m, 3)."""
    colors: Colors
    """Red, green, blue of each vertex: along the path in contact, one colour in the air, shape (n, 3)."""
    s: Array
    """Arc length of the path at each vertex [m], shape (n,)."""
    contact: NDArray[np.bool_]
    """Whether the vertex belongs to the path in contact, shape (n,)."""


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


def _stretch(path: ToolPath, rows: NDArray[np.int64], contact: bool, radius: float) -> Tube:
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


def _tube_faces(rings: int) -> NDArray[np.int32]:
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
