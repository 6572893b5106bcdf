"""Tracking errors of the joints when one path is played with several smoothing rules (paper 4, fig. 10)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import find_peaks

from polish_sim.analysis.run_record import Records, RunRecord
from polish_sim.analysis.style import (
    BLUE,
    DASHES,
    GREY,
    ORANGE,
    PINK,
    SERIES,
    facts_of,
    head,
    limit_line,
    new_figure,
    styled,
)
from polish_sim.arrays import Array, Figures, Indices
from polish_sim.exchange.log_sources import JOINT_NAMES

REFERENCE = "joint-acceleration"  #: The rule the others are compared with
NEAR_M = 0.006  #: Of the path on either side of the jerk peak that is drawn
AROUND_S = 0.03  #: Time before and after a jerk peak that belongs to it [s]
APART_S = 0.05  #: Between two peaks, at least [s]
HIGH = 0.8  #: Share of the largest jerk that counts as a peak where none breaks the limit
RULES = {"joint-acceleration": ORANGE, "joint-jerk": PINK, "spline": BLUE}  #: Names and colours
TICKS = tuple(name.replace("_", "\n") for name in JOINT_NAMES)


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


def measure_tracking(play: PlayedRule) -> Figures:
    """Largest and root mean square tracking error over the whole path, one value a joint."""
    return {
        "tracking_error_max_rad": np.abs(play.error).max(axis=0).tolist(),
        "tracking_error_rms_rad": np.sqrt(np.mean(play.error**2, axis=0)).tolist(),
    }


def compare_tracking(play: PlayedRule, reference: PlayedRule, jerk_limits: Array) -> Figures:
    """Compare a rule's tracking errors with the reference rule's on the same path; ``jerk_limits`` (6,)
    [rad/s^3].

    jerk_peaks: how many of the reference there are; at_peaks: their ``AtPeak``; reduction_largest,
    reduction_largest_joint (1 to 6) and reduction_median over them; rise_largest: 0 if no error rises;
    reduction_max and reduction_rms: of the whole path's errors, one value a joint.
    """
    found = list(at_peaks(play, reference, jerk_limits))
    shares = np.array([peak.reduction for peak in found] or [math.nan])
    own, other = measure_tracking(play), measure_tracking(reference)

    def less(kind: str) -> list[float]:
        before = np.array(other[f"tracking_error_{kind}_rad"])
        kept = own[f"tracking_error_{kind}_rad"] / np.where(before > 0.0, before, math.nan)
        return list(1.0 - kept)

    return {
        "jerk_peaks": len(found),
        "reduction_largest": shares.max(),
        "reduction_largest_joint": found[shares.argmax()].joint + 1 if found else None,
        "reduction_median": np.median(shares),
        "rise_largest": np.maximum(0.0, -shares.min()) + 0.0,  # no minus zero
        "at_peaks": [list(peak) for peak in found],
        "peaks_reduced": np.mean(shares > 0.0) if found else math.nan,
        "reduction_max": less("max"),
        "reduction_rms": less("rms"),
    }


def at_peaks(play: PlayedRule, reference: PlayedRule, jerk_limits: Array) -> Iterator[AtPeak]:
    """Errors of two rules on the stretches of the path where the reference's joint jerk peaks, joint by
    joint."""
    around = round(AROUND_S / _step(reference.time))
    for joint in range(reference.jerk.shape[1]):
        for row in jerk_peaks(reference, joint, jerk_limits[joint]):
            first, last = max(row - around, 0), min(row + around, len(reference.time) - 1)
            low, high = reference.place[first], reference.place[last]
            there = (play.place >= low) & (play.place <= high)
            known = np.abs(reference.error[first : last + 1, joint]).max()
            if there.any() and known > 0.0:
                error = np.abs(play.error[there, joint]).max()
                yield AtPeak(joint, reference.place[row], known, error)


def jerk_peaks(play: PlayedRule, joint: int, limit: float) -> Indices:
    """Rows at which a joint's jerk peaks above its limit; if it never does, near its own largest value."""
    size = np.abs(play.jerk[:, joint])
    least = limit if size.max() > limit else HIGH * size.max()
    framed = np.concatenate([[0.0], size, [0.0]])  # a peak may stand at an end
    rows, _ = find_peaks(framed, height=least, distance=max(1, round(APART_S / _step(play.time))))
    return rows - 1


def _step(time: Array) -> float:
    return time[1] - time[0]


