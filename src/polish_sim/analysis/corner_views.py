"""Which corners of a smoothed path are worth a look, and what is seen there (Chain, Schedule -> CornerView; 8c)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.corner_plot import LEAST_VIEW_M, SHOWN, VIEW, CornerView, flat_view
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.deviation import Deviation, vertex_distances
from polish_sim.motion.smoothing.deviation_curve import deviation_curve
from polish_sim.motion.smoothing.sampling import sample_schedule
from polish_sim.motion.smoothing.schedule import Schedule

Array = NDArray[np.float64]

LEAST_TURN: Final = 1e-4
"""A way point the path turns less at is no corner [rad]."""
SAMPLES: Final = 1500
"""Of each way through a view."""
WINDOW: Final = 12
"""The view's path is made of so many way points to either side."""


class Way(NamedTuple):
    """One rule's motion, with when it comes nearest to each way point of the path."""

    chain: Chain
    schedule: Schedule
    distances: Array
    """[m], shape (n + 1,)."""
    times: Array
    """[s], shape (n + 1,)."""


def way_past(raw: Chain, chain: Chain, schedule: Schedule) -> Way:
    """A motion, and when it comes nearest to each of the path's way points."""
    distances, times = vertex_distances(chain, schedule, raw)
    times = times.copy()
    times[0], times[-1] = 0.0, schedule.end
    return Way(chain, schedule, distances, times)


def path_turns(raw: Chain) -> Array:
    """How much the tip's path turns at every way point [rad], 0 where it begins, ends or stays, shape (n + 1,)."""
    old, new = raw.directions[:-1], raw.directions[1:]
    turns = np.arctan2(np.linalg.norm(np.cross(old, new), axis=1), np.sum(old * new, axis=1))
    turns[(raw.lengths[:-1] == 0.0) | (raw.lengths[1:] == 0.0)] = 0.0
    return np.concatenate([[0.0], turns, [0.0]])


def chosen_corners(turns: Array, way: Way, deviation: Deviation) -> list[tuple[int, str]]:
    """Way points to be shown with what is special about them: the worst ones, and typical ones by their turn.

    Args:
        turns: Of the path [rad], shape (n + 1,).
        way: The motion.
        deviation: Its largest deviations.

    Returns:
        Up to six, the worst first.
    """
    corners = np.flatnonzero(turns > LEAST_TURN)
    if not len(corners):
        return []
    nearest = int(corners[np.abs(way.times[corners] - deviation.contour.time).argmin()])
    chosen = {nearest: "path left furthest"}
    chosen.setdefault(int(corners[way.distances[corners].argmax()]), "corner missed furthest")
    by_turn = corners[turns[corners].argsort(kind="stable")]
    for share in np.linspace(1.0, 0.0, SHOWN):
        if len(chosen) < SHOWN:
            chosen.setdefault(int(by_turn[round(share * (len(by_turn) - 1))]), "corner")
    return list(chosen.items())


def view_corner(
    raw: Chain, rows: NDArray[np.int64], ways: Sequence[Way], corner: tuple[int, str], turn: float, tolerance: float
) -> CornerView:
    """See a corner from near, in the plane of its two segments.

    Args:
        raw: The path.
        rows: Row of the file's path of each way point, for the name.
        ways: The motions, one a rule.
        corner: The way point and what is special about it.
        turn: How much the path turns there [rad].
        tolerance: [m].

    Returns:
        What is seen.
    """
    k, name = corner
    frame = flat_view(raw.tips, k)
    near = slice(max(k - WINDOW, 0), k + WINDOW + 1)
    half = max(VIEW * max(ways[0].distances[k], tolerance), LEAST_VIEW_M)
    tips = [_tips_near(way, k, 1.5 * half) for way in ways]
    return CornerView(
        name=f"{name}: point {rows[k] + 1}",
        path=(raw.tips[near] - raw.tips[k]) @ frame.T,
        ways=tuple((way - raw.tips[k]) @ frame.T for way in tips),
        tolerance=tolerance,
        vertex=float(ways[0].distances[k]),
        contour=_contour_near(raw, ways[0], k),
        turn=turn,
    )


def _tips_near(way: Way, corner: int, radius: float) -> Array:
    """The tip's way [m] within a distance of a corner, shape (m, 3)."""
    at, place = float(way.times[corner]), None
    span = 1e-3
    # The tip is slow at sharp corners: the time it takes to leave the view is found by doubling.
    while True:
        times = np.linspace(max(at - span, 0.0), min(at + span, way.schedule.end), SAMPLES)
        tips = sample_schedule(way.chain, way.schedule, times).tips[:, 0]
        place = sample_schedule(way.chain, way.schedule, np.array([at])).tips[0, 0]
        ends = np.linalg.norm(tips[[0, -1]] - place, axis=1)
        out = (ends > radius) | np.array([at - span <= 0.0, at + span >= way.schedule.end])
        if out.all():
            return np.asarray(tips)
        span *= 2.0


def _contour_near(raw: Chain, way: Way, corner: int) -> float:
    """Largest distance of the tip from the path, half way to the neighbouring way points [m]."""
    before, at, after = way.times[corner - 1 : corner + 2]
    times = np.linspace(0.5 * (before + at), 0.5 * (at + after), SAMPLES)
    return float(deviation_curve(way.chain, way.schedule, raw, times).tip.max())
