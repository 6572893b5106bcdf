"""The fastest law of time along a curve whose quantities keep their limits (Bounded -> u'^2).

The unknown is b = u'^2, a quadratic spline of u. Acceleration is linear in b and its slope, jerk u' times
something linear. The time is made least by a primal-dual interior point method on the squares of all norms,
their curvature taken from the linear parts (Gauss and Newton): every step solves one matrix of five
diagonals, so that the cost is proportional to the number of knots.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg.lapack import dpbsv

from polish_sim.arrays import Array, Bools, Indices, in_groups, midpoints, norms, running_sums, spans_at
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Vector, add_to, dot, kernel, plus, scaled, set_to
from polish_sim.motion.segment_rates import chebyshev_nodes
from polish_sim.motion.spline.bounded import (
    FIRST_PARTS,
    PARTS,
    SIZES,
    SLOWEST_TURN,
    Bounded,
    caps_of,
    part_norms,
    time_factors,
)
from polish_sim.motion.trajectory import slowed_before


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


class Law(NamedTuple):
    """b(u) between the launches."""

    spline: BSpline  #: Quadratic [m^2/s^2]
    launch: Launch  #: And, played backwards, the landing

    @property
    def knots(self) -> Array:
        """From the end of the launch to the start of the landing [m], shape (n,)."""
        return np.asarray(self.spline.t[2:-2])


# The programme: b has one control value more than knots. At a knot b and its slope depend on two of them, on
# a span between knots the second derivative, which is constant there, on three: values k, k + 1 and k + 2 for
# row k.

MOST_STEPS = 80
GAP = 1e-4  #: Share of the time that may be left to the least one when the steps end
KEPT = 1e-3  #: Of the squares of norms over their limits: what rows may be off then
ROWS = 26
"""Rows of every knot: eight quantities' acceleration, jerk at the begin and at the end of the span after it,
the cap, and what keeps the unknown positive."""
KINDS = 3
LEAST_SLACK = 0.1
FIRST_SHARE, FIRST_WEIGHT = 0.9, 0.05
"""Share of the expected law near which the steps begin; products of slacks and weights then, by the time."""
NEARNESS = 100.0  #: What being off that share counts at first, beside the squares of norms
LEAST_FIRST = 1e-6  #: Of the expected law
CENTRED = 0.4  #: Share of the mean product of slack and weight that a step aims at
TAKEN = 0.95  #: Share of a slack, weight or unknown that a step takes at most
KEEP = 1e30  #: Diagonal of an unknown that stays


class Programme(NamedTuple):
    """The programme of n + 1 control values over their sizes, and one more that counts for nothing."""

    spans: Array  #: [m], shape (n - 1,)
    forms: Array  #: Acceleration, jerk over u' at both ends over their limits, shape (n, 3, 12, 3)
    squares: Array  #: What jerk is times: b at both ends; of acceleration 0, shape (n, 3, 3)
    caps: Array  #: Control value k + 1, which b is never above on both spans beside, over its cap, shape (n,)
    fixed: Bools  #: Which unknowns stay 1, shape (n + 2,)


class LawRoom(NamedTuple):
    """Room for the rows of every knot, each of three unknowns from the knot's on, and for their sums."""

    value: Array  #: Shape (n, 26)
    rates: Array  #: Shape (3, n, 26)
    bands: Array  #: Curvature, its diagonal and the two beside it, shape (n + 2, 3)
    down: Array  #: Slope downwards, shape (n + 2,)


def plan_law(
    knots: Array, caps: Array, bounded: Bounded, launch: Launch, shares: Array, near: Law | None
) -> Law | None:
    """The fastest law.

    Args:
        knots: Of b, from the end of the launch to the start of the landing [m], shape (n,).
        caps: Largest u' wanted there [m/s], positive, shape (n,).
        bounded: At the knots.
        launch: How the motion begins; the landing is its mirror image.
        shares: Of the limits of acceleration and jerk that are planned with, shape (n,).
        near: A law that is nearly it, on any knots.

    Returns:
        The law; it keeps the limits at the knots. None where the method does not converge.
    """
    n = len(knots)
    expected = envelope(knots, caps, bounded, launch) ** 2 if near is None else near.spline(knots)
    # Control values near the squares at the knots.
    size = np.concatenate([expected[:1], midpoints(expected), expected[-1:]])
    caps = np.minimum(caps, caps_of(bounded)[0])
    fixed = np.zeros(n + 2, dtype=bool)
    for two, span in (([0, 1], knots[1] - knots[0]), ([-1, -2], knots[-1] - knots[-2])):
        # Value and slope where the launch hands over.
        size[two] = launch.speed**2 + np.array([0.0, launch.acceleration * span])
    fixed[[0, 1, n - 1, n, n + 1]] = True
    size = np.append(size, 1.0)
    programme = _programme(knots, caps, bounded, size, fixed, shares)
    unknowns = _solve(programme, np.where(fixed, 1.0, FIRST_SHARE))
    if unknowns is None:
        return None
    return Law(BSpline(np.pad(knots, 2, mode="edge"), (unknowns * size)[:-1], 2), launch)


