"""The parameter as a function of time (Law -> u(t); layer 6).

Where u'^2 is a parabola of u, u'' is linear in u, so that u(t) is made of hyperbolic or circular functions: exact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.spline.law import Launch, Law
from polish_sim.motion.spline.squares import around

Array = NDArray[np.float64]


class Passage(NamedTuple):
    """Spans of u'' = a + beta (u - u0) between launch and landing."""

    launch: Launch
    times: Array
    """When each begins and, last, when the landing does [s], shape (n,)."""
    places: Array
    """u there [m], shape (n,)."""
    speeds: Array
    """u' [m/s], shape (n,)."""
    accelerations: Array
    """u'' [m/s^2], shape (n,)."""
    bends: Array
    """beta [1/s^2], shape (n - 1,)."""

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.times[-1]) + self.launch.duration


def pass_by(law: Law) -> Passage:
    """When the parameter is where."""
    squares, controls, launch = law
    speeds = np.sqrt(around(squares.values, controls))
    bends = 0.5 * around(squares.bends, controls)
    # The way over the sum of both speeds is tan(w T / 2) / w, with w^2 = -beta, or tanh.
    share, rate = np.diff(squares.knots) / (speeds[1:] + speeds[:-1]), np.sqrt(np.abs(bends))
    angles = np.where(bends > 0.0, np.arctanh(np.minimum(rate * share, 1.0 - 1e-15)), np.arctan(rate * share))
    spans = 2.0 * np.where(rate * share > 1e-6, angles / np.maximum(rate, 1e-300), share)
    return Passage(
        launch, launch.duration + np.concatenate([[0.0], np.cumsum(spans)]), squares.knots, speeds,
        0.5 * around(squares.slopes, controls), bends,
    )  # fmt: skip


def passage_at(passage: Passage, times: Array) -> Array:
    """u [m] and its first three derivatives at times from 0 to the duration [s], shape (4, m)."""
    i = np.clip(np.searchsorted(passage.times, times, side="right") - 1, 0, len(passage.times) - 2)
    t, a, v, beta = times - passage.times[i], passage.accelerations[i], passage.speeds[i], passage.bends[i]
    sine, rise = _waves(t, beta)
    cosine = 1.0 + beta * rise
    between = np.stack([
        passage.places[i] + v * sine + a * rise, v * cosine + a * sine, v * beta * sine + a * cosine,
        beta * (v * cosine + a * sine),
    ])  # fmt: skip
    jerk, end = passage.launch.jerk, passage.duration
    length = passage.places[-1] + passage.launch.way
    early, late = times < passage.times[0], times > passage.times[-1]
    left = end - times
    first = _launched(times, jerk)
    last = _launched(left, jerk) * np.array([[-1.0], [1.0], [-1.0], [1.0]]) + np.array([[length], [0.0], [0.0], [0.0]])
    return np.where(early, first, np.where(late, last, between))


def slowed(passage: Passage, factor: float) -> Passage:
    """The same way in ``factor`` times the time."""
    launch = Launch(passage.launch.jerk / factor**3, passage.launch.duration * factor)
    return Passage(
        launch, passage.times * factor, passage.places, passage.speeds / factor, passage.accelerations / factor**2,
        passage.bends / factor**2,
    )  # fmt: skip


def _launched(t: Array, jerk: float) -> Array:
    return np.stack([jerk * t**3 / 6.0, 0.5 * jerk * t**2, jerk * t, np.full_like(t, jerk)])


def _waves(t: Array, beta: Array) -> tuple[Array, Array]:
    """sinh(w t) / w and (cosh(w t) - 1) / w^2 with w^2 = beta, of either sign."""
    w = np.sqrt(np.abs(beta))
    x = np.minimum(w * t, math.log(1e6))
    small = x < 1e-4
    by, up = np.where(small, 1.0, w), beta > 0.0
    sine = np.where(up, np.sinh(x), np.sin(x)) / by
    rise = 2.0 * np.where(up, np.sinh(0.5 * x), np.sin(0.5 * x)) ** 2 / by**2
    return np.where(small, t * (1.0 + beta * t * t / 6.0), sine), np.where(small, 0.5 * t * t, rise)
