"""Where along a curve the law of time is solved for (Curve -> knots of the law; layer 6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.spline.bounded import Bounded, at_ends, jerk_from_rest, time_factor
from polish_sim.motion.spline.curve import Curve
from polish_sim.motion.spline.law import Launch

Array = NDArray[np.float64]

KNOT_TIME = 0.02
"""Most time between knots: short against the time in which a limit's acceleration is built up [s]."""
KNOTS_PER_SPAN = 4
"""Least number of knots of the law in a span between knots of the curve, at the first try."""
LAUNCH_TIME = 0.005
"""Of constant jerk from rest, at most [s]."""
LAUNCH_SHARE = 0.9
"""Of the largest jerk from rest."""
BEFORE_LIMITS = 0.97
"""Of the speed at which a limit would be met, at the end of the launch."""
LAUNCH_GROWTH = 1.2
"""After it the time from rest grows by this factor from knot to knot, until knots are ``KNOT_TIME`` apart."""
SAME_KNOT = 2e-5
"""Knots nearer than this are not told apart [m]."""


def coarse_knots(curve: Curve, refinement: int) -> Array:
    """Some parameters in every span between knots of the curve, ends included [m], shape (n,)."""
    knots, count = curve.knots, refinement * KNOTS_PER_SPAN
    shares = np.arange(count) / count
    return np.append((knots[:-1, None] + shares * np.diff(knots)[:, None]).ravel(), knots[-1])


def launch_of(length: float, slowest: float, quantities: list[Bounded]) -> Launch:
    """The launch of a motion over a length [m]: short beside the way, and until bends make themselves felt.

    After it the speed still rises by as much again while the acceleration fades: that may not pass ``slowest``, the
    smaller speed wanted at the ends [m/s].
    """
    jerk = LAUNCH_SHARE * jerk_from_rest(quantities)
    launch = Launch(jerk, min(LAUNCH_TIME, 0.1 * float(np.cbrt(length / jerk))))
    ends = [at_ends(each) for each in quantities]
    moved = np.ones(2)
    while 2.0 * launch.speed > BEFORE_LIMITS * slowest or max(
        time_factor(each, launch.speed * moved, launch.acceleration * moved, jerk * moved) for each in ends
    ) > BEFORE_LIMITS:  # fmt: skip
        launch = launch._replace(duration=0.7 * launch.duration)
    return launch


def with_feed_changes(coarse: Array, changes: Array) -> Array:
    """Knots (n,) with those where the wanted feed changes its course, unless there is one nearby already [m]."""
    right = np.clip(np.searchsorted(coarse, changes), 1, len(coarse) - 1)
    apart = np.minimum(np.abs(changes - coarse[right - 1]), np.abs(coarse[right] - changes))
    return np.union1d(coarse, changes[apart > SAME_KNOT])


def law_knots(coarse: Array, speeds: Array, launch: Launch, refinement: int) -> Array:
    """Knots from launch to landing, close together where the motion is slow.

    Args:
        coarse: First knots [m], from 0, shape (n,).
        speeds: Largest u' expected there [m/s], shape (n,).
        launch: From rest.
        refinement: Divides ``KNOT_TIME``.

    Returns:
        Knots [m], rising.
    """
    steps, length, most = np.diff(coarse), float(coarse[-1]), KNOT_TIME / refinement
    parts = np.maximum(1, np.ceil(steps / (most * np.maximum(speeds[1:], speeds[:-1])))).astype(int)
    counted = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    inner = np.repeat(coarse[:-1], parts) + counted * np.repeat(steps / parts, parts)
    last = max(most / (LAUNCH_GROWTH - 1.0) / launch.duration, LAUNCH_GROWTH**2)
    times = launch.duration * LAUNCH_GROWTH ** np.arange(1 + int(np.log(last) / np.log(LAUNCH_GROWTH)))
    first = launch.jerk / 6.0 * times**3
    first = first[first < 0.3 * length]
    clear = 2.0 * first[-1] - first[-2]
    inner = inner[(inner > clear) & (inner < length - clear)]
    return np.concatenate([first, inner, length - first[::-1]])
