"""Tracking errors of the joints when one path is played with several smoothing rules (paper 4, fig. 10)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import find_peaks

from polish_sim.analysis.metrics import numbers
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, SERIES, head, heading, new_figure, styled
from polish_sim.arrays import Array, Indices

REFERENCE = "joint-acceleration"  #: The rule the others are compared with
AROUND_S = 0.03  #: Time before and after a jerk peak that belongs to it [s]
APART_S = 0.05  #: Between two peaks, at least [s]
HIGH = 0.8  #: Share of the largest jerk that counts as a peak where none breaks the limit
RULES: Final = {"joint-acceleration": ORANGE, "joint-jerk": GREEN, "certified": BLUE}  #: Names and colours
JOINT_NAMES: Final = ("shoulder pan", "shoulder lift", "elbow", "wrist 1", "wrist 2", "wrist 3")
TICKS: Final = tuple(name.replace(" ", "\n") for name in JOINT_NAMES)


class PlayedRule(NamedTuple):
    """A path played with one rule; rows of n equal steps of time."""

    rule: str
    time: Array  #: [s], shape (n,)
    place: Array  #: Arc length of the path the targets are at [m], shape (n,)
    error: Array  #: Target less joint position by the encoders [rad], shape (n, 6)
    jerk: Array  #: Third derivative of the targets [rad/s^3], shape (n, 6)


class AtPeak(NamedTuple):
    """Tracking error of one joint where the reference rule's jerk peaks."""

    joint: int
    place: float  #: Where on the path [m]
    reference: float  #: Largest error there with the reference rule [rad]
    error: float  #: Largest error on the same stretch of path with the other rule [rad]

    @property
    def reduction(self) -> float:
        """Share of the reference's error that is gone; negative where the error rises."""
        return 1.0 - self.error / self.reference


def measure_tracking(play: PlayedRule) -> dict[str, Any]:
    """Largest and root mean square tracking error over the whole path, one value a joint."""
    return {
        "tracking_error_max_rad": np.abs(play.error).max(axis=0).tolist(),
        "tracking_error_rms_rad": np.sqrt(np.mean(play.error**2, axis=0)).tolist(),
    }


def compare_tracking(play: PlayedRule, reference: PlayedRule, jerk_limits: Array) -> dict[str, Any]:
    """Compare a rule's tracking errors with the reference rule's on the same path; ``jerk_limits`` (6,) [rad/s^3].

    jerk_peaks: how many of the reference there are; reduction_largest, reduction_largest_joint (1 to 6) and
    reduction_median over them; rise_largest: 0 if no error rises; reduction_max and reduction_rms: of the whole path's
    errors, one value a joint.
    """
    found = list(at_peaks(play, reference, jerk_limits))
    shares = np.array([peak.reduction for peak in found])
    best = found[int(shares.argmax())] if found else None
    own, other = measure_tracking(play), measure_tracking(reference)
    return {
        "jerk_peaks": len(found),
        "reduction_largest": best.reduction if best else math.nan,
        "reduction_largest_joint": best.joint + 1 if best else None,
        "reduction_median": float(np.median(shares)) if found else math.nan,
        "rise_largest": max(0.0, -float(shares.min())) if found else math.nan,
        "peaks_reduced": float(np.mean(shares > 0.0)) if found else math.nan,
        **{
            f"reduction_{kind}": [
                1.0 - a / b if b > 0.0 else math.nan
                for a, b in zip(own[f"tracking_error_{kind}_rad"], other[f"tracking_error_{kind}_rad"], strict=True)
            ]
            for kind in ("max", "rms")
        },
    }


def at_peaks(play: PlayedRule, reference: PlayedRule, jerk_limits: Array) -> Iterator[AtPeak]:
    """Errors of two rules on the stretches of the path where the reference's joint jerk peaks, joint by joint."""
    around = round(AROUND_S / _step(reference.time))
    for joint in range(reference.jerk.shape[1]):
        for row in jerk_peaks(reference, joint, float(jerk_limits[joint])):
            first, last = max(row - around, 0), min(row + around, len(reference.time) - 1)
            low, high = reference.place[first], reference.place[last]
            there = (play.place >= low) & (play.place <= high)
            known = np.abs(reference.error[first : last + 1, joint]).max()
            if there.any() and known > 0.0:
                error = float(np.abs(play.error[there, joint]).max())
                yield AtPeak(joint, float(reference.place[row]), float(known), error)


def jerk_peaks(play: PlayedRule, joint: int, limit: float) -> Indices:
    """Rows at which a joint's jerk peaks above its limit; if it never does, near its own largest value."""
    size = np.abs(play.jerk[:, joint])
    least = limit if size.max() > limit else HIGH * size.max()
    framed = np.concatenate([[0.0], size, [0.0]])  # a peak may stand at an end
    rows, _ = find_peaks(framed, height=least, distance=max(1, round(APART_S / _step(play.time))))
    return np.asarray(rows - 1, dtype=np.int64)