def _programme(
    knots: Array, caps: Array, bounded: Bounded, size: Array, fixed: Bools, shares: Array
) -> Programme:
    """Arrange what `plan_law` is given."""
    n, spans = len(knots), np.diff(knots)
    before, after = np.append(0.0, spans), np.append(spans, 0.0)
    whole, none = before + after, np.zeros(n)
    # What b and its slope are at the knots, and those at the spans' ends, by the control values.
    values = np.stack([after / whole, before / whole, none], axis=1)
    slopes = np.stack([-2.0 / whole, 2.0 / whole, none], axis=1)
    end_values, end_slopes = np.roll(values[1:], 1, axis=1), np.roll(slopes[1:], 1, axis=1)
    half_bends = 0.5 * (end_slopes - slopes[:-1]) / spans[:, None]
    # How X1, X2 and X3 count.
    by = np.zeros((n, KINDS, 3, 3))
    by[:, 0, :2] = np.stack([0.5 * slopes, values], axis=1)
    by[:-1, 1] = np.stack([half_bends, 1.5 * slopes[:-1], values[:-1]], axis=1)
    by[:-1, 2] = np.stack([half_bends, 1.5 * end_slopes, end_values], axis=1)
    by *= np.lib.stride_tricks.sliding_window_view(size, 3)[:, None, None]
    rates = bounded.rates.transpose(1, 2, 0)
    limits = np.repeat(bounded.limits[1:], SIZES, axis=1)[:, :, None]
    jerk = limits[1] * np.minimum(shares[1:], shares[:-1])[:, None, None]
    forms = np.zeros((n, KINDS, PARTS, 3))
    forms[:, 0] = rates / (limits[0] * shares[:, None, None]) @ by[:, 0]
    forms[:-1, 1], forms[:-1, 2] = rates[:-1] / jerk @ by[:-1, 1], rates[1:] / jerk @ by[:-1, 2]
    return Programme(
        spans, forms, np.ascontiguousarray(by[:, :, 2]),
        size[1:-1] / np.minimum(caps, np.append(caps[1:], caps[-1])) ** 2, fixed,
    )  # fmt: skip


def _solve(programme: Programme, y: Array) -> Array | None:
    """Unknowns (n + 2,) of the least time, from near ``y``; None where the steps do not lead there."""
    n = len(programme.caps)
    none = np.zeros((n, ROWS))
    work = LawRoom(none.copy(), np.zeros((3, n, ROWS)), np.zeros((n + 2, 3)), np.zeros(n + 2))
    # Smooth at first: least squares of norms, b but for its derivatives as it is, and of what they change by.
    _sum_rows(programme, y, none + 1.0, none, none, work)
    own = np.where(programme.fixed, KEEP, NEARNESS)
    y = np.maximum(_solution(work, own, own * y), LEAST_FIRST * y)
    time = _sum_rows(programme, y, none, none, none, work)
    slack = np.maximum(1.0 - work.value, LEAST_SLACK)
    weight = FIRST_WEIGHT * time / n / slack
    own = np.where(programme.fixed, KEEP, 0.0)
    for _ in range(MOST_STEPS):
        total, stiff = (slack * weight).sum(), weight / slack
        target = CENTRED * total / slack.size
        time = _sum_rows(programme, y, weight, stiff, target / slack + stiff * (slack - 1.0), work)
        off = work.value + slack - 1.0
        worst = np.abs(off).max()
        if not math.isfinite(total + worst):
            return None
        if total < GAP * time and worst < KEPT:
            return y
        step = _solution(work, own, 0.0)
        slack_step = -off - sum(work.rates[i] * step[i : n + i, None] for i in range(3))
        weight_step = (target - weight * slack_step) / slack - weight
        taken = _share((slack_step / slack).min(), (step / y).min())
        y, slack = y + taken * step, slack + taken * slack_step
        weight = weight + _share((weight_step / weight).min()) * weight_step
    return None


