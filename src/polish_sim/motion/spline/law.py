"""The fastest law of time along a curve whose quantities keep their limits (Bounded -> u'^2).

The unknown is b = u'^2, a quadratic spline of u that is to be as large as possible everywhere. Acceleration is linear
in b. Jerk is u' times something linear: that something has to stay below limit / sqrt(b), and the tangent of
1 / sqrt(b) at the last solution is below it for every b. So each round is a linear programme whose solution keeps
what was asked for; asked for are, round by round, the directions in which a vector has come near its limit or beyond.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from polish_sim.arrays import Array, Bools, Indices
from polish_sim.motion.spline.bounded import (
    SLOWEST_TURN,
    Bounded,
    at_ends,
    jerk_from_rest,
    speed_cap,
    steady_cap,
    time_factors,
)
from polish_sim.motion.spline.program import Rows, maximize

# The square of the parameter's speed as a quadratic spline of the parameter (knots -> stencils).
#
# b(u) has one control value more than knots. At a knot b and its slope depend on two of them, on a span between knots
# the second derivative, which is constant there, on three: control values i - 1, i and i + 1 around a centre i.


class Squares(NamedTuple):
    """How b and its derivatives follow from n + 1 control values with n knots."""

    knots: Array  #: [m], rising, shape (n,)
    values: Array  #: Of b at the knots; row k is about centre k + 1, as are the slopes, shape (n, 3)
    slopes: Array  #: Of b_u at the knots [1/m], shape (n, 3)
    bends: Array  #: Of b_uu on the spans; row k is about centre k + 1 [1/m^2], shape (n - 1, 3)
    end_values: Array  #: Of b at the end of every span, about its centre, shape (n - 1, 3)
    end_slopes: Array  #: Of b_u there [1/m], shape (n - 1, 3)


def squares_on(knots: Array) -> Squares:
    """The spline on knots (n,) [m], n at least 3."""
    spans = np.diff(knots)
    before, after = np.concatenate([[0.0], spans]), np.concatenate([spans, [0.0]])
    whole = before + after
    none = np.zeros_like(whole)
    values = np.stack([after / whole, before / whole, none], axis=1)
    slopes = np.stack([-2.0 / whole, 2.0 / whole, none], axis=1)
    end_values, end_slopes = np.roll(values[1:], 1, axis=1), np.roll(slopes[1:], 1, axis=1)
    return Squares(knots, values, slopes, (end_slopes - slopes[:-1]) / spans[:, None], end_values, end_slopes)


def control_values(squares: Squares, b: Array) -> Array:
    """Control values of a spline near values b at the knots (n,), shape (n + 1,)."""
    return np.concatenate([b[:1], 0.5 * (b[:-1] + b[1:]), b[-1:]])


def around(stencils: Array, controls: Array) -> Array:
    """What the stencils (m, 3) give of control values, row k about centre k + 1, shape (m,)."""
    padded = np.concatenate([controls, [0.0]])
    m = len(stencils)
    return np.asarray(sum(stencils[:, k] * padded[k : k + m] for k in range(3)))


# Acceleration and jerk along a curve as linear functions of b = u'^2 (Bounded, Squares -> rows).

NEAR = 0.9  #: Share of a limit from which a row is asked for


class Terms(NamedTuple):
    """A quantity's acceleration at every knot, or its jerk over u' at one end of every span."""

    factors: Array  #: Of three control values about a centre, k + 1 for row k, over the limit, shape (m, 3, d)
    ways: Array  #: The quantity's own direction there, zero where it stands still, shape (m, d)
    squares: Array | None  #: Factors of b there, of jerks; None: acceleration, shape (m, 3)


class Cuts(NamedTuple):
    """Directions in which terms are to stay below 1 (over u', if they are jerks)."""

    numbers: Indices  #: Of the terms, shape (m,)
    factors: Array  #: Shape (m, 3)
    squares: Array | None  #: As of the terms, of all of them


def terms_of(law: Squares, quantity: Bounded) -> tuple[Terms, Terms, Terms]:
    """Acceleration at the knots, jerk where spans begin and where they end; rates are given at the knots."""
    x1, x2, x3 = quantity.rates
    acceleration = _outer(law.values, x2) + 0.5 * _outer(law.slopes, x1)
    begin = _outer(law.values[:-1], x3[:-1]) + 1.5 * _outer(law.slopes[:-1], x2[:-1])
    end = _outer(law.end_values, x3[1:]) + 1.5 * _outer(law.end_slopes, x2[1:])
    begin += 0.5 * _outer(law.bends, x1[:-1])
    end += 0.5 * _outer(law.bends, x1[1:])
    sizes = np.linalg.norm(x1, axis=1, keepdims=True)
    ways = np.where(sizes > SLOWEST_TURN, x1 / np.maximum(sizes, SLOWEST_TURN), 0.0)
    return (
        Terms(acceleration / quantity.limits[1], ways, None),
        Terms(begin / quantity.limits[2], ways[:-1], law.values[:-1]),
        Terms(end / quantity.limits[2], ways[1:], law.end_values),
    )


def along_the_way(terms: Terms) -> Cuts:
    """Both signs of the quantity's own direction, wherever it moves."""
    moving = np.flatnonzero(terms.ways.any(axis=1))
    return _both_signs(terms, moving, terms.ways[moving])


def beyond(terms: Terms, controls: Array) -> tuple[float, Cuts]:
    """The largest value over the limit, and cuts where it is nearly one or more."""
    vectors = np.stack([around(terms.factors[:, :, d], controls) for d in range(terms.factors.shape[2])], axis=1)
    sizes = np.linalg.norm(vectors, axis=1)
    over = sizes if terms.squares is None else sizes * np.sqrt(around(terms.squares, controls))
    near = np.flatnonzero(over > NEAR)
    return float(over.max()), _both_signs(terms, near, vectors[near] / sizes[near, None])


def rows_of(cuts: Cuts, controls: Array, size: Array, fixed: Bools) -> Rows:
    """Cuts as rows of unknowns, control values over their ``size``.

    Args:
        cuts: What is asked for.
        controls: Near these, jerks are made linear, shape (n + 1,).
        size: Of the unknowns, shape (n + 1,).
        fixed: Unknowns that keep their size: no factors are left of them, shape (n + 1,).
    """
    at, factors, ends = cuts.numbers, cuts.factors, np.ones(len(cuts.numbers))
    if cuts.squares is not None:
        # 1 / sqrt(b) is at least 1.5 near^-0.5 - 0.5 b near^-1.5.
        near = around(cuts.squares, controls)[at]
        factors = factors + 0.5 * near[:, None] ** -1.5 * cuts.squares[at]
        ends = 1.5 * near**-0.5
    around_it = at[:, None] + np.arange(3)
    sizes, known = (np.append(values, 0.0)[around_it] for values in (size, fixed * 1.0))
    scaled = factors * sizes / ends[:, None]
    return Rows(at + 1, scaled * (1.0 - known), 1.0 - np.sum(scaled * known, axis=1))


def _outer(stencils: Array, rates: Array) -> Array:
    return stencils[:, :, None] * rates[:, None, :]


def _both_signs(terms: Terms, numbers: Indices, ways: Array) -> Cuts:
    along = np.einsum("nkd,nd->nk", terms.factors[numbers], ways)
    return Cuts(np.concatenate([numbers, numbers]), np.concatenate([along, -along]), terms.squares)


MOST_ROUNDS = 20
LEAST_ROUNDS = 3
"""Of laws with many knots: what these leave beyond a limit is little, and slowed down for (``keep_limits``)."""
ROUND_KNOTS = 20_000  #: Knots of all further rounds together
KEPT = 1.01  #: Excess over what is planned with at which the rounds end
EVEN = 1e-4  #: Caps are even where means of neighbouring squares are no more than this share above one of them
LEAST = 1e-6  #: Least share of a first guess a control value is taken for


class Launch(NamedTuple):
    """Constant jerk from rest, and mirrored at the other end into rest."""

    jerk: float  #: [m/s^3]
    duration: float  #: [s]

    @property
    def way(self) -> float:
        """[m]."""
        return self.jerk * self.duration**3 / 6.0

    @property
    def speed(self) -> float:
        """At its end [m/s]."""
        return 0.5 * self.jerk * self.duration**2

    @property
    def acceleration(self) -> float:
        """At its end [m/s^2]."""
        return self.jerk * self.duration

    def slowed(self, factor: float) -> Launch:
        """The same way in ``factor`` times the time."""
        return Launch(self.jerk / factor**3, self.duration * factor)


class Law(NamedTuple):
    """b(u) between the launches."""

    squares: Squares
    controls: Array  #: Its control values [m^2/s^2], shape (n + 1,)
    launch: Launch
    landing: Launch  #: Played backwards


def plan_law(knots: Array, caps: Array, quantities: list[Bounded], launch: Launch) -> Law:
    """The fastest law.

    Args:
        knots: Of b, from the end of the launch to the start of the landing [m], shape (n,).
        caps: Largest u' wanted there [m/s], positive, shape (n,).
        quantities: At the knots.
        launch: How the motion begins; the landing is its mirror image.

    Returns:
        The law; it keeps the limits at the knots, most often within ``KEPT``.
    """
    squares = squares_on(knots)
    caps = np.minimum.reduce([caps, *(speed_cap(each) for each in quantities)])
    most = _most(knots, caps)
    size = np.minimum(most, control_values(squares, envelope(knots, caps, quantities, launch) ** 2))
    fixed = np.zeros(len(size), dtype=bool)
    for two, span in (([0, 1], knots[1] - knots[0]), ([-1, -2], knots[-1] - knots[-2])):
        # Value and slope where the launch hands over.
        size[two] = launch.speed**2 + np.array([0.0, launch.acceleration * span])
        fixed[two] = True
    return _within_limits(Law(squares, size, launch, launch), np.maximum(most, size), quantities, fixed, False)


def refine_law(law: Law, knots: Array, caps: Array, quantities: list[Bounded]) -> Law:
    """Plan a law again on more knots; arguments as of `plan_law`, the law's own knots are among them."""
    squares, old = squares_on(knots), law.squares
    # A control value is the value between two knots that a tangent at the first has there.
    i = np.clip(np.searchsorted(old.knots, knots[:-1], side="right") - 1, 0, len(old.knots) - 2)
    past, bend = knots[:-1] - old.knots[i], around(old.bends, law.controls)[i]
    slope = around(old.slopes, law.controls)[i] + bend * past
    value = around(old.values, law.controls)[i] + (slope - 0.5 * bend * past) * past
    size = np.concatenate([law.controls[:1], value + 0.5 * slope * np.diff(knots), law.controls[-1:]])
    fixed = np.isin(np.arange(len(size)), [0, 1, len(size) - 2, len(size) - 1])
    most = np.maximum(_most(knots, np.minimum.reduce([caps, *(speed_cap(each) for each in quantities)])), size)
    return _within_limits(law._replace(squares=squares, controls=size), most, quantities, fixed, True)


def _within_limits(law: Law, most: Array, quantities: list[Bounded], fixed: Bools, known: bool) -> Law:
    """The fastest law near one, with control values up to ``most`` (n + 1,) and some that are fixed (n + 1,).

    Where the law is ``known`` to be near, what it is beyond is asked for at once.
    """
    squares, size = law.squares, law.controls
    terms: list[Terms] = [each for quantity in quantities for each in terms_of(squares, quantity)]
    asked = [along_the_way(each) for each in terms] + [beyond(each, size)[1] for each in terms if known]
    for _ in range(min(MOST_ROUNDS, LEAST_ROUNDS + ROUND_KNOTS // len(size))):
        rows = [rows_of(each, law.controls, size, fixed) for each in asked]
        shares = maximize(np.ones(len(size)), _bounds(most, size, fixed), rows, law.controls / size)
        if shares is None:
            break
        law = law._replace(controls=size * np.where(fixed, 1.0, np.maximum(shares, LEAST)))
        found = [beyond(each, law.controls) for each in terms]
        asked += [cuts for _, cuts in found]
        if max(excess for excess, _ in found) <= KEPT:
            break
    return law


def _most(knots: Array, caps: Array) -> Array:
    """Largest control values with which u' stays below caps at the knots [m/s] (n,), shape (n + 1,)."""
    square, spans = caps**2, np.diff(knots)
    between, least = 0.5 * (square[:-1] + square[1:]), np.minimum(square[:-1], square[1:])
    # What means of the neighbours give too much at a knot: little, but where the caps change their course.
    given = (between[:-1] * spans[1:] + between[1:] * spans[:-1]) / (spans[:-1] + spans[1:])
    over = np.concatenate([[0.0], np.maximum(given - square[1:-1], 0.0), [0.0]])
    over = np.maximum(over[:-1], over[1:])
    return np.concatenate([square[:1], np.where(over < EVEN * least, between - over, least), square[-1:]])


def envelope(u: Array, caps: Array, quantities: list[Bounded], launch: Launch) -> Array:
    """Speeds a motion without a limit of tangential jerk could have [m/s], shape (n,), positive."""
    square = np.minimum.reduce([caps, *(steady_cap(each) for each in quantities)]) ** 2
    square[[0, -1]] = np.minimum(square[[0, -1]], launch.speed**2)
    tip = quantities[0]
    gain = 2.0 * tip.limits[1] / np.maximum(np.linalg.norm(tip.rates[0], axis=1), 1e-3)
    for rows, before in ((range(1, len(u)), -1), (range(len(u) - 2, -1, -1), 1)):
        for row in rows:
            square[row] = min(square[row], square[row + before] + gain[row] * abs(u[row] - u[row + before]))
    return np.sqrt(square)


def _bounds(most: Array, size: Array, fixed: Bools) -> Rows:
    """0 <= b <= most, in unknowns b / size; fixed ones at most 1."""
    n = np.arange(len(size))
    factors = np.zeros((2 * len(n), 3))
    factors[: len(n), 1], factors[len(n) :, 1] = np.where(fixed, 1.0, size / most), -1.0
    return Rows(np.concatenate([n, n]), factors, np.concatenate([np.ones(len(n)), np.zeros(len(n))]))


# Between the knots: a law is slowed down where it goes beyond a limit, and for a while before and after.

LOOKS = 4  #: Places in every span of the law at which limits are looked at
MOST_SLOWED = 1.0005  #: A law that keeps its limits when it takes this much more time is slowed as a whole
MOST_DIPS = 16
DIP_TIME = 0.05
"""Before and after a place at which the law is slowed down; twice as long after every ``DIPS`` tries [s]."""
DIPS = 2
DIP_STEP = 0.005  #: Of the clock that dips are drawn on [s]
DIP_MORE = 1.002  #: A dip is deeper than needed by this factor: its own slopes take some of the limits


def keep_limits(law: Law, quantities: list[Bounded]) -> tuple[Law, float]:
    """Slow a law down where it is beyond a limit; elsewhere it stays as fast as it is.

    Args:
        law: The law, n knots.
        quantities: At the knots ``divided`` by ``LOOKS``.

    Returns:
        The law, and how much more time it must take to keep every limit between launch and landing: hardly more than 1
        but for laws that need more than ``MOST_DIPS`` tries.
    """
    for attempt in range(MOST_DIPS):
        factors = factors_of_spans(law, quantities)
        if not (np.isfinite(factors).all() and factors.max() > MOST_SLOWED):
            break
        law = _with_dips(law, factors, DIP_TIME * 2.0 ** (attempt // DIPS))
    return law, float(factors_of_spans(law, quantities).max())


def factors_of_spans(law: Law, quantities: list[Bounded]) -> Array:
    """How much more time each span must take to keep the limits, both its ends looked at, shape (n - 1,)."""
    squares, controls = law.squares, law.controls
    spans = np.diff(squares.knots)[:, None]
    bend, slope = around(squares.bends, controls)[:, None], around(squares.slopes, controls)[:-1, None]
    past = np.arange(LOOKS + 1) / LOOKS * spans
    speed = np.sqrt(around(squares.values, controls)[:-1, None] + (slope + 0.5 * bend * past) * past).ravel()
    acceleration, jerk = 0.5 * (slope + bend * past).ravel(), 0.5 * speed * np.repeat(bend, LOOKS + 1)
    places = (LOOKS * np.arange(len(spans))[:, None] + np.arange(LOOKS + 1)).ravel()
    here = [each._replace(rates=each.rates[:, places]) for each in quantities]
    factors = [time_factors(each, speed, acceleration, jerk) for each in here]
    return np.asarray(np.max(factors, axis=0).reshape(len(spans), -1).max(axis=1))


def _with_dips(law: Law, factors: Array, width: float) -> Law:
    """The law slowed by factors of its spans (n - 1,), and less and less within a time before and after each [s]."""
    squares = law.squares
    speeds = np.sqrt(around(squares.values, law.controls))
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(squares.knots) / (speeds[1:] + speeds[:-1]))])
    clock = np.arange(0.0, times[-1] + 2.0 * DIP_STEP, DIP_STEP)
    wanted, depth = np.maximum(1.0 - 1.0 / (DIP_MORE * factors), 0.0) * (factors > MOST_SLOWED), np.zeros(len(clock))
    for at in (times[:-1] / DIP_STEP, times[1:] / DIP_STEP + 1.0):
        np.maximum.at(depth, at.astype(int), wanted)
    box = 2 * int(width / DIP_STEP / 3.0) + 1
    depth = maximum_filter1d(depth, 3 * box, mode="nearest")
    for _ in range(3):
        depth = uniform_filter1d(depth, box, mode="nearest")
    kept = 1.0 - np.interp(times, clock, depth)
    shares = control_values(squares, kept)
    shares[:2], shares[-2:] = kept[0], kept[-1]
    launch, landing = law.launch.slowed(1.0 / float(kept[0])), law.landing.slowed(1.0 / float(kept[-1]))
    return Law(squares, law.controls * shares**2, launch, landing)


# Where along a curve the law of time is solved for (knots of the curve -> knots of the law).

KNOT_TIME = 0.02
"""Most time between knots, short against that in which a limit's acceleration builds up; not where it is steady [s]."""
SETTLED = 0.3
"""After a stretch that is passed more slowly than wanted, and before one, the speed has settled: several times what
jerk limits take to build up an acceleration [s]."""
KNOTS_PER_SPAN = 4  #: Least number of knots of the law in a span between knots of the curve
LAUNCH_TIME = 0.005  #: Of constant jerk from rest, at most [s]
LAUNCH_SHARE = 0.9  #: Of the largest jerk from rest
BEFORE_LIMITS = 0.97  #: Of the speed at which a limit would be met, at the end of the launch
LAUNCH_GROWTH = 1.2
"""After it the time from rest grows by this factor from knot to knot, until knots are ``KNOT_TIME`` apart."""
SAME_KNOT = 2e-5  #: Knots nearer than this count as one [m]


def divided(knots: Array, parts: int) -> Array:
    """The knots and ``parts`` - 1 places in each of the spans between them [m], shape (spans * parts + 1,)."""
    shares = np.arange(parts) / parts
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
        time_factors(each, launch.speed * moved, launch.acceleration * moved, jerk * moved).max() for each in ends
    ) > BEFORE_LIMITS:  # fmt: skip
        launch = launch._replace(duration=0.7 * launch.duration)
    return launch


def with_feed_changes(coarse: Array, changes: Array) -> Array:
    """Knots (n,) with those where the wanted feed changes its course, unless there is one nearby already [m]."""
    right = np.clip(np.searchsorted(coarse, changes), 1, len(coarse) - 1)
    apart = np.minimum(np.abs(changes - coarse[right - 1]), np.abs(coarse[right] - changes))
    return np.union1d(coarse, changes[apart > SAME_KNOT])


def law_knots(coarse: Array, speeds: Array, caps: Array, launch: Launch) -> Array:
    """Knots from launch to landing, close together where the motion is slow and changes its speed.

    Args:
        coarse: First knots [m], from 0, shape (n,).
        speeds: Largest u' expected there [m/s], shape (n,).
        caps: Largest u' wanted there [m/s], shape (n,).
        launch: From rest.

    Returns:
        Knots [m], rising.
    """
    steps, length = np.diff(coarse), float(coarse[-1])
    parts = np.maximum(1, np.ceil(steps / (KNOT_TIME * np.maximum(speeds[1:], speeds[:-1])))).astype(int)
    parts[_steady(coarse, speeds, caps)] = 1
    counted = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    inner = np.repeat(coarse[:-1], parts) + counted * np.repeat(steps / parts, parts)
    last = max(KNOT_TIME / (LAUNCH_GROWTH - 1.0) / launch.duration, LAUNCH_GROWTH**2)
    times = launch.duration * LAUNCH_GROWTH ** np.arange(1 + int(np.log(last) / np.log(LAUNCH_GROWTH)))
    first = launch.jerk / 6.0 * times**3
    first = first[first < 0.3 * length]
    clear = 2.0 * first[-1] - first[-2]
    inner = inner[(inner > clear) & (inner < length - clear)]
    return np.concatenate([first, inner, length - first[::-1]])


def _steady(coarse: Array, speeds: Array, caps: Array) -> Bools:
    """Which spans (n - 1,) between knots are passed as fast as wanted, as are all within ``SETTLED`` of them."""
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(coarse) / (speeds[1:] + speeds[:-1]))])
    slow = times[speeds < (1.0 - 1e-9) * caps]
    inside = np.searchsorted(slow, times[:-1] - SETTLED), np.searchsorted(slow, times[1:] + SETTLED)
    return np.asarray(inside[0] == inside[1])
