"""How far the joints lag behind when the same path is played with several smoothing rules (paper 4, fig. 10; 8c)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

REFERENCE = "joint-acceleration"
"""The rule the others are compared with."""
AROUND_S = 0.03  # of a jerk peak belongs to it, before and after [s]
APART_S = 0.05  # between two peaks, at least [s]
HIGH = 0.8  # of the largest jerk is a peak where none breaks the limit


class PlayedRule(NamedTuple):
    """A path played with one rule; rows of n equal steps of time."""

    rule: str
    time: Array
    """[s], shape (n,)."""
    place: Array
    """Arc length of the path the targets are at [m], shape (n,)."""
    error: Array
    """Target less joint position [rad], shape (n, 6)."""
    jerk: Array
    """Third derivative of the targets [rad/s^3], shape (n, 6)."""


class AtPeak(NamedTuple):
    """Tracking error of one joint where the reference rule's jerk peaks."""

    joint: int
    place: float
    """Where on the path [m]."""
    reference: float
    """Largest error there with the reference rule [rad]."""
    error: float
    """Largest error on the same stretch of path with the other rule [rad]."""

    @property
    def reduction(self) -> float:
        """Share of the reference's error that is gone; negative where the error rises."""
        return 1.0 - self.error / self.reference


def measure_tracking(play: PlayedRule) -> dict[str, Any]:
    """Largest and root mean square tracking error of each joint over the whole path.

    Args:
        play: The path as it was played.

    Returns:
        tracking_error_max_rad and tracking_error_rms_rad, one value a joint.
    """
    return {
        "tracking_error_max_rad": np.abs(play.error).max(axis=0).tolist(),
        "tracking_error_rms_rad": np.sqrt(np.mean(play.error**2, axis=0)).tolist(),
    }


def compare_tracking(play: PlayedRule, reference: PlayedRule, jerk_limits: Array) -> dict[str, Any]:
    """Compare a rule's tracking errors with the reference rule's.

    Args:
        play: The rule.
        reference: The rule it is compared with, on the same path.
        jerk_limits: Of the six joints [rad/s^3], shape (6,).

    Returns:
        jerk_peaks: how many of the reference there are; reduction_largest, reduction_largest_joint (1 to 6) and
        reduction_median over them; rise_largest: 0 if no error rises; reduction_max and reduction_rms: of the whole
        path's errors, one value a joint.
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
        "reduction_max": _reduced(own, other, "tracking_error_max_rad"),
        "reduction_rms": _reduced(own, other, "tracking_error_rms_rad"),
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


def jerk_peaks(play: PlayedRule, joint: int, limit: float) -> Rows:
    """Rows at which a joint's jerk peaks above its limit; if it never does, near its own largest value."""
    size = np.abs(play.jerk[:, joint])
    least = limit if size.max() > limit else HIGH * size.max()
    framed = np.concatenate([[0.0], size, [0.0]])  # a peak may stand at an end
    rows, _ = find_peaks(framed, height=least, distance=max(1, round(APART_S / _step(play.time))))
    return np.asarray(rows - 1, dtype=np.int64)


def _reduced(own: dict[str, Any], other: dict[str, Any], name: str) -> list[float]:
    return [1.0 - a / b if b > 0.0 else math.nan for a, b in zip(own[name], other[name], strict=True)]


def _step(time: Array) -> float:
    return float(time[1] - time[0])
