"""How near a taught path is to what the hand meant to show (layer 8c)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.planning.toolpath import ToolPath

Array = NDArray[np.float64]


def distance_to_line(points: Array, line: Array) -> Array:
    """Distances of points to a polyline [m].

    Args:
        points: Shape (n, 3).
        line: Shape (m, 3), its points near each other beside what the distances are.

    Returns:
        Shape (n,).
    """
    near = np.asarray(cKDTree(line).query(points)[1])
    best = np.full(len(points), np.inf)
    for first in (np.maximum(near - 1, 0), np.minimum(near, len(line) - 2)):
        chord = line[first + 1] - line[first]
        share = np.sum((points - line[first]) * chord, axis=1) / np.maximum(np.sum(chord**2, axis=1), 1e-300)
        foot = line[first] + np.clip(share, 0.0, 1.0)[:, None] * chord
        best = np.minimum(best, np.linalg.norm(points - foot, axis=1))
    return best


def measure_taught(recorded: Array, taught: ToolPath, meant: ToolPath) -> dict[str, float]:
    """Compare recording and taught path with the path that was meant.

    Args:
        recorded: Tool points while the hand moved, work frame [m], shape (n, 3).
        taught: What was made of them.
        meant: What the hand meant to show.

    Returns:
        recorded_deviation_max_m, _rms_m; taught_deviation_max_m, _rms_m: distances to the meant path;
        taught_missed_max_m: of the meant path to the taught one, so that nothing was left out;
        taught_axis_error_max_rad: tool axis against that of the nearest meant point; taught_length_m.
    """
    raw = distance_to_line(recorded, meant.positions_work)
    off = distance_to_line(taught.positions_work, meant.positions_work)
    missed = distance_to_line(meant.positions_work, taught.positions_work)
    near = np.asarray(cKDTree(meant.positions_work).query(taught.positions_work)[1])
    aligned = np.sum(taught.axes_work * meant.axes_work[near], axis=1)
    return {
        "recorded_deviation_max_m": float(raw.max()),
        "recorded_deviation_rms_m": float(np.sqrt(np.mean(raw**2))),
        "taught_deviation_max_m": float(off.max()),
        "taught_deviation_rms_m": float(np.sqrt(np.mean(off**2))),
        "taught_missed_max_m": float(missed.max()),
        "taught_axis_error_max_rad": float(np.arccos(np.clip(aligned, -1.0, 1.0)).max()),
        "taught_length_m": taught.length_m,
    }