@styled
def plot_tracking(record: RunRecord) -> Figure | None:
    """Draw what rules make of the tracking error where the reference's joint jerk peaks; None without such a
    peak.

    On the left the peak at which ``spline`` gains most, on the right all of them.
    """
    played = _played(record)
    limits = record.metrics.get("joint_jerk_limits_rad_s3")
    peaks = {
        rule: [AtPeak(*row) for row in record.metrics.get(f"{_key(rule)}_at_peaks") or []] for rule in RULES
    }
    if limits is None or not all(rule == REFERENCE or (peaks[rule] and rule in played) for rule in RULES):
        return None
    figure = new_figure(11.0, 5.2)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15))
    jerk, error, share = (figure.add_subplot(place) for place in (grid[0, 0], grid[1, 0], grid[:, 1]))
    best = max(peaks["spline"], key=lambda peak: peak.reduction)
    for (rule, color), dashes in zip(RULES.items(), DASHES[2::-1], strict=True):
        near = np.abs(played[rule].place - best.place) < NEAR_M
        at = 1e3 * (played[rule].place[near] - best.place)
        jerk.plot(at, played[rule].jerk[near, best.joint], color=color, ls=dashes, label=rule)
        error.plot(at, 1e6 * played[rule].error[near, best.joint], color=color, ls=dashes)
    for sign in (-1.0, 1.0):
        limit_line(jerk, sign * limits[best.joint], "limit")
    jerk.set(ylabel="jerk asked [rad/s³]")
    jerk.set_title(f"{JOINT_NAMES[best.joint].replace('_', ' ')}, {best.place:.3f} m along the path")
    error.set(xlabel="along the path, from the jerk peak [mm]", ylabel="tracking error [µrad]")
    for side, (rule, mark) in enumerate((("joint-jerk", "o"), ("spline", "^"))):
        joints = [peak.joint + 0.24 * (side - 0.5) for peak in peaks[rule]]
        share.plot(
            joints,
            [100.0 * peak.reduction for peak in peaks[rule]],
            mark,
            color=RULES[rule],
            ms=5,
            alpha=0.7,
            label=f"{rule}, every jerk peak",
        )
    share.axhline(0.0, color=RULES[REFERENCE], lw=1.0, ls=":", label=f"as {REFERENCE}")
    share.set_xticks(range(6), TICKS)
    share.set(ylabel=f"error less than with {REFERENCE} [%]")
    rows = [(f"{rule}: {{:.2f}} s", f"{_key(rule)}_cycle_time_s", 1.0) for rule in RULES]
    head(
        figure,
        f"Tracking error where the jerk of {REFERENCE} peaks",
        facts_of(
            record.metrics,
            *rows,
            (("{:.1f}% less error at most with spline", "spline_reduction_largest", 100.0)),
            (("{:.1f}% in the median", "spline_reduction_median", 100.0)),
        ),
        legend=(jerk, share),
    )
    return figure


@styled
def plot_tracking_runs(records: Records) -> Figure:
    """Draw by how much ``spline`` reduces each joint's largest tracking error in several runs."""
    figure = new_figure(9.0, 4.6)
    axes = figure.add_subplot()
    width = 0.8 / len(records)
    for k, record in enumerate(records):
        shares = record.metrics.get("spline_reduction_max")
        if shares is not None:
            place = np.arange(6) + width * (k - 0.5 * (len(records) - 1))
            axes.bar(
                place, 100.0 * np.array(shares), 0.9 * width, color=SERIES[k % len(SERIES)], label=record.name
            )
    axes.axhline(0.0, color=GREY, lw=0.8)
    axes.set_xticks(range(6), TICKS)
    axes.set(ylabel="reduction of the largest error [%]")
    head(figure, "Spline against joint-acceleration, joint by joint", legend=(axes,))
    return figure


def _played(record: RunRecord) -> dict[str, PlayedRule]:
    """The rules a run has played, from its log, which counts them in the order the run names them."""
    log = record.log
    names = list(record.metrics.get("rules", RULES))
    read = log["encoder_q_rad" if "encoder_q_rad" in log.columns else "q_rad"]
    columns = [log["time_s"], log["path_s_m"], log["target_q_rad"] - read, log["target_qddd_rad_s3"]]
    rows = {rule: log["rule"] == names.index(rule) for rule in RULES if rule in names}
    return {
        rule: PlayedRule(rule, *(column[at] for column in columns)) for rule, at in rows.items() if at.any()
    }


def _key(rule: str) -> str:
    return rule.replace("-", "_")
