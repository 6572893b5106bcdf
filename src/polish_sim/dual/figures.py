"""How well a tool follows a part that a second robot moves."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.analysis.metrics import PROCESS
from polish_sim.arrays import Array
from polish_sim.log import Trace

SPEED_S = 0.05  #: Speeds are averages over this long, as those of the arc [s]
TURNS = 200  #: So many turns of a run are added up: more would add up the servos' trembling


class WantedTool(NamedTuple):
    """Where the tool is wanted on the part; n places along the path, in order."""

    s: Array  #: Arc length of the path [m], never falling, shape (n,)
    points: Array  #: Tool point, work frame [m], shape (n, 3)
    axes: Array  #: Unit tool axis into the part, work frame, shape (n, 3)


class PairErrors(NamedTuple):
    """Errors at every step of the process, work frame."""

    tracking: Array  #: From the tool point to the target the host had at that moment [m], shape (n, 3)
    relative: Array  #: From where the tool is wanted on the part to where it really is on it [m], shape (n, 3)


def pair_errors(trace: Trace, wanted: WantedTool, R_base_work: Array, pressing: bool) -> PairErrors:
    """Errors of the process phase; while pressing the force decides the depth: errors along the tool axis do not count.

    ``R_base_work``: how the work frame stands in the base of the robot with the tool then, shape (n, 3, 3).
    """
    part = trace.phase == PROCESS
    s = trace.path_s_m[part]
    tracking = np.einsum("nij,ni->nj", R_base_work, trace.target_error_m[part])
    relative = trace.tool_on_part_m[part] - _along(wanted.s, wanted.points, s)
    if pressing:
        axes = _along(wanted.s, wanted.axes, s)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        tracking, relative = (e - np.sum(e * axes, axis=1)[:, None] * axes for e in (tracking, relative))
    return PairErrors(tracking, relative)


def measure_pair(trace: Trace, errors: PairErrors, R_base_work: Array) -> dict[str, Any]:
    """Measure how the tool follows the moving part, over the whole process phase, its ramps included.

    Returns:
        tracking_error_max_m: largest distance from the target along x, y, z of the part (a list; across the tool axis
        only while a force is controlled), tracking_error_worst_m: the largest of them; relative_error_rms_m,
        relative_error_p95_m, relative_error_max_m: of the distance between the tool on the part as it is and as
        wanted, calibration errors included, the part's own errors not (across the tool axis in contact);
        master_way_m: how far the part's origin was moved, from first to last; master_turn_rad: how far the part was
        turned, there and back counted; speed_mean_m_s, speed_std_m_s: of the tool point relative to the part, averaged
        over 50 ms.
    """
    if not len(errors.tracking):
        nothing = float("nan")
        return {"tracking_error_max_m": [nothing] * 3} | dict.fromkeys(
            ("tracking_error_worst_m", "relative_error_rms_m", "relative_error_p95_m", "relative_error_max_m",
             "master_way_m", "master_turn_rad", "speed_mean_m_s", "speed_std_m_s"), nothing,
        )  # fmt: skip
    tracking = np.abs(errors.tracking).max(axis=0)
    relative = np.linalg.norm(errors.relative, axis=1)
    process = trace.phase == PROCESS
    shift = trace.part_shift_m[process]
    speed = _speed(trace.time_s, trace.tool_on_part_m)[process]
    return {
        "tracking_error_max_m": tracking.tolist(),
        "tracking_error_worst_m": float(tracking.max()),
        "relative_error_rms_m": float(np.sqrt(np.mean(relative**2))),
        "relative_error_p95_m": float(np.percentile(relative, 95.0)),
        "relative_error_max_m": float(relative.max()),
        "master_turn_rad": _turned(R_base_work[:: max(1, len(R_base_work) // TURNS)]),
        "master_way_m": float(np.linalg.norm(shift[-1] - shift[0])),
        "speed_mean_m_s": float(speed.mean()),
        "speed_std_m_s": float(speed.std()),
    }


def _speed(time: Array, points: Array) -> Array:
    """Speed of a point (n, 3) over ``SPEED_S`` around every time [s]: the servos' trembling is no way done, (n,)."""
    early, late = (np.clip(time + shift, time[0], time[-1]) for shift in (-0.5 * SPEED_S, 0.5 * SPEED_S))
    gone = _along(time, points, late) - _along(time, points, early)
    return np.asarray(np.linalg.norm(gone, axis=1) / (late - early))


def _turned(R: Array) -> float:
    """Sum of the turns from one rotation to the next [rad], (n, 3, 3)."""
    return float(Rotation.from_matrix(np.swapaxes(R[:-1], 1, 2) @ R[1:]).magnitude().sum()) if len(R) > 1 else 0.0


def _along(s: Array, values: Array, places: Array) -> Array:
    """Values (n, 3) at places of the path, linear between them, shape (k, 3)."""
    return np.stack([np.interp(places, s, values[:, k]) for k in range(3)], axis=1)