def _share(*steps: float) -> float:
    """Largest share, up to 1, of steps, each over what it is added to, that leaves that positive enough."""
    return 1.0 / max(1.0, -min(steps) / TAKEN)


def _solution(work: LawRoom, own: Array, down: Array | float) -> Array:
    """The step (n + 2,) to where the slope is none, with more on the diagonal and in the slope downwards."""
    work.bands[:, 0] += own
    return np.asarray(dpbsv(work.bands.T, work.down + down, lower=True)[1])


@njit(_nrt=False)
def _sum_rows(
    programme: Programme, y: Array, weight: Array, stiff: Array, push: Array, work: LawRoom
) -> float:
    """Write rows and their rates, and the sums of slope and curvature of the time and of all rows, which
    count ``weight`` (n, 26) by their curvature, ``push`` and, by their value, ``stiff`` by their rates; the
    time."""
    time, H = 0.0, work.bands
    H[:], work.down[:] = 0.0, 0.0
    for k in range(programme.caps.shape[0]):
        near, value, rates = (y[k], y[k + 1], y[k + 2]), work.value[k], work.rates[:, k]
        for kind in range(KINDS):
            c = programme.squares[k, kind]
            b = dot(c, near) if kind > 0 else 1.0
            for q in range(8):
                row, size, slope = 8 * kind + q, 0.0, (0.0, 0.0, 0.0)
                for i in range(FIRST_PARTS[q], FIRST_PARTS[q] + SIZES[q]):
                    form = programme.forms[k, kind, i]
                    part = dot(form, near)
                    size, slope = size + part * part, plus(slope, scaled(part, form))
                    _add_square(H, k, 2.0 * b * weight[k, row], form)
                value[row] = b * size
                set_to(rates[:, row], plus(scaled(2.0 * b, slope), scaled(size, c)))
        value[ROWS - 2], value[ROWS - 1] = programme.caps[k] * y[k + 1], 1.0 - y[k + 1]
        rates[1, ROWS - 2], rates[1, ROWS - 1] = programme.caps[k], -1.0
        for row in range(ROWS):
            _add_square(H, k, stiff[k, row], rates[:, row])
            add_to(work.down[k:], scaled(-push[k, row] - stiff[k, row] * value[row], rates[:, row]))
        if k < len(programme.spans):
            time += _add_time(programme, work, near, k)
    return time


@kernel
def _add_square(H: Array, k: int, weight: float, rate: Vector) -> None:
    """Add to the curvature of unknowns k, k + 1 and k + 2 that of something's square, by its rates (3,)."""
    for i in range(3):
        for j in range(i + 1):
            H[k + j, i - j] += weight * rate[i] * rate[j]


@kernel
def _add_time(programme: Programme, work: LawRoom, near: Vector, k: int) -> float:
    """Time of span k, twice its way over the sum of both ends' speeds; add its slope and curvature, convex in
    b."""
    a, c = programme.squares[k, 1], programme.squares[k, 2]
    v, w = math.sqrt(dot(a, near)), math.sqrt(dot(c, near))
    time = 2.0 * programme.spans[k] / (v + w)
    first, last, m = 0.5 * time / (v + w) / v, 0.5 * time / (v + w) / w, 0.5 * time / (v + w) ** 2
    add_to(work.down[k:], plus(scaled(first, a), scaled(last, c)))
    both = m / (v * w)
    _add_square(work.bands, k, both, plus(a, c))
    _add_square(work.bands, k, (m + 0.5 * first) / (v * v) - both, a)
    _add_square(work.bands, k, (m + 0.5 * last) / (w * w) - both, c)
    return time


def envelope(u: Array, caps: Array, bounded: Bounded, launch: Launch) -> Array:
    """Speeds a motion without a limit of tangential jerk could have [m/s], shape (n,), positive."""
    speed = np.minimum(caps, caps_of(bounded)[1])
    speed[[0, -1]] = np.minimum(speed[[0, -1]], launch.speed)
    gain, way = 2.0 * bounded.limits[1, 0] / np.maximum(norms(bounded.rates[0, :, :3]), 1e-3), np.diff(u)
    risen = slowed_before(speed[::-1].copy(), (gain[1:] * way)[::-1].copy())
    return slowed_before(risen[::-1].copy(), gain[:-1] * way)


# Between the knots a law may be beyond a limit: it is planned again with less of it there.

