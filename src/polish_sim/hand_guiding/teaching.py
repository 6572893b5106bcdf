"""From a recorded way of the tool to a path: filtered, simplified, fitted, put on the part (recording ->
ToolPath)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_lsq_spline
from scipy.signal import butter, sosfiltfilt

from polish_sim.arrays import Array, Indices
from polish_sim.errors import PlanError
from polish_sim.geometry import Surface
from polish_sim.geometry.surface import ClosestPoints
from polish_sim.hand_guiding.figures import distance_to_chord
from polish_sim.planning.toolpath import PROCESS, ToolPath, arc_length, interpolate
from polish_sim.spatial import unit

DEGREE = 3
MOVING_SHARE = 0.2  #: A hand slower than this share of its usual speed has not begun, or has ended [-]
SHORTEST_M = 0.01  #: Less way than this teaches nothing [m]
#: The recording is fitted at places this far apart, so that a slow hand does not weigh more [m]
EVEN_M = 0.0005


class Recording(NamedTuple):
    """Where the tool was, in the work frame."""

    time: Array  #: Evenly spaced [s], shape (n,)
    positions: Array  #: Tool point [m], shape (n, 3)


class Taught(NamedTuple):
    """A path that was taught."""

    path: ToolPath
    knots: int  #: Corners of the simplified recording, which are the knots of the fit
    off_surface: float  #: Largest distance by which the fitted way was moved onto the part [m]


def teach_path(
    record: Recording, surface: Surface, filter_hz: float, tolerance: float, spacing: float
) -> Taught:
    """Make a path, all of it process, from a recording.

    Args:
        record: The recording; hardly moved: PlanError.
        surface: The part it was shown on: points are put on it, its normals become tool axes.
        filter_hz: Low-pass, forth and back [Hz].
        tolerance: The filtered way is simplified within this distance [m].
        spacing: Distance of the path's points [m].
    """
    way = _even(_moving(record, filter_hz))
    s = arc_length(way)
    corners = simplified(way, tolerance)
    at = np.linspace(0.0, s[-1], max(2, round(s[-1] / spacing)) + 1)
    points = np.asarray(make_lsq_spline(s, way, _knots(s, s[corners]), DEGREE)(at))
    found = surface.closest(points)
    off = np.linalg.norm(points - found.positions, axis=1).max()
    return Taught(path_through(surface, found), len(corners), off)


def path_through(surface: Surface, found: ClosestPoints) -> ToolPath:
    """A path through points of a part, all of it process; the part's normals are the tool axes."""
    along = unit(np.gradient(found.positions, axis=0))
    return _path(
        found.positions, found.normals, surface.normal_curvature(found.facets, found.barycentric, along)
    )


def simplified(points: Array, tolerance: float) -> Indices:
    """Rising indices of a polyline (n, 3) within ``tolerance`` [m] of all its points (Douglas and
    Peucker)."""
    kept = {0, len(points) - 1}
    stack = [(0, len(points) - 1)]
    while stack:
        first, last = stack.pop()
        if last - first < 2:
            continue
        off = distance_to_chord(points[first + 1 : last], points[first], points[last])
        furthest = int(off.argmax())
        if off[furthest] > tolerance:
            middle = first + 1 + furthest
            kept.add(middle)
            stack += [(first, middle), (middle, last)]
    return np.array(sorted(kept))


def _moving(record: Recording, filter_hz: float) -> Array:
    """The low-passed way from where the hand begins to where it ends."""
    rate = 1.0 / np.median(np.diff(record.time))
    sections = butter(2, min(filter_hz / (0.5 * rate), 0.99), output="sos")
    positions = np.asarray(sosfiltfilt(sections, record.positions, axis=0))
    speed = np.linalg.norm(np.gradient(positions, record.time, axis=0), axis=1)
    usual = np.percentile(speed, 75)
    going = np.flatnonzero(speed > MOVING_SHARE * usual)
    whole = slice(int(going[0]), int(going[-1]) + 1) if len(going) else slice(0, 0)
    length = float(arc_length(positions[whole])[-1]) if len(going) > 1 else 0.0
    if length < SHORTEST_M:
        raise PlanError(
            f"the tool was moved by {1e3 * length:.2f} mm: too little to teach a path. Drag it further than "
            f"{1e3 * SHORTEST_M:g} mm."
        )
    return positions[whole]


def _even(positions: Array) -> Array:
    """The same way at even distances."""
    s = arc_length(positions)
    rising = np.concatenate([[True], np.diff(s) > 0.0])
    at = np.linspace(0.0, s[-1], max(8 * (DEGREE + 1), math.ceil(s[-1] / EVEN_M)))
    return interpolate(at, s[rising], positions[rising])


def _knots(s: Array, corners: Array) -> Array:
    """Knots of a spline at the corners, those left out between which the recording has too few places."""
    least = (DEGREE + 2) * (s[1] - s[0])
    kept = [0.0]
    for place in corners[1:-1]:
        if place - kept[-1] >= least and s[-1] - place >= least:
            kept.append(float(place))
    ends = np.full(DEGREE + 1, 0.0), np.full(DEGREE + 1, s[-1])
    return np.concatenate([ends[0], kept[1:], ends[1]])


def _path(positions: Array, axes: Array, curvature: Array) -> ToolPath:
    moved = np.concatenate([[True], np.linalg.norm(np.diff(positions, axis=0), axis=1) > 1e-6])
    positions = positions[moved]
    axes = axes[moved]
    curvature = curvature[moved]
    n = len(positions)
    return ToolPath(
        positions.copy(),
        axes.copy(),
        arc_length(positions),
        np.zeros(n, np.int64),
        np.full(n, PROCESS, np.int8),
        curvature.copy(),
    )
