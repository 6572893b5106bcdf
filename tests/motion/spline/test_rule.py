"""The rule `spline` on any path: never slower than stops, within every limit, as fast as known bounds
allow."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.exact_stop import plan_exact_stop
from benchmarks.random_paths import draw_path
from benchmarks.smoothing_check import AXIS_TOLERANCE, TOLERANCE, judge_motion
from polish_sim.motion.rules.chain import build_chain
from polish_sim.motion.rules.deviation import measure_deviation
from polish_sim.motion.rules.fir import stop_times
from polish_sim.motion.rules.limits import SmoothingLimits
from polish_sim.motion.spline.motion import smooth_by_spline
from polish_sim.smoothing.trial import TRIAL_LIMITS, trial_arm, trial_path
from tests.motion.spline.strokes import stroke

LIMITS = SmoothingLimits()


@pytest.mark.parametrize("number", [0, 3, 6, 9, 13])
def test_random_paths_keep_every_limit_and_take_no_longer_than_stops(number: int) -> None:
    path = draw_path(np.random.default_rng([500, number]), number)
    motion = smooth_by_spline(path.chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, path.arm)
    assert judge_motion(motion, path, LIMITS).max() <= 1.0 + 1e-6
    assert motion.end <= plan_exact_stop(path.chain, LIMITS, arm=path.arm).end * (1.0 + 1e-3)


def test_the_trial_is_within_two_percent_of_the_best_symmetric_corners() -> None:
    """12.998 s: corners by the convex programme of `benchmarks.corner_program`, tool only."""
    chain = build_chain(*trial_path())
    assert smooth_by_spline(chain, TRIAL_LIMITS, TOLERANCE, AXIS_TOLERANCE, None).end == pytest.approx(
        13.0, rel=0.02
    )
    with_arm = smooth_by_spline(chain, TRIAL_LIMITS, TOLERANCE, AXIS_TOLERANCE, trial_arm())
    assert with_arm.end <= 1.02 * 13.08


def test_without_a_tolerance_it_stops_at_every_point_in_the_least_time() -> None:
    chain, _ = stroke(np.array([[0.0, 0, 0], [0.03, 0, 0], [0.03, 0.002, 0], [0.01, 0.002, 0.01]]))
    motion = smooth_by_spline(chain, LIMITS, 0.0, 0.0, None)
    least = sum(sum(stop_times(length, 0.05, 0.5, 10.0)) for length in chain.lengths)
    assert motion.end == pytest.approx(least, rel=1e-3)
    np.testing.assert_allclose(motion.sample(motion.edges).tips[-1, 0], chain.tips[-1], atol=1e-12)


def test_a_path_that_turns_back_turns_within_two_tolerances_of_the_point() -> None:
    chain, _ = stroke(np.array([[0.0, 0, 0], [0.03, 0, 0], [0.0, 0, 0]]))
    motion = smooth_by_spline(chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, None)
    found = measure_deviation(motion, chain)
    assert found.contour.value < 1e-12
    assert found.vertex.value <= 2.0 * TOLERANCE
    stops = 2.0 * sum(stop_times(0.03, 0.05, 0.5, 10.0))
    assert 0.95 * stops < motion.end < stops


def test_a_feed_of_a_segment_holds_on_it() -> None:
    chain, _ = stroke(np.array([[0.0, 0, 0], [0.03, 0, 0], [0.06, 0.01, 0], [0.09, 0.01, 0]]))
    motion = smooth_by_spline(
        chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, None, np.array([math.inf, 0.01, math.inf])
    )
    seen = motion.sample(np.linspace(0.0, motion.end, 20001))
    speeds = np.linalg.norm(seen.tips[:, 1], axis=1)
    inside = (seen.tips[:, 0, 0] > 0.031) & (seen.tips[:, 0, 0] < 0.059)
    assert speeds[inside].max() <= 0.01 * 1.002
    assert speeds.max() > 0.045
