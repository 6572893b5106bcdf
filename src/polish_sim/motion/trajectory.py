"""A tool path as a callable of its arc length: a dense table that compiled loops can sample."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array, Indices, Ints, dots, midpoints, norms, running_sums
from polish_sim.kernel_cache import njit
from polish_sim.spatial import unit, wxyz


class PathTable(NamedTuple):
    """Poses along a path at equal steps of arc length, base frame."""

    spacing: float  #: Arc length between rows [m]
    length: float  #: Arc length of the whole path [m]; 0 for a single pose
    positions: Array  #: Tool points [m], shape (n, 3)
    tangents: Array  #: Derivative of position by arc length [-], shape (n, 3)
    quaternions: Array  #: R_base_tool as wxyz, without sign jumps, shape (n, 4)
    turning: Array  #: Rotation per arc length [rad/m], base frame, shape (n, 3)
    curvature: Array  #: Normal curvature along the path [1/m], shape (n,)
    pass_index: Ints  #: Turn of the path, shape (n,)
    feed_share: Array  #: Feed as a share of the stroke's [-], shape (n,); ones unless the path says otherwise


def build_path_table(
    positions: Array,
    rotations: Array,
    s: Array | None = None,
    curvature: Array | None = None,
    pass_index: Indices | None = None,
    spacing: float = 0.0005,
) -> PathTable:
    """Resample poses to equal steps of arc length; cubic in position, shortest turn in orientation.

    ``positions`` are (n, 3) [m], repeated points are dropped; ``rotations`` R_base_tool (n, 3, 3). ``s`` (n,)
    [m], strictly increasing, is the arc length to go by: a pressed path keeps that of the surface; the
    points' own if not given. ``curvature`` (n,) [1/m] is the normal curvature along the path, ``pass_index``
    (n,) the turn of each point; zero if not given. Rows are about ``spacing`` [m] apart.
    """
    own = running_sums(norms(np.diff(positions, axis=0)))
    place = own if s is None else s - s[0]
    kept = np.concatenate([[True], np.diff(place) > 1e-9])
    place, points, frames = place[kept], positions[kept], rotations[kept]
    bend = np.zeros(len(points)) if curvature is None else curvature[kept]
    turns = np.zeros(len(points), np.int32) if pass_index is None else pass_index[kept].astype(np.int32)
    length = place[-1]
    if len(points) == 1:
        place, points = np.array([0.0, spacing]), np.repeat(points, 2, axis=0)
        frames, bend, turns = np.repeat(frames, 2, axis=0), np.repeat(bend, 2), np.repeat(turns, 2)
    nodes = np.linspace(0.0, float(place[-1]), max(2, math.ceil(place[-1] / spacing) + 1))
    curve = CubicSpline(place, points, axis=0, bc_type="natural")
    step = nodes[1] - nodes[0]
    quaternions = _interpolate_quaternions(place, continuous_quaternions(frames), nodes)
    return PathTable(
        step,
        length,
        np.ascontiguousarray(curve(nodes)),
        np.ascontiguousarray(curve(nodes, 1)),
        quaternions,
        _turning(quaternions, step),
        np.interp(nodes, place, bend),
        turns[np.clip(np.searchsorted(place, nodes, side="right") - 1, 0, len(place) - 1)],
        np.ones(len(nodes)),
    )


def at_rows(table: PathTable, s: Array, values: Array) -> Array:
    """Values (n,) given at arc lengths ``s`` (n,) [m] of a table's points, interpolated linearly at its
    rows."""
    return np.interp(np.arange(len(table.positions)) * table.spacing, s - s[0], values)


def with_feed_share(table: PathTable, s: Array, feed_share: Array) -> PathTable:
    """Give a table a feed that changes along the path, linear between the points it was made of, at ``s``
    (n,) [m]; ``feed_share`` (n,) is positive, a share of the stroke's feed."""
    return table._replace(feed_share=at_rows(table, s, feed_share))


