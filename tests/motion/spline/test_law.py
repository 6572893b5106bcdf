"""The law of time: as fast as closed forms say, never faster, and within every limit between its knots
too."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.fir import stop_times
from polish_sim.motion.rules.limits import SmoothingLimits
from polish_sim.motion.spline import law as law_module
from polish_sim.motion.spline.motion import Feed, SplineMotion, passage_at, plan_spline
from polish_sim.motion.timed_path import TimedPath, time_schedule
from tests.motion.spline.strokes import LIMITS, TOLERANCES, circle, random_stroke, stroke


def plan(chain: Chain, places: np.ndarray, feed: float, limits: SmoothingLimits = LIMITS) -> SplineMotion:
    return plan_spline(chain, places, Feed(places, np.full(len(places), feed)), limits, TOLERANCES, None)


def timed(motion: SplineMotion) -> TimedPath:
    return time_schedule(motion, motion.line.places)


@pytest.mark.parametrize("length", [1e-4, 1e-2, 0.1])
def test_from_rest_to_rest_on_a_line_takes_hardly_longer_than_the_least_time(length: float) -> None:
    least = sum(stop_times(length, 0.06, 0.6, 15.0))
    time = plan(*stroke(np.array([[0.0, 0, 0], [length, 0, 0]])), 0.06).passage.duration
    assert least <= time <= 1.15 * least + 0.01


def test_a_circle_is_followed_at_the_speed_its_acceleration_allows() -> None:
    radius = 0.025
    motion = timed(plan(*stroke(circle(radius, 3.0)), 1.0, replace(LIMITS, tip_jerk=1e3)))
    middle = motion.speeds[len(motion.speeds) // 3 : 2 * len(motion.speeds) // 3]
    best = math.sqrt(0.6 * radius)
    assert np.all(middle <= best * 1.003)  # the curve cuts chords' corners: its radius is that much larger
    assert np.mean(middle) >= 0.97 * best


def test_the_passage_is_smooth_and_its_derivatives_are_its_own() -> None:
    passage = plan(*random_stroke(np.random.default_rng(1)), 0.06).passage
    times = np.linspace(1e-5, passage.duration - 1e-5, 40001)
    u, v, a, j = passage_at(passage, times)
    h = times[1] - times[0]
    np.testing.assert_allclose(np.diff(u) / h, 0.5 * (v[1:] + v[:-1]), atol=1e-6)
    np.testing.assert_allclose(np.diff(v) / h, 0.5 * (a[1:] + a[:-1]), atol=2.0 * h * np.abs(j).max())
    assert np.abs(np.diff(a)).max() <= 2.0 * h * np.abs(j).max()  # the acceleration does not jump
    ends = passage_at(passage, np.array([0.0, passage.duration]))
    np.testing.assert_allclose(ends[1:3], 0.0, atol=1e-12)
    assert v.min() >= 0.0


def test_a_jagged_stroke_is_timed_in_steps_that_hardly_grow_with_its_length(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Counted in knots of the programmes that were solved: the processor's clock is not asked."""
    solved: list[int] = []
    plan_law = law_module.plan_law
    monkeypatch.setattr(
        law_module, "plan_law", lambda knots, *rest: solved.append(len(knots)) or plan_law(knots, *rest)
    )
    rng, work = np.random.default_rng(5), []
    steps = 0.002 * np.stack([np.ones(800), *0.15 * rng.normal(size=(2, 800))], axis=1)
    for count in (200, 800):
        solved.clear()
        plan(*stroke(np.cumsum(steps[:count], axis=0), 0.02 * rng.normal(size=(count, 3))), 0.03)
        work.append(sum(solved))
    assert work[1] <= 6.0 * work[0]


def test_a_feed_that_changes_along_the_path_is_kept_and_slowed_for_in_time() -> None:
    chain, places = stroke(np.outer(np.linspace(0.0, 0.2, 401), [1.0, 0, 0]))
    feed = Feed(places, np.where((places > 0.08) & (places < 0.12), 0.01, 0.05))
    motion = timed(plan_spline(chain, places, feed, LIMITS, TOLERANCES, None))
    assert np.all(motion.speeds <= np.interp(motion.places, *feed) * (1.0 + 1e-3) + 1e-5)
    slow = (motion.places > 0.085) & (motion.places < 0.115)
    np.testing.assert_allclose(motion.speeds[slow], 0.01, rtol=1e-3)
    fast = (motion.places > 0.02) & (motion.places < 0.07)
    np.testing.assert_allclose(motion.speeds[fast], 0.05, rtol=1e-3)
