"""A smoothed motion sampled, measured (peaks beside limits, deviations, and where they are) and written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Figures, Indices, in_groups
from polish_sim.calibration.tables import JOINTS
from polish_sim.exchange import WayPoints
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.deviation import BLOCK, MANY, SHORTEST_S, Deviation, LargestAt, measure_deviation
from polish_sim.motion.rules.limits import Arm, LimitValues, SmoothingLimits, near
from polish_sim.motion.rules.schedule import Samples, SmoothMotion, turning
from polish_sim.motion.segment_rates import sampled_joints

ORDERS = ("speed", "acceleration", "jerk")
EDGE = 1e-7  #: Share of a stretch that is kept from its ends, where the jerk jumps
NODES, STEP_S = 5, 0.01  #: Samples in a smooth stretch: least number, largest distance [s]
FEWEST = 2  #: In a motion of more than ``MANY`` stretches, at least so few samples each
NPZ, CSV = "trajectory.npz", "trajectory.csv"
TOOL = ("time_s", "x_m", "y_m", "z_m", "nx", "ny", "nz")
TIP_UNITS = ("m_s", "m_s2", "m_s3")
TURN_UNITS = ("rad_s", "rad_s2", "rad_s3")

Locate = Callable[[float], Figures]  #: From a time [s] to the tool's place


class TimedPeak(NamedTuple):
    """A largest value (SI) and its time [s]."""

    value: float
    time: float


class MotionPeaks(NamedTuple):
    """Largest values of a motion; each a row of speed, acceleration, jerk."""

    tip: tuple[TimedPeak, ...]  #: Norms of the tip's derivatives [m/s..]
    axis: tuple[
        TimedPeak, ...
    ]  #: Norms of the axis' angular velocity without spin and its derivatives [rad/s..]
    #: Of each order the six joints, without sign [rad/s..]; empty without a robot
    joints: tuple[tuple[TimedPeak, ...], ...]


class SampledMotion(NamedTuple):
    """A motion at n times."""

    times: Array  #: [s], shape (n,)
    tool: Samples
    #: Joint angles and three derivatives in time [rad/s^k], shape (4, n, 6); none without a robot: (4, n, 0)
    q: Array

    @property
    def tip_rates(self) -> Array:
        """Norms of the tip's first three derivatives [m/s..], shape (3, n)."""
        return np.linalg.norm(self.tool.tips[:, 1:], axis=2).T

    @property
    def axis_rates(self) -> Array:
        """Norms of the axis' angular velocity without spin and its derivatives [rad/s..], shape (3, n)."""
        return np.linalg.norm(turning(self.tool.axes), axis=2).T


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
        arm = None if arm is None else near(arm, seen.q[0, -1])


def stretch_times(edges: Array) -> Iterator[Array]:
    """Times in every stretch between ``edges`` (n,) [s], in which all rates are smooth, blocks of rising
    times."""
    widths = np.diff(edges)
    begins = edges[:-1][widths > SHORTEST_S]
    widths = widths[widths > SHORTEST_S]
    least = NODES if len(widths) <= MANY else FEWEST
    counts = np.maximum(least, np.ceil(widths / STEP_S).astype(np.int64) + 1)
    filled = np.cumsum(counts)
    first = 0
    while first < len(counts):
        past = max(int(np.searchsorted(filled, (filled[first - 1] if first else 0) + BLOCK)), first + 1)
        yield _nodes(begins[first:past], widths[first:past], counts[first:past])
        first = past


def _nodes(begins: Array, widths: Array, counts: Indices) -> Array:
    """Evenly spread times in each stretch, its ends all but included."""
    k, place = in_groups(counts)
    # Never on the edge itself, where rounding would let pieces overlap.
    edge = np.maximum(EDGE * widths, 8.0 * np.spacing(begins + widths))[k]
    return begins[k] + edge + (widths[k] - 2.0 * edge) * place / (counts[k] - 1)


def find_peaks(motion: SmoothMotion, arm: Arm | None) -> MotionPeaks:
    """Peaks of a motion, looked for at both ends of every smooth stretch and between them."""
    columns = 2 if arm is None else 8
    best = np.full((3, columns), -1.0)
    at = np.zeros((3, columns))
    for seen in sample_in_blocks(motion, stretch_times(motion.edges), arm):
        tool = [seen.tip_rates[:, :, None], seen.axis_rates[:, :, None]]
        rates = np.concatenate([*tool, np.abs(seen.q[1:])], axis=2)
        row = rates.argmax(axis=1)
        value = np.take_along_axis(rates, row[:, None], axis=1)[:, 0]
        better = value > best
        best = np.where(better, value, best)
        at = np.where(better, seen.times[row], at)
    peaks = [[TimedPeak(float(best[d, c]), float(at[d, c])) for c in range(columns)] for d in range(3)]
    joints = tuple(tuple(row[2:]) for row in peaks) if arm is not None else ()
    return MotionPeaks(tuple(row[0] for row in peaks), tuple(row[1] for row in peaks), joints)