def _step(time: Array) -> float:
    return float(time[1] - time[0])


@styled
def plot_tracking(record: RunRecord) -> Figure:
    """Draw each joint's tracking error over time and its largest values, and the jerk of its targets, of a run."""
    figure = new_figure(12.0, 11.0)
    grid = figure.subplots(6, 2, sharex=True)
    known = _rules_of(record)
    for joint, (error, jerk) in enumerate(grid):
        for rule, colour in RULES.items():
            rows = known[rule]
            if not len(rows):
                continue
            time = numbers(record.log, "time_s")[rows]
            read = "encoder_q_rad" if "encoder_q_rad" in record.log.columns else "q_rad"
            lag = (numbers(record.log, "target_q_rad") - numbers(record.log, read))[rows, joint]
            asked = numbers(record.log, "target_qddd_rad_s3")[rows, joint]
            error.plot(time, lag * 1e6, color=colour, lw=0.8, alpha=0.85, label=rule)
            jerk.plot(time, asked, color=colour, lw=0.7, alpha=0.85, label=rule)
        _limit(jerk, record, joint)
        error.set(ylabel=f"{JOINT_NAMES[joint]}\nerror [µrad]")
        jerk.set(ylabel="jerk [rad/s³]")
    for axes in grid[-1]:
        axes.set(xlabel="time [s]")
    grid[0, 1].legend(*grid[0, 1].get_legend_handles_labels(), loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4)
    m = record.metrics
    facts = [f"{rule}: {_number(m.get(f'{_key(rule)}_cycle_time_s'), 1.0)} s" for rule in RULES]
    facts.append(f"certified at the jerk peaks: at most {_number(m.get('certified_reduction_largest'), 100.0)}% less")
    head(figure, grid[0, 0], "Tracking error of the joints, one path with three rules", facts)
    return figure


@styled
def plot_tracking_bars(record: RunRecord) -> Figure:
    """Draw largest and root mean square tracking errors joint by joint, at own and at equal cycle times, of a run."""
    figure = new_figure(10.0, 6.0)
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    for row, (kind, text) in enumerate((("max", "largest"), ("rms", "root mean square"))):
        for column, (when, title) in enumerate((("", "own cycle times"), ("_at_equal_time", "equal cycle times"))):
            axes = grid[row, column]
            for k, (rule, colour) in enumerate(RULES.items()):
                values = record.metrics.get(f"{_key(rule)}_tracking_error_{kind}_rad{when}")
                if values is not None:
                    axes.bar(np.arange(6) + 0.27 * (k - 1), np.array(values) * 1e6, 0.25, color=colour, label=rule)
            axes.set_title(f"{text}, {title}", fontsize=9.0, fontweight="normal")
            axes.set(ylabel="error [µrad]" if column == 0 else None)
            axes.set_xticks(range(6), TICKS)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    heading(figure, "Tracking error by joint and rule")
    return figure


@styled
def plot_tracking_runs(records: Sequence[RunRecord]) -> Figure:
    """Draw by how much ``certified`` reduces each joint's largest tracking error in several runs."""
    figure = new_figure(9.0, 4.6)
    axes = figure.add_subplot()
    width = 0.8 / len(records)
    for k, record in enumerate(records):
        shares = record.metrics.get("certified_reduction_max")
        if shares is not None:
            place = np.arange(6) + width * (k - 0.5 * (len(records) - 1))
            axes.bar(place, 100.0 * np.array(shares), 0.9 * width, color=SERIES[k % len(SERIES)], label=record.name)
    axes.axhline(0.0, color=GREY, lw=0.8)
    axes.set_xticks(range(6), TICKS)
    axes.set(ylabel="reduction of the largest error [%]")
    axes.legend(loc="upper right")
    head(figure, axes, "Certified against joint-acceleration, joint by joint", ())
    return figure


def _rules_of(record: RunRecord) -> dict[str, Indices]:
    """Rows of the log by rule; the log counts the rules in the order the run names them."""
    names = list(record.metrics.get("rules", RULES))
    column = numbers(record.log, "rule")
    return {rule: np.flatnonzero(column == names.index(rule)) if rule in names else np.zeros(0, int) for rule in RULES}


def _limit(axes: Axes, record: RunRecord, joint: int) -> None:
    limits = record.metrics.get("joint_jerk_limits_rad_s3")
    if limits is not None:
        for sign in (-1.0, 1.0):
            axes.axhline(sign * limits[joint], color=GREY, lw=0.8, ls="--", label="limit" if sign > 0.0 else None)


def _key(rule: str) -> str:
    return rule.replace("-", "_")


def _number(value: float | None, scale: float) -> str:
    return "-" if value is None or np.isnan(value) else f"{value * scale:.4g}"
