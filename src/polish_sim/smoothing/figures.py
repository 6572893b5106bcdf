"""A smoothed motion sampled, measured (peaks beside limits, deviations, and where they are) and written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Figures, Indices, norms
from polish_sim.calibration.tables import JOINTS
from polish_sim.exchange import WayPoints
from polish_sim.log import write_arrays
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.deviation import BLOCK, Deviation, stretch_times
from polish_sim.motion.rules.limits import ORDERS, Arm, SmoothingLimits
from polish_sim.motion.rules.schedule import Samples, SmoothMotion, turning
from polish_sim.motion.segment_rates import sampled_joints

NODES, STEP_S = 5, 0.01  #: Samples in a smooth stretch: least number, largest distance [s]
NPZ, CSV = "trajectory.npz", "trajectory.csv"
TOOL = ("time_s", "x_m", "y_m", "z_m", "nx", "ny", "nz")
TIP_UNITS = ("m_s", "m_s2", "m_s3")
TURN_UNITS = ("rad_s", "rad_s2", "rad_s3")
PARTS = ("tip", "axis", *(f"joint_{number}" for number in range(1, 7)))

Locate = Callable[[float], Figures]  #: From a time [s] to the tool's place


class MotionPeaks(NamedTuple):
    """Largest `SampledMotion.rates` of a motion, and when, shape (3, 8), or (3, 2) without a robot."""

    values: Array
    times: Array  #: [s]


class SampledMotion(NamedTuple):
    """A motion at n times."""

    times: Array  #: [s], shape (n,)
    tool: Samples
    #: Joint angles and three derivatives in time [rad/s^k], shape (4, n, 6); none without a robot: (4, n, 0)
    q: Array

    @property
    def rates(self) -> Array:
        """Size of speed, acceleration and jerk of the tip [m/s..], of the axis without spin and of the joints
        [rad/s..], shape (3, n, 8), or (3, n, 2) without a robot."""
        tool = np.stack([norms(self.tool.tips[:, 1:]), norms(turning(self.tool.axes))])
        return np.concatenate([tool.T, np.abs(self.q[1:])], axis=2)


def motion_at(motion: SmoothMotion, times: Array, arm: Arm | None) -> SampledMotion:
    """Tool and joints at rising times [s], exact at every one, dense enough for the arm, if there is one, to
    be followed.

    Raises ReachError, naming the place, if the arm cannot be there, or only singularly.
    """
    tool = motion.sample(times)
    if arm is None:
        return SampledMotion(times, tool, np.empty((4, len(times), 0)))
    return SampledMotion(times, tool, np.stack(sampled_joints(tool, arm)))


def sample_in_blocks(
    motion: SmoothMotion, times: Iterator[Array], arm: Arm | None
) -> Iterator[SampledMotion]:
    """`motion_at` block by block, so that long motions need little memory; each begins where the last
    ended."""
    for block in times:
        seen = motion_at(motion, block, arm)
        yield seen
        arm = arm and arm._replace(q_start=seen.q[0, -1])


def find_peaks(motion: SmoothMotion, arm: Arm | None) -> MotionPeaks:
    """Peaks of a motion, looked for at both ends of every smooth stretch and between them."""
    columns = 2 if arm is None else 8
    best = np.full((3, columns), -1.0)
    at = np.zeros((3, columns))
    for seen in sample_in_blocks(motion, stretch_times(motion.edges, NODES, STEP_S), arm):
        rates = seen.rates
        row = rates.argmax(axis=1)
        value = np.take_along_axis(rates, row[:, None], axis=1)[:, 0]
        better = value > best
        best = np.where(better, value, best)
        at = np.where(better, seen.times[row], at)
    return MotionPeaks(best, at)


class MeasuredMotion(NamedTuple):
    """A smoothed motion and its measures."""

    rule: str
    motion: SmoothMotion  #: In the work frame
    peaks: MotionPeaks
    deviation: Deviation
    limits: SmoothingLimits
    plan_s: float  #: Time the rule took [s]


def smoothing_figures(measured: MeasuredMotion, raw: Chain, points: WayPoints, rows: Indices) -> Figures:
    """The figures of metrics.json; ``rows``: the file's row of each way point, shape (segments + 1,)."""
    segments = len(raw.lengths)
    deviation = measured.deviation
    locate = _locator(measured.motion, points, rows)
    return {
        "rule": measured.rule,
        "segments": segments,
        "path_length_m": raw.lengths.sum(),
        "axis_turn_rad": raw.angles.sum(),
        "cycle_time_s": measured.motion.end,
        "tip_deviation_vertex_max_m": deviation.vertex.value,
        "tip_deviation_contour_max_m": deviation.contour.value,
        "axis_deviation_max_rad": deviation.axis.value,
        **_ratio_figures(measured),
        "segments_per_s": segments / measured.plan_s,
        "plan_time_s": measured.plan_s,
        "deviations": {
            name: {f"value_{unit}": place.value, "time_s": place.time} | locate(place.time)
            for name, unit, place in zip(Deviation._fields, ("m", "m", "rad"), deviation, strict=True)
        },
        "peaks": _peak_figures(measured, locate),
    }


