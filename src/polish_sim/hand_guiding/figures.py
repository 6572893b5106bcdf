"""What a hand feels of an arm it guides, and what the arm does without it."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Figures, dots, norms, rms
from polish_sim.planning.toolpath import ToolPath
from polish_sim.spatial import foot_on_chord

COAST_S = 1.0  #: A released arm may roll out for this long; what it moves then is drift [s]
#: Compared with the classical mode, and how their figures begin
RATIOS = {"inertia": "", "assist": "assist_"}


def measure_move(force: Array, whole: bool, lent_j: float) -> Figures:
    """The hand's force (n, 3) [N] while it moves, undefined if the move was cut short; the energy lent.

    hand_force_peak_n, hand_force_rms_n: of its norm; lent_energy_j: most the compensation had lent beyond
    what friction took.
    """
    sizes = norms(force)
    known = whole and len(sizes) > 0
    return {
        "hand_force_peak_n": float(sizes.max()) if known else math.nan,
        "hand_force_rms_n": rms(sizes) if known else math.nan,
        "lent_energy_j": lent_j,
    }


def measure_drift(time: Array, q: Array) -> Figures:
    """What the joints (n, 6) do after the hand has released it, at times (n,) [s].

    coast_rad: largest way of a joint in the first second; drift_rad: from then on, to the end; drift_time_s:
    how long that is. Undefined if it was not released or for no longer than that.
    """
    if not len(time) or time[-1] - time[0] <= COAST_S:
        return {"coast_rad": math.nan, "drift_rad": math.nan, "drift_time_s": 0.0}
    rolled = np.searchsorted(time, time[0] + COAST_S)
    return {
        "coast_rad": float(np.abs(q[: rolled + 1] - q[0]).max()),
        "drift_rad": float(np.abs(q[rolled:] - q[rolled]).max()),
        "drift_time_s": float(time[-1] - time[rolled]),
    }


def compare_modes(moves: Mapping[str, Figures]) -> Figures:
    """Modes beside each other, from figures by ``mode_direction_pace``; only if both moves exist, undefined
    if cut short.

    fast_peak_ratio_x, ... : force with inertia compensation by that of the classical law, fast move
    (``assist_`` before
    it: with the start-up assist); slow_peak_n: largest of the assist's slow moves.
    """
    figures: Figures = {}
    for mode, prefix in RATIOS.items():
        for direction in ("x", "y"):
            ours, theirs = (moves.get(f"{name}_{direction}_fast") for name in (mode, "classical"))
            if ours is None or theirs is None:
                continue
            for what in ("peak", "rms"):
                name = f"hand_force_{what}_n"
                figures[f"{prefix}fast_{what}_ratio_{direction}"] = ours[name] / theirs[name]
    for figure, some in (("none", "none_*"), ("classical", "classical_*"), ("slow", "assist_[xy]_slow")):
        forces = [moves[name]["hand_force_peak_n"] for name in fnmatch.filter(moves, some)]
        if forces:
            figures[f"{figure}_peak_n"] = float(np.max(forces))
    return figures


# How near a taught path is to what the hand meant to show.


def distance_to_line(points: Array, line: Array) -> Array:
    """Distances (n,) [m] of points (n, 3) to a dense polyline (m, 3)."""
    near = np.asarray(cKDTree(line).query(points)[1])
    best = np.full(len(points), np.inf)
    for first in (np.maximum(near - 1, 0), np.minimum(near, len(line) - 2)):
        away, chord = points - line[first], line[first + 1] - line[first]
        best = np.minimum(best, foot_on_chord(away, chord)[1])
    return best


def measure_taught(recorded: Array, taught: ToolPath, meant: ToolPath) -> dict[str, float]:
    """Compare the recorded tool points (n, 3), work frame, and the path taught from them with the path that
    was meant.

    recorded_deviation_max_m, _rms_m; taught_deviation_max_m, _rms_m: distances to the meant path;
    taught_missed_max_m: of the meant path to the taught one, so that nothing was left out;
    taught_axis_error_max_rad: tool axis against that of the nearest meant point; taught_length_m.
    """
    raw = distance_to_line(recorded, meant.positions_work)
    off = distance_to_line(taught.positions_work, meant.positions_work)
    missed = distance_to_line(meant.positions_work, taught.positions_work)
    near = np.asarray(cKDTree(meant.positions_work).query(taught.positions_work)[1])
    aligned = dots(taught.axes_work, meant.axes_work[near])
    return {
        "recorded_deviation_max_m": float(raw.max()),
        "recorded_deviation_rms_m": rms(raw),
        "taught_deviation_max_m": float(off.max()),
        "taught_deviation_rms_m": rms(off),
        "taught_missed_max_m": float(missed.max()),
        "taught_axis_error_max_rad": float(np.arccos(np.clip(aligned, -1.0, 1.0)).max()),
        "taught_length_m": taught.length_m,
    }
