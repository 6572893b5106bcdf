"""A smoothed motion in figures: times, peaks beside limits, deviations, and where they are (layer 8c)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.motion_peaks import ORDERS, MotionPeaks, Peak, find_peaks
from polish_sim.exchange import WayPoints
from polish_sim.motion.smoothing.arm import Arm
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.deviation import Deviation, Place, measure_deviation, raw_places
from polish_sim.motion.smoothing.limits import LimitValues, SmoothingLimits
from polish_sim.motion.smoothing.sampling import index_schedule, sample_schedule
from polish_sim.motion.smoothing.schedule import Schedule

Locate = Callable[[float], dict[str, Any]]
"""Says where the tool is at a time [s]."""

UNITS: Final = {"tip": ("m_s", "m_s2", "m_s3"), "axis": ("rad_s", "rad_s2", "rad_s3")}


class Measured(NamedTuple):
    """A smoothed motion with all that is measured on it."""

    rule: str
    chain: Chain
    """The segments the schedule passes, work frame."""
    schedule: Schedule
    peaks: MotionPeaks
    deviation: Deviation
    limits: SmoothingLimits
    plan_s: float
    """Time the rule took [s]."""


def measure_smoothing(
    rule: str, chain: Chain, schedule: Schedule, raw: Chain, arm: Arm | None, limits: SmoothingLimits, plan_s: float
) -> Measured:
    """Measure a motion against its path.

    Args:
        rule: What planned it.
        chain: The segments the schedule passes.
        schedule: When they are passed.
        raw: The path as given.
        arm: The robot, if any.
        limits: What the motion was to keep to.
        plan_s: Time the rule took [s].

    Raises:
        ReachError: The arm cannot follow.
    """
    deviation = measure_deviation(chain, schedule, raw)
    return Measured(rule, chain, schedule, find_peaks(chain, schedule, arm), deviation, limits, plan_s)


def smoothing_figures(motion: Measured, raw: Chain, points: WayPoints, rows: NDArray[np.int64]) -> dict[str, Any]:
    """The figures of metrics.json (names: the contract's).

    Args:
        motion: What was measured.
        raw: The path.
        points: The file it was read from.
        rows: The file's row of each way point, shape (segments + 1,).
    """
    segments = len(raw.lengths)
    deviation, locate = motion.deviation, locator(motion, raw, points, rows)
    return {
        "rule": motion.rule,
        "segments": segments,
        "segments_planned": len(motion.chain.lengths),
        "path_length_m": float(raw.lengths.sum()),
        "axis_turn_rad": float(raw.angles.sum()),
        "cycle_time_s": motion.schedule.end,
        "tip_deviation_vertex_max_m": deviation.vertex.value,
        "tip_deviation_contour_max_m": deviation.contour.value,
        "axis_deviation_max_rad": deviation.axis.value,
        **ratio_figures(motion.peaks, motion.limits.values()),
        "segments_per_s": segments / motion.plan_s,
        "plan_time_s": motion.plan_s,
        "deviations": {
            "vertex": _deviation(deviation.vertex, "m", locate),
            "contour": _deviation(deviation.contour, "m", locate),
            "axis": _deviation(deviation.axis, "rad", locate),
        },
        "peaks": peak_figures(motion.peaks, motion.limits.values(), locate),
    }


def locator(motion: Measured, raw: Chain, points: WayPoints, rows: NDArray[np.int64]) -> Locate:
    """Say where the tool is at a time: the tip, and the way point it has left, by its place in the file."""
    index, places = index_schedule(motion.chain, motion.schedule), raw_places(motion.chain, raw)

    def locate(time: float) -> dict[str, Any]:
        begun = max(int(np.searchsorted(index.none_begun, time, side="right")) - 1, 0)
        tip = sample_schedule(motion.chain, motion.schedule, np.array([time])).tips[0, 0]
        return {"tip_m": tip, "after": points.place(int(rows[places[min(begun, len(places) - 1)]]))}

    return locate


def ratio_figures(peaks: MotionPeaks, limits: LimitValues) -> dict[str, Any]:
    """Peak / limit of tool tip, tool axis and joints; of the joints the worst, null without a robot."""
    figures: dict[str, Any] = {}
    for order, name in enumerate(ORDERS):
        figures[f"tool_{name}_ratio_max"] = peaks.tip[order].value / tip_limits(limits)[order]
        figures[f"axis_{name}_ratio_max"] = peaks.axis[order].value / axis_limits(limits)[order]
        joints = peaks.joints[order] if peaks.joints else ()
        ratios = [peak.value / limits.joint[order, j] for j, peak in enumerate(joints)]
        figures[f"joint_{name}_ratio_max"] = max(ratios) if ratios else None
    return figures


def peak_figures(peaks: MotionPeaks, limits: LimitValues, locate: Locate) -> dict[str, Any]:
    """Every peak with its limit, time and place: ``tip_speed``, ..., ``joint_6_jerk``."""
    figures: dict[str, Any] = {}
    for order, name in enumerate(ORDERS):
        tip, axis = tip_limits(limits)[order], axis_limits(limits)[order]
        figures[f"tip_{name}"] = _peak(peaks.tip[order], tip, UNITS["tip"][order], locate)
        figures[f"axis_{name}"] = _peak(peaks.axis[order], axis, UNITS["axis"][order], locate)
        for j, peak in enumerate(peaks.joints[order] if peaks.joints else ()):
            limit = float(limits.joint[order, j])
            figures[f"joint_{j + 1}_{name}"] = _peak(peak, limit, UNITS["axis"][order], locate)
    return figures


def tip_limits(limits: LimitValues) -> tuple[float, float, float]:
    """Speed, acceleration and jerk of the tip [m/s..]."""
    return limits.tip_speed, limits.tip_acceleration, limits.tip_jerk


def axis_limits(limits: LimitValues) -> tuple[float, float, float]:
    """Speed, acceleration and jerk of the tool axis [rad/s..]."""
    return limits.axis_speed, limits.axis_acceleration, limits.axis_jerk


def _peak(peak: Peak, limit: float, unit: str, locate: Locate) -> dict[str, Any]:
    values = {f"value_{unit}": peak.value, f"limit_{unit}": limit, "ratio": peak.value / limit, "time_s": peak.time}
    return values | locate(peak.time)


def _deviation(place: Place, unit: str, locate: Locate) -> dict[str, Any]:
    return {f"value_{unit}": place.value, "time_s": place.time} | locate(place.time)