LOOKS = 5  #: Places in every span of the law at which limits are looked at
MOST_SLOWED = 1.0003  #: A law that keeps its limits when it takes this much more time is slowed as a whole
MOST_TRIES = 5
MOST_HALVED = 2
HALVED = 1.01  #: A span that needs so much more time than the law gives it is divided
Look = Callable[[Array], tuple[Bounded, Array]]
TIGHTER = 3.3  #: Power of the time that is missing by which limits are planned lower: jerk goes by the third


def factors_of_spans(law: Law, bounded: Bounded) -> Array:
    """How much more time each span must take to keep the limits, both its ends looked at, shape (n - 1,).

    ``bounded`` is at the knots ``divided``.
    """
    spans, u = len(law.knots) - 1, divided(law.knots)
    places = (LOOKS * np.arange(spans)[:, None] + np.arange(LOOKS + 1)).ravel()
    square, slope = (law.spline(u, order)[places] for order in (0, 1))
    speed, bend = np.sqrt(square), np.repeat(law.spline(law.knots[:-1], 2), LOOKS + 1)
    here = bounded._replace(rates=bounded.rates.take(places, axis=1))
    return time_factors(here, speed, 0.5 * slope, 0.5 * speed * bend).reshape(spans, -1).max(axis=1)


def fastest_law(
    knots: Array, look: Look, launch: Launch, slower: Callable[[Law], Indices]
) -> tuple[Law, float] | Indices | None:
    """The fastest law that keeps its limits between its knots too, and how much more time it still needs for
    that, or the way points to stop at.

    Arguments as of `plan_law`; None where there is none. ``look`` gives what is bounded at places (n,) [m]
    and the largest u' wanted there. A law is not improved where ``slower`` finds way points to stop at.
    """
    shares, law, best = np.ones(len(knots)), None, None
    bounded, caps = look(divided(knots))
    for attempt in range(MOST_TRIES):
        at_knots = bounded._replace(rates=bounded.rates[:, ::LOOKS])
        law = plan_law(knots, caps[::LOOKS], at_knots, launch, shares, law)
        if law is None:
            break
        if len(stopped := slower(law)):
            return stopped
        factors = factors_of_spans(law, bounded)
        most = factors.max()
        if best is None or most < best[1]:
            best = law, most
        if not most > MOST_SLOWED:
            break
        far = (factors > HALVED) & (attempt < MOST_HALVED)
        factors[far] = 1.0
        beside = np.maximum(np.append(factors[0], factors), np.append(factors, factors[-1]))
        shares *= np.where(beside > 1.0, beside, 1.0) ** -TIGHTER
        if far.any():
            more = np.union1d(knots, midpoints(knots)[far])
            shares, knots = np.interp(more, knots, shares), more
            bounded, caps = look(divided(knots))
    return best


# Where along a curve the law of time is solved for (knots of the curve -> knots of the law).

KNOT_TIME = 0.02
"""Most time between knots, short against that in which a limit's acceleration builds up; not where it is
steady [s]."""
SETTLED = 0.3
"""After a stretch that is passed more slowly than wanted, and before one, the speed has settled: several
times what jerk limits take to build up an acceleration [s]."""
LAUNCH_PART = 0.3  #: Of the time in which the largest jerk passes the whole way that is launch, at most
LAUNCH_SPEED = 0.6  #: Of the speed wanted at the ends, which the launch reaches half of
LAUNCH_TIMES = 0.85 ** np.arange(40.0)[::-1]  #: Of the longest launch, which are tried
LAUNCH_SHARE = 0.98  #: Of the largest jerk from rest
BEFORE_LIMITS = 0.9999  #: Of the speed at which a limit would be met, in the launch
STILL_USED, SHORT_PART = 0.993, 0.1
"""The launch ends where its jerk uses less of the limits (as a time factor), not below this part of it."""
Ends = Callable[[Array], Bounded]
"""What is bounded so far from the start (m,) [m], and then so far from the end."""
LAUNCH_GROWTH = 1.12
"""After it the time from rest grows by this factor from knot to knot, until knots are ``KNOT_TIME`` apart."""
MUCH = 1.5  #: Ratio of what a quantity goes along u at both ends of a span from which the span is divided
BENT, BEND_SPAN = 0.1, 3e-4
"""Share of a limit a bend takes at the largest speed from which a span is divided, if it is longer than this
[m]."""
SAME_KNOT = 2e-5  #: Knots nearer than this count as one [m]


