"""The rule ``certified`` on paths with known truths."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.exact_stop import plan_exact_stop
from benchmarks.random_paths import draw_path
from benchmarks.smoothing_rules import random_path
from polish_sim.motion.certified.segment_limits import FINE
from polish_sim.motion.certified.smoother import Smoother, join_pieces
from polish_sim.motion.certified.smoother import plan_certified as plan
from polish_sim.motion.rules.chain import build_chain, chain_from_axes
from polish_sim.motion.rules.deviation import measure_deviation
from polish_sim.motion.rules.limits import SmoothingLimits, six
from polish_sim.motion.rules.schedule import sample_schedule
from polish_sim.smoothing.trial import TRIAL_LIMITS, trial_arm, trial_path

LIMITS = SmoothingLimits()
TOLERANCE, AXIS_TOLERANCE = 2e-5, math.radians(0.02)


def _flat(points):
    points = np.asarray(points, dtype=float)
    return chain_from_axes(points, np.tile([0.0, 0.0, -1.0], (len(points), 1)))


def _random_chain(rng, count=200):
    steps = rng.normal(size=(count, 3))
    steps *= 10 ** rng.uniform(-4.7, -1.3, (count, 1)) / np.linalg.norm(steps, axis=1)[:, None]
    axes = np.array([0.0, 0.0, -1.0]) + np.cumsum(rng.normal(size=(count + 1, 3)) * 0.01, axis=0)
    return chain_from_axes(np.cumsum(np.vstack([np.zeros(3), steps]), axis=0), axes)


def _zigzag(count=60, step=5e-5):
    x = np.arange(count + 1) * step / math.sqrt(2)
    return _flat(np.column_stack([x, np.resize([0.0, step / math.sqrt(2)], count + 1), np.zeros(count + 1)]))


def test_one_short_segment_takes_four_cube_roots():
    _, schedule = plan(_flat([[0, 0, 0], [5e-5, 0, 0]]), LIMITS, TOLERANCE, AXIS_TOLERANCE, None)
    assert schedule.end == pytest.approx(4 * math.cbrt(5e-5 / 20), rel=1e-9)


def test_a_straight_line_in_many_parts_takes_no_longer_than_in_one():
    whole = plan(_flat([[0, 0, 0], [0.1, 0, 0]]), LIMITS, TOLERANCE, AXIS_TOLERANCE, None)[1].end
    parts = np.column_stack([np.linspace(0, 0.1, 301), np.zeros((301, 2))])
    assert plan(_flat(parts), LIMITS, TOLERANCE, AXIS_TOLERANCE, None)[1].end <= 1.02 * whole


def test_a_fine_zigzag_is_not_slower_than_exact_stops():
    _, schedule = plan(_zigzag(), LIMITS, TOLERANCE, AXIS_TOLERANCE, None)
    assert schedule.end <= 0.9 * 60 * 4 * math.cbrt(5e-5 / 20)


def test_tolerance_zero_stops_at_every_way_point():
    chain = _random_chain(np.random.default_rng(4), 30)
    _, schedule = plan(chain, LIMITS, 0.0, 0.0, None)
    stops = [plan(chain_from_axes(chain.tips[k : k + 2], chain.axes[k : k + 2]), LIMITS, 0, 0, None)[1].end
             for k in range(30)]  # fmt: skip
    assert schedule.end == pytest.approx(sum(stops), rel=1e-6)


def test_random_paths_are_never_slower_than_exact_stops():
    rng = np.random.default_rng(5)
    for _ in range(5):
        chain = _random_chain(rng)
        stops = plan(chain, LIMITS, 0.0, 0.0, None)[1].end
        assert plan(chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, None)[1].end <= stops * (1 + 1e-9)


@pytest.mark.parametrize("speedup", [3.0, 10.0])
def test_fast_paths_of_an_arm_are_never_slower_than_exact_stops(speedup):
    names = ("tip_speed", "tip_acceleration", "tip_jerk", "axis_speed", "axis_acceleration", "axis_jerk")
    fast = replace(
        LIMITS, joint_acceleration=six(3.0), joint_jerk=six(60.0), **{n: speedup * getattr(LIMITS, n) for n in names}
    )
    arm, saved = trial_arm(), []
    for number in range(6):
        chain = random_path(np.random.default_rng([4, number]))
        stops = plan_exact_stop(chain, fast, arm=arm)[1].end
        saved.append(1.0 - plan(chain, fast, TOLERANCE, AXIS_TOLERANCE, arm)[1].end / stops)
    assert min(saved) > 0.0
    assert np.mean(saved) > (0.04 if speedup == 3.0 else 0.02)


def test_a_low_joint_jerk_costs_no_more_time_than_it_must():
    """A motion for a jerk limit, slowed by the cube root of their ratio, keeps a lower one: T cbrt(J) may not rise."""
    arm, chain, scaled = trial_arm(), build_chain(*trial_path()), []
    for jerk in np.radians([1000.0, 300.0, 100.0, 10.0, 0.01]):
        limits = replace(TRIAL_LIMITS, joint_jerk=six(jerk))
        stops = plan_exact_stop(chain, limits, arm=arm)[1].end
        end = plan(chain, limits, TOLERANCE, AXIS_TOLERANCE, arm)[1].end
        assert end < stops
        scaled.append(end * math.cbrt(jerk))
    assert (np.diff(scaled) <= 1e-3 * scaled[-1]).all()


def test_next_to_singularities_the_arm_is_not_slower_than_with_exact_stops():
    """Proven stops at any rate; those planned from nodes of each segment know its peaks better than can be proven."""
    for number in (6, 7, 14, 15, 30, 31, 54, 55):
        path = draw_path(np.random.default_rng([0, number]), number)
        stops = plan_exact_stop(path.chain, LIMITS, arm=path.arm)[1].end
        end = plan(path.chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, path.arm)[1].end
        assert end <= plan(path.chain, LIMITS, 0.0, 0.0, path.arm)[1].end
        assert end <= stops * (1.0 + FINE[0])


def test_the_arm_takes_hardly_longer_than_the_tool_alone_on_the_trial_path():
    """Least time for the tool: 12.998 s (benchmarks.corner_bound); 5% more are asked, exact stops take 10% more."""
    chain = build_chain(*trial_path())
    merged, schedule = plan(chain, TRIAL_LIMITS, TOLERANCE, AXIS_TOLERANCE, trial_arm())
    assert schedule.end <= 1.01 * 12.998
    assert measure_deviation(merged, schedule, chain).contour.value <= TOLERANCE * (1.0 + 1e-9)


def test_the_tip_keeps_its_limits_and_arrives():
    chain = _random_chain(np.random.default_rng(6))
    merged, schedule = plan(chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, None)
    samples = sample_schedule(merged, schedule, np.linspace(0, schedule.end, 20000))
    peaks = np.linalg.norm(samples.tips, axis=2).max(axis=0)
    assert peaks[1] <= LIMITS.tip_speed * (1 + 1e-9)
    assert peaks[2] <= LIMITS.tip_acceleration * (1 + 1e-9)
    assert peaks[3] <= LIMITS.tip_jerk * (1 + 1e-9)
    np.testing.assert_allclose(samples.tips[-1, 0], chain.tips[-1], atol=1e-12)


def test_the_output_does_not_depend_on_how_the_input_is_cut():
    chain = _random_chain(np.random.default_rng(7), 700)
    whole = plan(chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, None)[1]
    for size in (1, 7, 128, 129):
        smoother = Smoother(LIMITS, TOLERANCE, AXIS_TOLERANCE)
        pieces = [smoother.feed(chain.tips[i : i + size], chain.rotations[i : i + size])
                  for i in range(0, len(chain.tips), size)]  # fmt: skip
        cut = join_pieces([*pieces, smoother.finish()])
        assert cut.coefficients.tobytes() == whole.coefficients.tobytes()
        assert cut.starts.tobytes() == whole.starts.tobytes()


def test_a_feed_caps_the_speed_of_its_segments():
    chain = _flat([[0, 0, 0], [0.02, 0, 0], [0.04, 0, 0]])
    merged, schedule = plan(chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, None, np.array([0.01, 0.03]))
    assert len(merged.lengths) == 2
    samples = sample_schedule(merged, schedule, np.linspace(0, schedule.end, 5000))
    speeds = np.linalg.norm(samples.tips[:, 1], axis=1)
    assert speeds[samples.tips[:, 0, 0] < 0.02].max() <= 0.01 * (1 + 1e-9)
    assert speeds.max() == pytest.approx(0.03)


def test_a_quarter_circle_in_short_chords_takes_little_longer_than_its_length_at_full_speed():
    angle = np.linspace(0.0, math.pi / 2, 362)
    arc = 0.05 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    chain = _flat(arc)
    merged, schedule = plan(chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, None)
    assert schedule.end <= 1.15 * 1.72
    assert measure_deviation(merged, schedule, chain).contour.value <= TOLERANCE


@pytest.mark.parametrize("number", [5242, 6314])
def test_a_bend_that_would_bulge_while_the_tool_brakes_is_laid_shorter(number):
    chain = draw_path(np.random.default_rng([0, number]), number).chain
    passed, schedule = plan(chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, None)
    assert np.isfinite(schedule.starts).all()
    assert measure_deviation(passed, schedule, chain).contour.value <= TOLERANCE * (1 + 1e-9)
    assert schedule.end < plan_exact_stop(chain, LIMITS).schedule.end