@njit
def slowed_before(speeds: Array, gain: float) -> Array:
    """Lower speeds (n,) before slow places so that their square falls by no more than ``gain`` from row to
    row."""
    out = speeds.copy()
    for row in range(len(out) - 2, -1, -1):
        out[row] = min(out[row], math.sqrt(out[row + 1] ** 2 + gain))
    return out


def continuous_quaternions(rotations: Array) -> Array:
    """Rotations (n, 3, 3) as quaternions wxyz whose signs do not jump, shape (n, 4)."""
    quaternions = wxyz(rotations)
    turned = dots(quaternions[1:], quaternions[:-1]) < 0.0
    quaternions[1:] *= np.cumprod(np.where(turned, -1.0, 1.0))[:, None]
    return np.ascontiguousarray(quaternions)


def _interpolate_quaternions(s: Array, continuous: Array, nodes: Array) -> Array:
    blended = np.stack([np.interp(nodes, s, continuous[:, i]) for i in range(4)], axis=1)
    return np.ascontiguousarray(unit(blended))


def _turning(quaternions: Array, step: float) -> Array:
    frames = Rotation.from_quat(quaternions, scalar_first=True)
    between = (frames[1:] * frames[:-1].inv()).as_rotvec() / step
    at_nodes = np.empty((len(quaternions), 3))
    at_nodes[0], at_nodes[-1] = between[0], between[-1]
    at_nodes[1:-1] = midpoints(between)
    return at_nodes


@njit(forceinline=True)
def blend_cubic(
    points: Array, slopes: Array, row: int, u: float, h: float, point: Array, slope: Array
) -> None:
    """Cubic Hermite interpolation a share ``u`` of the way from a row to the next, ``h`` apart, with its
    derivative.

    ``points`` and their derivatives ``slopes`` are (n, 3), ``point`` and ``slope`` (3,) are written.
    """
    h00, h10 = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u * (1.0 - u) ** 2
    h01, h11 = u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
    d00, d10, d11 = 6.0 * u * (u - 1.0), (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
    for i in range(3):
        p0, p1, t0, t1 = points[row, i], points[row + 1, i], slopes[row, i], slopes[row + 1, i]
        point[i] = h00 * p0 + h01 * p1 + h * (h10 * t0 + h11 * t1)
        slope[i] = d00 * (p0 - p1) / h + d10 * t0 + d11 * t1


@njit(forceinline=True)
def blend_linear(rows: Array, row: int, u: float, out: Array) -> None:
    """Write what lies a share ``u`` of the way from a row of a table (n, d) to the next."""
    for i in range(rows.shape[1]):
        out[i] = (1.0 - u) * rows[row, i] + u * rows[row + 1, i]


@njit(forceinline=True)
def normalize(quaternion: Array) -> None:
    """Scale a quaternion, shape (4,), to length one."""
    size = 0.0
    for i in range(4):
        size += quaternion[i] ** 2
    size = math.sqrt(size)
    for i in range(4):
        quaternion[i] /= size


@njit(forceinline=True)
def sample_path(
    table: PathTable, s: float, position: Array, tangent: Array, quaternion: Array, turning: Array
) -> int:
    """Evaluate a path at arc length ``s`` [m] (clamped to its ends); returns the row of the table at or
    before it.

    Written are the tool point [m] and its derivative ``tangent``, (3,) each, R_base_tool as unit quaternion
    wxyz (4,), and the rotation per arc length ``turning`` [rad/m], (3,).
    """
    place = min(max(s, 0.0), table.length) / table.spacing
    row = min(int(place), table.positions.shape[0] - 2)
    u = place - row
    blend_cubic(table.positions, table.tangents, row, u, table.spacing, position, tangent)
    blend_linear(table.turning, row, u, turning)
    blend_linear(table.quaternions, row, u, quaternion)
    normalize(quaternion)
    return row


@njit(forceinline=True)
def sample_column(table: PathTable, column: Array, s: float) -> float:
    """A column of the rows at arc length ``s`` [m] (clamped to the path's ends); exact between equal
    values."""
    place = min(max(s, 0.0), table.length) / table.spacing
    row = min(int(place), column.shape[0] - 2)
    return float(column[row] + (place - row) * (column[row + 1] - column[row]))