def divided(knots: Array) -> Array:
    """The knots and ``LOOKS`` - 1 places in each of the spans between them [m], shape (spans * LOOKS +
    1,)."""
    shares = chebyshev_nodes(LOOKS + 1)[:-1]
    return np.append((knots[:-1, None] + shares * np.diff(knots)[:, None]).ravel(), knots[-1])


def launch_of(length: float, slowest: float, still: Bounded, ends: Ends) -> Launch:
    """The launch of a motion over a length [m]: short beside the way, and until bends make themselves felt.

    After it the speed still rises by as much again while the acceleration fades: that may not pass
    ``slowest``, the smaller speed wanted at the ends [m/s].
    """
    jerk = float((still.limits[2] / np.maximum(part_norms(still.rates[0]), SLOWEST_TURN)).min())
    longest = min(LAUNCH_PART * math.cbrt(length / jerk), math.sqrt(LAUNCH_SPEED * slowest / jerk))
    jerk, times = LAUNCH_SHARE * jerk, longest * LAUNCH_TIMES
    speed, acceleration = np.tile(0.5 * jerk * times**2, 2), jerk * times
    moved = speed, np.concatenate([acceleration, -acceleration]), np.full(len(speed), jerk)
    factors = time_factors(ends(jerk * times**3 / 6.0), *moved).reshape(2, -1).max(axis=0)
    kept = int(np.count_nonzero(np.maximum.accumulate(factors) <= BEFORE_LIMITS))
    used = int(np.count_nonzero(np.minimum.accumulate(factors) >= STILL_USED))
    longest = times[max(kept - 1, 0)]
    return Launch(jerk, float(min(longest, max(times[max(used - 1, 0)], SHORT_PART * longest))))


def with_bends(knots: Array, bounded: Bounded, caps: Array) -> Array:
    """Knots (n,) with three between in spans where the rates of tip or axis change much, or bends limit the
    speed."""
    sizes = part_norms(bounded.rates)
    first, speed = sizes[0, :, :2], np.minimum(caps, caps_of(bounded)[1])[:, None]
    change = (np.maximum(first[1:], first[:-1]) > MUCH * np.minimum(first[1:], first[:-1])).any(axis=1)
    used = np.maximum(sizes[1] * speed**2 / bounded.limits[1], sizes[2] * speed**3 / bounded.limits[2]).max(
        axis=1
    )
    bent = (np.maximum(used[1:], used[:-1]) > BENT) & (np.diff(knots) > BEND_SPAN)
    which = change | bent
    return np.union1d(
        knots, knots[:-1][which, None] + np.diff(knots)[which, None] * np.array([0.25, 0.5, 0.75])
    )


def with_feed_changes(coarse: Array, changes: Array) -> Array:
    """Knots (n,) with those where the wanted feed changes its course, unless there is one nearby already
    [m]."""
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
    span, counted = in_groups(parts)
    inner = coarse[span] + counted * (steps / parts)[span]
    most = max(KNOT_TIME / (LAUNCH_GROWTH - 1.0) / launch.duration, LAUNCH_GROWTH**2)
    times = launch.duration * LAUNCH_GROWTH ** np.arange(1 + int(np.log(most) / np.log(LAUNCH_GROWTH)))
    ways = np.asarray(launch.jerk / 6.0 * times**3)
    first, last = _growing(ways, coarse), _growing(ways, length - coarse[::-1])
    inner = inner[(inner > 2.0 * first[-1] - first[-2]) & (length - inner > 2.0 * last[-1] - last[-2])]
    return np.concatenate([first, inner, length - last[::-1]])


def _growing(ways: Array, coarse: Array) -> Array:
    """The ways (m,) up to where they are as far apart as the knots (n,) from the same end, two at least."""
    spans = np.diff(coarse)[spans_at(coarse, ways[1:])]
    far = (np.diff(ways) > spans) | (ways[1:] > 0.3 * coarse[-1])
    return ways[: max(2, 1 + int(far.argmax()) if far.any() else len(ways))]


def _steady(coarse: Array, speeds: Array, caps: Array) -> Bools:
    """Which spans (n - 1,) between knots are passed as fast as wanted, as are all within ``SETTLED`` of
    them."""
    times = running_sums(2.0 * np.diff(coarse) / (speeds[1:] + speeds[:-1]))
    slow = times[speeds < (1.0 - 1e-9) * caps]
    inside = np.searchsorted(slow, times[:-1] - SETTLED), np.searchsorted(slow, times[1:] + SETTLED)
    return inside[0] == inside[1]
