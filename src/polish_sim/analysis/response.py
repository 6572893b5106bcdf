"""How a signal behaves in time: contact, settling, rise, averages; the arithmetic under the figures (layer 8c)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONTACT_N = 0.5
"""The tool is in contact when the exact normal force is above this [N]."""


def first_contact(force: Array) -> int | None:
    """Index of the first sample in contact, or None when there is none; ``force`` [N], shape (n,)."""
    touching = force > CONTACT_N
    return int(np.argmax(touching)) if touching.any() else None


def settling_time(time: Array, error: Array, band: float) -> float:
    """Time from the first sample to the moment after which the error stays inside a band.

    Args:
        time: Time [s], shape (n,); the first sample is the event, e.g. first contact.
        error: Signal minus its target, shape (n,).
        band: Half-width of the band, in the unit of ``error``; its edge is inside.

    Returns:
        The time [s], 0 when the error never leaves the band, NaN when it is outside at the last sample or n = 0.
    """
    outside = np.flatnonzero(~(np.abs(error) <= band))
    if len(time) == 0 or (len(outside) and outside[-1] == len(time) - 1):
        return math.nan
    return float(time[outside[-1] + 1] - time[0]) if len(outside) else 0.0


def rise_time(time: Array, value: Array, target: float) -> float:
    """Time between first reaching 10% and first reaching 90% of a target [s]; NaN when 90% is never reached."""
    reached = value >= 0.9 * target
    if not reached.any():
        return math.nan
    return float(time[np.argmax(reached)] - time[np.argmax(value >= 0.1 * target)])


def moving_average(time: Array, value: Array, window: float) -> Array:
    """Mean over a sliding time window, whole windows only.

    Args:
        time: Evenly spaced time [s], shape (n,).
        value: Signal, shape (n,).
        window: Length of the window [s].

    Returns:
        Means, shape (n - k + 1,) with k samples to a window; empty when the signal is shorter than the window.
    """
    if len(time) < 2:
        return np.empty(0)
    samples = max(1, round(window / float(np.median(np.diff(time)))))
    if samples > len(value):
        return np.empty(0)
    sums = np.concatenate([[0.0], np.cumsum(value, dtype=np.float64)])
    return (sums[samples:] - sums[:-samples]) / samples
