"""Way points followed as a smooth curve, with stops where these are faster (Chain, limits ->
SplineMotion)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from polish_sim.arrays import Array, Indices, dots, midpoints, norms, running_sums, spans_at
from polish_sim.errors import SmoothingError
from polish_sim.motion.rules.chain import Chain, part_of
from polish_sim.motion.rules.fir import rest_to_rest
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.rules.paper_rules import Timed, plan_stops
from polish_sim.motion.rules.schedule import Samples
from polish_sim.motion.segment_rates import chebyshev_nodes
from polish_sim.motion.spline.bounded import Bounded, bounded_quantities, time_factors
from polish_sim.motion.spline.curve import (
    DEGREE,
    CurveRates,
    Polyline,
    SplineCurve,
    curve_rates,
    draw_spline,
    fit_curve,
    polyline_of,
)
from polish_sim.motion.spline.law import (
    Law,
    envelope,
    fastest_law,
    launch_of,
    law_knots,
    with_bends,
    with_feed_changes,
)

# The parameter as a function of time (Law -> u(t)).
#
# Where u'^2 is a parabola of u, u'' is linear in u, so that u(t) is made of hyperbolic or circular functions:
# exact.


class Passage(NamedTuple):
    """Pieces of u''' = beta u' + jerk, one of the two zero."""

    times: Array  #: When each begins and, last, the end [s], shape (n + 1,)
    places: Array  #: u there [m], shape (n + 1,)
    speeds: Array  #: u' [m/s], shape (n,)
    accelerations: Array  #: u'' [m/s^2], shape (n,)
    bends: Array  #: beta [1/s^2], shape (n,)
    jerks: Array  #: [m/s^3], shape (n,)

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.times[-1])


def pass_by(law: Law) -> Passage:
    """When the parameter is where."""
    (spline, launch), knots = law, law.knots
    speeds, slopes, bends = np.sqrt(spline(knots)), 0.5 * spline(knots, 1), 0.5 * spline(knots[:-1], 2)
    # The way over the sum of both speeds is tan(w T / 2) / w, with w^2 = -beta, or tanh.
    share, rate = np.diff(knots) / (speeds[1:] + speeds[:-1]), np.sqrt(np.abs(bends))
    angles = np.where(bends > 0.0, np.arctanh(np.minimum(rate * share, 1.0 - 1e-15)), np.arctan(rate * share))
    spans = 2.0 * np.where(rate * share > 1e-6, angles / np.maximum(rate, 1e-300), share)
    times = np.cumsum([0.0, launch.duration, *spans, launch.duration])
    jerks = np.zeros(len(times) - 1)
    jerks[[0, -1]] = launch.jerk
    places = np.concatenate([[0.0], knots, [knots[-1] + launch.way]])
    bends = np.concatenate([[0.0], bends, [0.0]])
    return Passage(times, places, np.append(0.0, speeds), np.append(0.0, slopes), bends, jerks)


def passage_at(passage: Passage, times: Array) -> Array:
    """u [m] and its first three derivatives at times from 0 to the duration [s], shape (4, m)."""
    i = spans_at(passage.times, times)
    t = np.minimum(times, passage.duration) - passage.times[i]
    a, v, beta, j = (
        column[i] for column in (passage.accelerations, passage.speeds, passage.bends, passage.jerks)
    )
    sine, rise = _waves(t, beta)
    speed = v * (1.0 + beta * rise) + a * sine + j * rise
    # Rounding may not let a piece reach into the next one, behind a stop.
    last = np.nextafter(passage.places[i + 1], -1.0)
    return np.stack(
        [
            np.minimum(
                np.maximum(passage.places[i] + v * sine + a * rise + j * t**3 / 6.0, passage.places[i]), last
            ),
            speed,
            v * beta * sine + a * (1.0 + beta * rise) + j * t,
            beta * speed + j,
        ]
    )


def slowed(passage: Passage, factor: float) -> Passage:
    """The same way in ``factor`` times the time."""
    powers = (1, 0, -1, -2, -2, -3)
    return Passage(*(column * factor**k for column, k in zip(passage, powers, strict=True)))


def _waves(t: Array, beta: Array) -> tuple[Array, Array]:
    """sinh(w t) / w and (cosh(w t) - 1) / w^2 with w^2 = beta, of either sign."""
    w = np.sqrt(np.abs(beta))
    x = np.minimum(w * t, math.log(1e6))
    small = x < 1e-4
    by, up = np.where(small, 1.0, w), beta > 0.0
    sine = np.where(up, np.sinh(x), np.sin(x)) / by
    rise = 2.0 * np.where(up, np.sinh(0.5 * x), np.sin(0.5 * x)) ** 2 / by**2
    return np.where(small, t * (1.0 + beta * t * t / 6.0), sine), np.where(small, 0.5 * t * t, rise)


class SplineMotion(NamedTuple):
    """A curve and when its parameter is passed, from rest to rest; what `Smoothed` is for other rules."""

    line: Polyline
    curve: SplineCurve
    passage: Passage

    @property
    def end(self) -> float:
        """The cycle time [s]."""
        return self.passage.duration

    @property
    def edges(self) -> Array:
        """Times between which all derivatives are smooth [s], rising."""
        return self.passage.times

    def sample(self, times: Array) -> Samples:
        """Pose and rates of the tool at times (n,) [s]."""
        u, v, a, j = passage_at(self.passage, np.clip(times, 0.0, self.end))
        rates = curve_rates(self.curve, np.clip(u, 0.0, self.curve.length))
        v, a, j = ((times < self.end) * each for each in (v, a, j))
        v, a, j = v[:, None], a[:, None], j[:, None]
        tips, axes = (_in_time(jet, v, a, j) for jet in (rates.tips, rates.axes))
        s0, s1, s2 = rates.spins
        spins = np.stack([s0 * v, s1 * v**2 + s0 * a, s2 * v**3 + 3.0 * s1 * v * a + s0 * j], axis=1)
        return Samples(tips, axes, rates.rotations, spins)

    def stretched(self, factor: float) -> SplineMotion:
        """The same motion in ``factor`` times the time."""
        return self._replace(passage=slowed(self.passage, factor))

    def under_way(self, times: Array) -> tuple[Indices, Indices]:
        """First segment the curve is drawn from at times (n,) [s], and the one past the last."""
        u, knots = passage_at(self.passage, times)[0], self.curve.knots
        i = np.searchsorted(knots, u, side="right") - 1
        low, high = knots[np.maximum(i - REACH, 0)], knots[np.minimum(i + 1 + REACH, len(knots) - 1)]
        stop = np.searchsorted(self.line.u, high - 1e-12)
        return spans_at(self.line.u, low + 1e-12), np.minimum(stop, len(self.line.u) - 1)

    def places_at(self, marks: Array, times: Array) -> tuple[Array, Array]:
        """Arc length reached at rising times (n,) [s] and its rate; way points are at ``marks`` (segments +
        1,) [m].

        Marks that are the places the motion was planned with are reached by the curve itself, smoothly.
        """
        u, speed = passage_at(self.passage, np.clip(times, 0.0, self.end))[:2]
        if marks is self.line.places:
            rates = curve_rates(self.curve, u).places
            return np.maximum.accumulate(rates[0]), np.maximum(rates[1] * speed, 0.0)
        k = spans_at(self.line.u, u)
        return np.interp(u, self.line.u, marks), speed * (np.diff(marks) / np.diff(self.line.u))[k]


REACH = 3  #: Spans on either side from which the chain shapes a curve


def _in_time(jet: Array, v: Array, a: Array, j: Array) -> Array:
    x, x1, x2, x3 = jet
    return np.stack([x, x1 * v, x2 * v**2 + x1 * a, x3 * v**3 + 3.0 * x2 * v * a + x1 * j], axis=1)


# Stretches between stops.


class Feed(NamedTuple):
    """The wanted rate of the place on the path."""

    places: Array  #: [m], never falling; a step of the feed has two, shape (n,)
    speeds: Array  #: [m/s], positive, shape (n,)

    def at(self, places: Array) -> Array:
        """The smaller one where it steps [m/s], shape (m,)."""
        return np.minimum(np.interp(places - 1e-9, *self), np.interp(places + 1e-9, *self))


class SplineTask(NamedTuple):
    """What all stretches have in common."""

    feed: Feed
    limits: SmoothingLimits
    tolerances: tuple[float, float]  #: Of the tip [m] and the tool's axis [rad]
    arm: Arm | None
    of_tip: bool  #: Whether the feed is the tip's, not the place's

    def feed_cap(self, rates: CurveRates) -> Array:
        """Largest u' at places of a curve with which the feed is kept [m/s], shape (n,)."""
        pace = norms(rates.tips[1]) if self.of_tip else rates.places[1]
        return self.feed.at(rates.places[0]) / np.maximum(pace, 1e-9)

    def bounded(self, curve: SplineCurve, u: Array, q: Array) -> Bounded:
        """What is limited at places of a curve (n,) [m]; joints near ``q`` (6,) at the first."""
        return bounded_quantities(curve_rates(curve, u), self.limits, self.arm_near(q))

    def arm_near(self, q: Array) -> Arm | None:
        """The arm in its configuration at some way point."""
        return self.arm and self.arm._replace(q_start=q)


MOST_ROUNDS = 12  #: Of stops added
LAUNCH_SHARES = (0.5, 0.1)  #: Of the launch that are tried until a law is found
SPARE = 1.0003  #: More time than the places looked at need
STOP_STEP = 0.05  #: Between knots of a curve without corners [rad]
FINAL_LOOKS = np.clip(chebyshev_nodes(17), 1e-6, 1.0 - 1e-6)
"""In every piece of a passage; those between every fourth only where they can be the worst."""
BULGE = 0.5  #: Of second differences, what factors may be above their neighbours


def plan_spline(
    chain: Chain, places: Array, feed: Feed, limits: SmoothingLimits, tolerances: tuple[float, float],
    arm: Arm | None, of_tip: bool = False,
) -> SplineMotion:  # fmt: skip
    """The fastest motion found along a smooth curve near a chain, no faster than a feed; never slower than
    stops.

    Args:
        chain: The way points, at least one segment.
        places: Arc length of the path at them [m], never falling, shape (segments + 1,).
        feed: Largest rate of it, or of the tip, if it is ``of_tip``.
        limits: Of tool and joints.
        tolerances: Of the tip [m] and the tool's axis [rad]; 0: stops at every way point.
        arm: The robot; None: tool only.

    Returns:
        The motion, from rest to rest.

    Raises:
        ReachError: The arm cannot follow it; names a place.
        SmoothingError: No speed keeps the joints' limits; names a segment.
    """
    task, n = SplineTask(feed, limits, tolerances, arm, of_tip), len(chain.lengths)
    slowest = np.minimum(feed.at(places[:-1] + 1e-6), feed.at(places[1:] - 1e-6))
    steps = np.diff(places)
    feeds = np.where(steps > 0.0, slowest * chain.lengths / np.where(steps > 0.0, steps, 1.0), np.inf)
    stops = plan_stops(chain, limits, arm, feeds)
    known: dict[tuple[int, int], SplineMotion | Indices] = {}
    cuts = np.arange(n + 1) if min(tolerances) <= 0.0 else np.array([0, n])
    for _ in range(MOST_ROUNDS):
        old = cuts
        for a, b in pairwise(old.tolist()):
            if b - a > 1 and (a, b) not in known:
                known[a, b] = found = _stretch(task, chain, places, a, b, stops)
                cuts = cuts if isinstance(found, SplineMotion) else np.union1d(cuts, a + 1 + found)
        if len(cuts) == len(old):
            break
    parts: list[SplineMotion] = []
    for a, b in pairwise(cuts.tolist()):
        smooth = known.get((a, b))
        if not isinstance(smooth, SplineMotion) or smooth.end > stops.triples[a:b].sum():
            parts += [_stop(task, chain, places, k, stops) for k in range(a, b)]
        else:
            parts.append(smooth)
    return _joined(polyline_of(chain, places), parts)


def _slower(line: Polyline, passage: Passage, lasting: Array) -> Indices:
    """Inner way points where stops are faster, from middle to middle of their segments, and more so than
    beside them."""
    times = np.linspace(0.0, passage.duration, 4 * len(passage.places))
    middles = np.interp(midpoints(line.u), passage_at(passage, times)[0], times)
    ends = np.cumsum(lasting)
    late = (middles - ends + 0.5 * lasting)[1:-1]
    spans = np.diff(np.concatenate([[0.0], late, [passage.duration - ends[-1]]]))
    lost = np.concatenate([[0.0], spans, [0.0]])
    return np.flatnonzero((lost[1:-1] > 0.0) & (lost[1:-1] >= np.maximum(lost[:-2], lost[2:])))


def _stretch(
    task: SplineTask, chain: Chain, places: Array, a: int, b: int, stops: Timed
) -> SplineMotion | Indices:
    """The fastest motion along a smooth curve near some segments, or the inner way points to stop at.

    These are where stops are faster; where there is no motion the sharpest.
    """
    part = part_of(chain, slice(a, b))
    line = polyline_of(part, places[a : b + 1])
    sharpest = np.array([dots(part.directions[1:], part.directions[:-1]).argmin()])
    try:
        curve = fit_curve(line, *task.tolerances)
    except SmoothingError:
        return sharpest

    def ends(way: Array) -> Bounded:
        first = task.bounded(curve, way, stops.q[a])
        last = task.bounded(curve, curve.length - way, stops.q[b])
        return first._replace(rates=np.concatenate([first.rates, last.rates], axis=1))

    arm = task.arm_near(stops.q[a])
    bent = np.flatnonzero(np.abs(np.diff(task.feed.speeds, 2)) > 1e-9) + 1
    coarse = with_feed_changes(curve.knots, np.interp(task.feed.places[bent], line.places, line.u))

    def look(u: Array) -> tuple[Bounded, Array]:
        rates = curve_rates(curve, u)
        return bounded_quantities(rates, task.limits, arm), task.feed_cap(rates)

    def slower(law: Law) -> Indices:
        return _slower(line, pass_by(law), stops.triples[a:b].sum(axis=1))

    coarse = with_bends(coarse, *look(coarse))
    bounded, caps = look(coarse)
    still = bounded._replace(rates=bounded.rates[:, [0, -1]])
    launch = launch_of(curve.length, float(caps[[0, -1]].min()), still, ends)
    for share in LAUNCH_SHARES:
        begun = launch._replace(duration=share * launch.duration)
        found = fastest_law(
            law_knots(coarse, envelope(coarse, caps, bounded, begun), caps, begun), look, begun, slower
        )
        if found is not None:
            break
    if isinstance(found, np.ndarray):
        return found
    if found is None or not math.isfinite(found[1]):
        return sharpest
    passage = pass_by(found[0])
    passage.places[-1] = curve.length
    passage = _within_limits(task, curve, slowed(passage, max(1.0, found[1])), stops.q[a])
    return SplineMotion(line, curve, passage)


def _stop(task: SplineTask, chain: Chain, places: Array, k: int, stops: Timed) -> SplineMotion:
    """One segment from rest to rest."""
    line = polyline_of(part_of(chain, slice(k, k + 1)), places[k : k + 2])
    length = float(line.u[-1])
    knots = np.linspace(
        0.0, length, max(2, 1 + math.ceil((chain.angles[k] + abs(chain.rolls[k])) / STOP_STEP))
    )
    curve = SplineCurve(draw_spline(line, knots, []), length)
    times, c = rest_to_rest(stops.triples[k])
    n, c = len(c), length * c
    passage = Passage(times, np.append(c[:, 0], length), c[:, 1], 2.0 * c[:, 2], np.zeros(n), 6.0 * c[:, 3])
    return SplineMotion(line, curve, _within_limits(task, curve, passage, stops.q[k], 1.0))


def _within_limits(
    task: SplineTask, curve: SplineCurve, passage: Passage, q: Array, spare: float = SPARE
) -> Passage:
    """A passage slowed as a whole by as much as any place of it needs; joints near ``q`` (6,) at its
    start."""
    looks = passage.times[:-1, None] + FINAL_LOOKS * np.diff(passage.times)[:, None]

    def factors(times: Array) -> Array:
        u, *moved = passage_at(passage, times.ravel())
        return time_factors(task.bounded(curve, u, q), *moved).reshape(times.shape)

    some = factors(looks[:, ::4])
    bulge = np.abs(np.diff(some, 2, axis=1))[:, [0, 0, 1, 2, 2]]
    could = some + BULGE * bulge
    near = np.maximum(could[:, 1:], could[:, :-1]) > some.max()
    others = factors(looks[:, :-1].reshape(-1, 4, 4)[near, 1:])
    return slowed(passage, max(1.0, spare * float(max(some.max(), others.max(initial=0.0)))))


def _joined(line: Polyline, parts: list[SplineMotion]) -> SplineMotion:
    """Stretches one after the other, the curve kinked between them."""
    t = [np.zeros(DEGREE + 1)]
    points = []
    columns = []
    place = 0.0
    clock = 0.0
    for part in parts:
        t.append(place + part.curve.spline.t[DEGREE + 1 :])
        points.append(part.curve.spline.c)
        times, places, *others = part.passage
        columns.append((clock + times[:-1], place + places[:-1], *others))
        place, clock = place + part.curve.length, clock + float(times[-1])
    times, places, *others = (np.concatenate(column) for column in zip(*columns, strict=True))
    curve = SplineCurve(BSpline(np.concatenate(t), np.concatenate(points), DEGREE), place)
    return SplineMotion(line, curve, Passage(np.append(times, clock), np.append(places, place), *others))


NO_FEED = 1e3  #: Stands for an infinite one [m/s]


def smooth_by_spline(
    chain: Chain, limits: SmoothingLimits, tolerance: float, axis_tolerance: float, arm: Arm | None,
    feeds: Array | None = None,
) -> SplineMotion:  # fmt: skip
    """The rule `spline` for any path; arguments as of `Rule`, the tolerance is the contour's."""
    places = running_sums(chain.lengths)
    fastest = np.minimum(np.full(len(chain.lengths), NO_FEED) if feeds is None else feeds, NO_FEED)
    feed = Feed(np.repeat(places, 2)[1:-1], np.repeat(fastest, 2))
    return plan_spline(chain, places, feed, limits, (tolerance, axis_tolerance), arm, True)
