"""Way points followed as a smooth curve at a feed (Chain, limits -> TimedPath)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import SmoothingError, place_in_mm
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.spline.bounded import Bounded, bounded_quantities, time_factors
from polish_sim.motion.spline.curve import Curve, Polyline, curve_rates, fit_curve, polyline_of
from polish_sim.motion.spline.law import (
    KNOTS_PER_SPAN,
    LOOKS,
    MOST_SLOWED,
    Launch,
    Law,
    around,
    divided,
    envelope,
    factors_of_spans,
    keep_limits,
    launch_of,
    law_knots,
    plan_law,
    refine_law,
    with_feed_changes,
)
from polish_sim.motion.timed_path import TimedPath, row_times
from polish_sim.motion.trajectory import continuous_quaternions

# The parameter as a function of time (Law -> u(t)).
#
# Where u'^2 is a parabola of u, u'' is linear in u, so that u(t) is made of hyperbolic or circular functions: exact.


class Passage(NamedTuple):
    """Spans of u'' = a + beta (u - u0) between launch and landing."""

    launch: Launch
    landing: Launch  #: Played backwards
    times: Array  #: When each begins and, last, when the landing does [s], shape (n,)
    places: Array  #: u there [m], shape (n,)
    speeds: Array  #: u' [m/s], shape (n,)
    accelerations: Array  #: u'' [m/s^2], shape (n,)
    bends: Array  #: beta [1/s^2], shape (n - 1,)

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.times[-1]) + self.landing.duration


def pass_by(law: Law) -> Passage:
    """When the parameter is where."""
    squares, controls, launch, landing = law
    speeds = np.sqrt(around(squares.values, controls))
    bends = 0.5 * around(squares.bends, controls)
    # The way over the sum of both speeds is tan(w T / 2) / w, with w^2 = -beta, or tanh.
    share, rate = np.diff(squares.knots) / (speeds[1:] + speeds[:-1]), np.sqrt(np.abs(bends))
    angles = np.where(bends > 0.0, np.arctanh(np.minimum(rate * share, 1.0 - 1e-15)), np.arctan(rate * share))
    spans = 2.0 * np.where(rate * share > 1e-6, angles / np.maximum(rate, 1e-300), share)
    return Passage(
        launch, landing, launch.duration + np.concatenate([[0.0], np.cumsum(spans)]), squares.knots, speeds,
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
    end, length = passage.duration, passage.places[-1] + passage.landing.way
    early, late = times < passage.times[0], times > passage.times[-1]
    left = end - times
    first = _launched(times, passage.launch.jerk)
    last = _launched(left, passage.landing.jerk) * np.array([[-1.0], [1.0], [-1.0], [1.0]])
    last[0] += length
    return np.where(early, first, np.where(late, last, between))


def slowed(passage: Passage, factor: float) -> Passage:
    """The same way in ``factor`` times the time."""
    return Passage(
        passage.launch.slowed(factor), passage.landing.slowed(factor), passage.times * factor, passage.places,
        passage.speeds / factor, passage.accelerations / factor**2, passage.bends / factor**2,
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


MOST_HALVINGS = 6
"""How often spans of the law that are beyond a limit between their knots are halved, of laws with few knots."""
HALVED_KNOTS = 8_000  #: Knots of all halvings together


class Feed(NamedTuple):
    """The wanted rate of the place on the path."""

    places: Array  #: [m], rising, shape (n,)
    speeds: Array  #: [m/s], positive, shape (n,)


class _Look(NamedTuple):
    """What bounds the speed along a curve."""

    caps: Array  #: Largest u' by the feed, at the knots [m/s], shape (n,)
    at_knots: list[Bounded]
    between: list[Bounded]  #: At the knots divided by ``LOOKS``


class SplineMotion(NamedTuple):
    """A curve and when its parameter is passed."""

    curve: Curve
    passage: Passage


def plan_spline(
    chain: Chain, places: Array, feed: Feed, limits: SmoothingLimits, tolerances: tuple[float, float], arm: Arm | None
) -> SplineMotion:
    """The fastest motion along a smooth curve near a chain, no faster than a feed.

    Args:
        chain: The way points, at least one segment.
        places: Arc length of the path at them [m], never falling, shape (segments + 1,).
        feed: Largest rate of it.
        limits: Of tool and joints.
        tolerances: Of the tip [m] and the tool's axis [rad], positive.
        arm: The robot; None: tool only.

    Returns:
        The motion, from rest to rest.

    Raises:
        SmoothingError: There is no such curve; names a place.
        ReachError: The arm cannot follow it; names a place.
    """
    line = polyline_of(chain, places)
    curve = fit_curve(line, *tolerances)
    coarse = with_feed_changes(divided(curve.knots, KNOTS_PER_SPAN), _changes(feed, line))
    law, factor = _fastest(curve, coarse, feed, limits, arm)
    passage = pass_by(law)
    factor = max(factor, _time_at_ends(curve, passage, limits, arm))
    if not np.isfinite(factor):
        start = place_in_mm(chain.tips[0])
        raise SmoothingError(f"no law of time was found from {start} on. Set smoothing.rule to certified.")
    return SplineMotion(curve, slowed(passage, max(factor, 1.0)))


def _time_at_ends(curve: Curve, passage: Passage, limits: SmoothingLimits, arm: Arm | None) -> float:
    """How much more time a passage must take to keep every limit at ``LOOKS`` places of launch and of landing."""
    share = np.linspace(0.0, passage.times[0], LOOKS, endpoint=False)
    u, *moved = passage_at(passage, np.concatenate([share, passage.duration - share]))
    rates = curve_rates(curve, np.clip(u, 0.0, curve.length))
    return max(float(time_factors(each, *moved).max()) for each in bounded_quantities(rates, limits, arm))


def _changes(feed: Feed, line: Polyline) -> Array:
    """Parameters at which the wanted feed begins or ceases to change [m]."""
    bent = np.flatnonzero(np.abs(np.diff(feed.speeds, 2)) > 1e-9) + 1
    return np.interp(feed.places[bent], line.values[:, 9], line.u)


def _fastest(curve: Curve, coarse: Array, feed: Feed, limits: SmoothingLimits, arm: Arm | None) -> tuple[Law, float]:
    """The fastest law through coarse knots and those between, and how much more time it needs (``keep_limits``)."""
    rates = curve_rates(curve, coarse)
    bounded = bounded_quantities(rates, limits, arm)
    caps = _feed_cap(rates.places, feed)
    launch = launch_of(curve.length, float(caps[[0, -1]].min()), bounded)
    knots = law_knots(coarse, envelope(coarse, caps, bounded, launch), caps, launch)
    looked = _look(curve, knots, feed, limits, arm)
    law = plan_law(knots, looked.caps, looked.at_knots, launch)
    for _ in range(min(MOST_HALVINGS, HALVED_KNOTS // len(knots))):
        over = factors_of_spans(law, looked.between) > MOST_SLOWED
        if not over.any():
            break
        near = np.convolve(over, np.ones(3), "same") > 0.5
        knots = np.union1d(knots, 0.5 * (knots[:-1] + knots[1:])[near])
        looked = _look(curve, knots, feed, limits, arm)
        law = refine_law(law, knots, looked.caps, looked.at_knots)
    return keep_limits(law, looked.between)


def _look(curve: Curve, knots: Array, feed: Feed, limits: SmoothingLimits, arm: Arm | None) -> _Look:
    rates = curve_rates(curve, divided(knots, LOOKS))
    between = bounded_quantities(rates, limits, arm)
    at_knots = [each._replace(rates=np.ascontiguousarray(each.rates[:, ::LOOKS])) for each in between]
    return _Look(_feed_cap(rates.places[:, ::LOOKS], feed), at_knots, between)


def time_spline(motion: SplineMotion) -> TimedPath:
    """Sample a motion densely."""
    curve, passage = motion
    clock = row_times(passage.duration)
    u, speed = passage_at(passage, clock)[:2]
    rates = curve_rates(curve, np.clip(u, 0.0, curve.length), 2)
    return TimedPath(
        float(clock[1] - clock[0]),
        passage.duration,
        np.ascontiguousarray(rates.tips[0]),
        rates.tips[1] * speed[:, None],
        continuous_quaternions(rates.rotations),
        rates.spins[0] * speed[:, None],
        np.maximum.accumulate(rates.places[0]),
        np.maximum(rates.places[1] * speed, 0.0),
        np.ones(len(clock)),
    )


def _feed_cap(places: Array, feed: Feed) -> Array:
    """Largest u' at which the place on the path, with derivatives (4, n), keeps the feed [m/s], shape (n,)."""
    return np.asarray(np.interp(places[0], *feed) / np.maximum(places[1], 1e-9))