class MeasuredMotion(NamedTuple):
    """A smoothed motion and its measures."""

    rule: str
    motion: SmoothMotion  #: In the work frame
    peaks: MotionPeaks
    deviation: Deviation
    limits: SmoothingLimits
    plan_s: float  #: Time the rule took [s]


def measure_smoothing(
    rule: str, motion: SmoothMotion, raw: Chain, arm: Arm | None, limits: SmoothingLimits, plan_s: float
) -> MeasuredMotion:
    """Measure a motion, planned by a rule in ``plan_s`` [s], against its path ``raw`` and limits; or
    ReachError."""
    return MeasuredMotion(
        rule, motion, find_peaks(motion, arm), measure_deviation(motion, raw), limits, plan_s
    )


def smoothing_figures(measured: MeasuredMotion, raw: Chain, points: WayPoints, rows: Indices) -> Figures:
    """The figures of metrics.json; ``rows``: the file's row of each way point, shape (segments + 1,)."""
    segments = len(raw.lengths)
    deviation = measured.deviation
    limits = measured.limits.values()
    locate = _locator(measured.motion, points, rows)
    return {
        "rule": measured.rule,
        "segments": segments,
        "path_length_m": float(raw.lengths.sum()),
        "axis_turn_rad": float(raw.angles.sum()),
        "cycle_time_s": measured.motion.end,
        "tip_deviation_vertex_max_m": deviation.vertex.value,
        "tip_deviation_contour_max_m": deviation.contour.value,
        "axis_deviation_max_rad": deviation.axis.value,
        **_ratio_figures(measured.peaks, limits),
        "segments_per_s": segments / measured.plan_s,
        "plan_time_s": measured.plan_s,
        "deviations": {
            "vertex": _deviation(deviation.vertex, "m", locate),
            "contour": _deviation(deviation.contour, "m", locate),
            "axis": _deviation(deviation.axis, "rad", locate),
        },
        "peaks": _peak_figures(measured.peaks, limits, locate),
    }


def _locator(motion: SmoothMotion, points: WayPoints, rows: Indices) -> Locate:
    """The tip at a time, and the way point it has left, by its place in the file."""
    numbers = np.arange(len(rows), dtype=float)

    def locate(time: float) -> Figures:
        at = np.array([time])
        left = int(motion.places_at(numbers, at)[0][0] + 1e-9)
        return {"tip_m": motion.sample(at).tips[0, 0], "after": points.place(int(rows[left]))}

    return locate


def _ratio_figures(peaks: MotionPeaks, limits: LimitValues) -> Figures:
    """Peak / limit of tool tip, tool axis and joints; of the joints the worst, null without a robot."""
    figures: Figures = {}
    for order, name in enumerate(ORDERS):
        figures[f"tool_{name}_ratio_max"] = peaks.tip[order].value / tip_limits(limits)[order]
        figures[f"axis_{name}_ratio_max"] = peaks.axis[order].value / axis_limits(limits)[order]
        joints = peaks.joints[order] if peaks.joints else ()
        ratios = [peak.value / limits.joint[order, j] for j, peak in enumerate(joints)]
        figures[f"joint_{name}_ratio_max"] = max(ratios) if ratios else None
    return figures


def _peak_figures(peaks: MotionPeaks, limits: LimitValues, locate: Locate) -> Figures:
    """Every peak with its limit, time and place: ``tip_speed``, ..., ``joint_6_jerk``."""

    def figures_of(peak: TimedPeak, limit: float, unit: str) -> Figures:
        ratio = {"ratio": peak.value / limit, "time_s": peak.time}
        return {f"value_{unit}": peak.value, f"limit_{unit}": limit} | ratio | locate(peak.time)

    figures: Figures = {}
    for order, (name, unit) in enumerate(zip(ORDERS, TURN_UNITS, strict=True)):
        figures[f"tip_{name}"] = figures_of(peaks.tip[order], tip_limits(limits)[order], TIP_UNITS[order])
        figures[f"axis_{name}"] = figures_of(peaks.axis[order], axis_limits(limits)[order], unit)
        for j, peak in enumerate(peaks.joints[order] if peaks.joints else ()):
            figures[f"joint_{j + 1}_{name}"] = figures_of(peak, float(limits.joint[order, j]), unit)
    return figures


def tip_limits(limits: LimitValues) -> tuple[float, float, float]:
    """Speed, acceleration and jerk of the tip [m/s..]."""
    return limits.tip_speed, limits.tip_acceleration, limits.tip_jerk


def axis_limits(limits: LimitValues) -> tuple[float, float, float]:
    """Speed, acceleration and jerk of the tool axis [rad/s..]."""
    return limits.axis_speed, limits.axis_acceleration, limits.axis_jerk


def _deviation(place: LargestAt, unit: str, locate: Locate) -> Figures:
    return {f"value_{unit}": place.value, "time_s": place.time} | locate(place.time)


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
    np.savez_compressed(folder / NPZ, allow_pickle=False, **kept)
    return len(columns["time_s"])
