"""The circle in free space: the paper's experiment, a few seconds of it."""

import numpy as np
import pytest

from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.experiments.free_space import arc_path
from polish_sim.scenario_file import override

CENTER, RADIUS, NORMAL = np.array([0.0, -0.52, 0.0]), 0.1, np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)


def test_the_path_is_the_papers_circle_once_round_and_a_part_of_it_so_much_and_touches_nothing():
    path = arc_path()
    offset = path.positions_work - CENTER
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), RADIUS, atol=1e-12)
    np.testing.assert_allclose(offset @ NORMAL, 0.0, atol=1e-12)
    np.testing.assert_allclose(path.positions_work[0], path.positions_work[-1], atol=1e-12)
    assert path.length_m == pytest.approx(2.0 * np.pi * RADIUS, rel=1e-5)
    short_arc = run_experiment(override(default_scenario("arc"), ["process.max_feed_s=4"]))
    length = 2.0 * np.pi * RADIUS
    ramps = 0.12 + 0.045  # up to the feed, and down again before its time is over [s]
    assert short_arc.figures["path_done"] == pytest.approx((4.0 - ramps) * 0.01 / length, rel=0.002)
    assert short_arc.figures["T_base_work"] is None
    assert short_arc.figures["protective_stop"] is None
    np.testing.assert_array_equal(short_arc.trace.normal_force_n, 0.0)
    assert 1 not in short_arc.trace.phase


def test_the_ideal_arm_keeps_to_the_circle_and_to_10_mm_per_second_and_so_do_other_laws_and_feeds():
    ideal = override(default_scenario("arc"), ["robot.arm=ideal", "process.max_feed_s=4"])
    figures = run_experiment(ideal).figures
    assert figures["tracking_error_max_m"] < 0.1e-3
    assert figures["speed_mean_m_s"] == pytest.approx(0.01, abs=0.1e-3)
    assert figures["speed_max_deviation_m_s"] < 0.1e-3
    assert figures["orientation_error_max_rad"] < 1e-3
    for change, feed in (("controller.name=position", 0.01), ("process.feed_m_s=0.1", 0.1)):
        real = override(default_scenario("arc"), ["process.max_feed_s=3.5", change])
        figures = run_experiment(real).figures
        assert figures["tracking_error_max_m"] < 0.3e-3
        assert figures["speed_mean_m_s"] == pytest.approx(feed, rel=0.01)
