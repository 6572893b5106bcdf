"""What a hand feels of an arm it guides, and what the arm does without it (layer 8c; paper 3, fig. 6)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Figures = dict[str, float]

COAST_S: Final = 1.0
"""An arm let go of may roll out for this long; what it moves then is drift [s]."""
RATIOS: Final = {"inertia": "", "assist": "assist_"}
"""Modes that are compared with the classical one, and what their figures begin with."""


class GuidedMove(NamedTuple):
    """A move of the hand, one row a step."""

    time: Array
    """[s], shape (n,)."""
    force: Array
    """Of the hand on the tool, base frame [N], shape (n, 3)."""
    q: Array
    """Joint angles [rad], shape (n, 6)."""
    moving: Mask
    """While the hand moves, shape (n,)."""
    off: Mask
    """After it has let go, shape (n,)."""
    whole: bool
    """Whether the move was not cut short."""
    lent_j: float
    """Most energy the compensation had lent [J]."""


def measure_move(move: GuidedMove) -> Figures:
    """The hand's force while it moves.

    Returns:
        hand_force_peak_n, hand_force_rms_n: of its norm; undefined if the move was cut short.
        lent_energy_j: most energy the compensation had lent beyond what friction took.
    """
    force = np.linalg.norm(move.force[move.moving], axis=1)
    known = move.whole and len(force) > 0
    return {
        "hand_force_peak_n": float(force.max()) if known else math.nan,
        "hand_force_rms_n": math.sqrt(float(np.mean(force**2))) if known else math.nan,
        "lent_energy_j": move.lent_j,
    }


def measure_drift(move: GuidedMove) -> Figures:
    """What the arm does after the hand has let go.

    Returns:
        coast_rad: largest way of a joint in the first second; drift_rad: from then on, to the end; drift_time_s: how
        long that is. Undefined if it was not let go or for no longer than that.
    """
    q, time = move.q[move.off], move.time[move.off]
    if not len(time) or time[-1] - time[0] <= COAST_S:
        return {"coast_rad": math.nan, "drift_rad": math.nan, "drift_time_s": 0.0}
    rolled = np.searchsorted(time, time[0] + COAST_S)
    return {
        "coast_rad": float(np.abs(q[: rolled + 1] - q[0]).max()),
        "drift_rad": float(np.abs(q[rolled:] - q[rolled]).max()),
        "drift_time_s": float(time[-1] - time[rolled]),
    }


def compare_modes(moves: Mapping[str, Figures]) -> Figures:
    """Modes beside each other.

    Args:
        moves: Figures by ``mode_direction_pace``.

    Returns:
        fast_peak_ratio_x, ... : force with inertia compensation by that of the classical law, fast move (``assist_``
        before it: with the start-up assist); slow_peak_n: largest of the assist's slow moves. Only what can be told;
        undefined where a move was cut short.
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
    for mode in ("none", "classical"):
        forces = [values["hand_force_peak_n"] for name, values in moves.items() if name.startswith(f"{mode}_")]
        if forces:
            figures[f"{mode}_peak_n"] = float(np.max(forces))
    slow = [values["hand_force_peak_n"] for name, values in moves.items() if name in ("assist_x_slow", "assist_y_slow")]
    return figures | ({"slow_peak_n": float(np.max(slow))} if slow else {})