def _locator(motion: SmoothMotion, points: WayPoints, rows: Indices) -> Locate:
    """The tip at a time, and the way point it has left, by its place in the file."""

    def locate(time: float) -> Figures:
        at = np.array([time])
        left = int(motion.places_at(np.arange(len(rows), dtype=float), at)[0][0] + 1e-9)
        return {"tip_m": motion.sample(at).tips[0, 0], "after": points.place(rows[left])}

    return locate


def _ratio_figures(measured: MeasuredMotion) -> Figures:
    """Peak / limit of tool tip, tool axis and joints; of the joints the worst, null without a robot."""
    figures: Figures = {}
    for name, peaks, limits in zip(ORDERS, measured.peaks.values, measured.limits.table, strict=True):
        tip, axis, *joints = peaks / limits[: len(peaks)]
        figures[f"tool_{name}_ratio_max"] = tip
        figures[f"axis_{name}_ratio_max"] = axis
        figures[f"joint_{name}_ratio_max"] = max(joints, default=None)
    return figures


def _peak_figures(measured: MeasuredMotion, locate: Locate) -> Figures:
    """Every peak with its limit, time and place: ``tip_speed``, ..., ``joint_6_jerk``."""
    figures: Figures = {}
    tables = *measured.peaks, measured.limits.table
    for order, name in enumerate(ORDERS):
        for part, value, time, limit in zip(PARTS, *(table[order] for table in tables), strict=False):
            unit = (TIP_UNITS if part == "tip" else TURN_UNITS)[order]
            figures[f"{part}_{name}"] = (
                {f"value_{unit}": value, f"limit_{unit}": limit}
                | {"ratio": value / limit, "time_s": time}
                | locate(time)
            )
    return figures


# The motion as files: trajectory.npz and trajectory.csv, sampled evenly in time.


def even_times(end: float, rate: float) -> Iterator[Array]:
    """Times of a motion of duration ``end`` [s] at a rate [Hz], blocks (k,) of rising times; the last is its
    end."""
    # The end is its own sample; one that rounding puts beside it is left out.
    count = int(np.ceil(end * rate - 1e-6))
    for begin in range(0, count + 1, BLOCK):
        times = np.arange(begin, min(begin + BLOCK, count + 1)) / rate
        yield np.minimum(times, end)


def write_trajectory(folder: Path, motions: Iterable[SampledMotion]) -> int:
    """Write a motion, block by block, as NPZ (to the last bit) and CSV (to 1e-9 m and rad); returns the
    number of samples.

    Positions and tool axes are those of the path's frame, the axis from the part to the tool, as in path
    files; without a robot there are no joint angles.
    """
    blocks: list[tuple[Array, ...]] = []
    with (folder / CSV).open("w", encoding="utf-8", newline="\n") as file:
        for motion in motions:
            block = (motion.times, motion.tool.tips[:, 0], -motion.tool.axes[:, 0], motion.q[0], motion.q[1])
            if not blocks:
                file.write(",".join(TOOL + (JOINTS if motion.q.shape[2] else ())) + "\n")
            # Adding zero turns -0.0 into 0.0.
            np.savetxt(file, np.column_stack(block[:4]) + 0.0, fmt="%.9f", delimiter=",")
            blocks.append(tuple(np.array(column) for column in block))
    names = ("time_s", "tip_m", "axis", "q_rad", "qd_rad_s")
    columns = {
        name: np.concatenate(parts) for name, parts in zip(names, zip(*blocks, strict=True), strict=True)
    }
    kept = {name: column for name, column in columns.items() if column.size}
    write_arrays(folder / NPZ, kept)
    return len(columns["time_s"])
