"""One path played by every rule: peaks, deviations, tracking."""

import numpy as np
import pytest

from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.motion.rules.chain import chain_from_axes
from polish_sim.motion.rules.fir import fir_schedule
from polish_sim.motion.rules.schedule import RULES, Smoothed
from polish_sim.scenario_file import override
from polish_sim.smoothing import CLAIMS
from polish_sim.smoothing.figures import find_peaks
from polish_sim.smoothing.smooth import LENGTH
from polish_sim.smoothing.tracking import PlayedRule, at_peaks, compare_tracking, jerk_peaks, measure_tracking


def test_every_rule_is_played_whole_its_servos_follow_and_only_spline_keeps_the_joint_limits():
    run = run_experiment(override(default_scenario("smooth"), ["robot.arm=ideal"]))
    figures = run.figures
    assert figures["rules"] == list(RULES)
    assert {claim.figure for claim in CLAIMS} <= set(figures)
    names, times, largest = [rule.replace("-", "_") for rule in RULES], {}, 0.0
    for k, name in enumerate(names):
        rows = np.asarray(run.log["rule"]) == k
        times[name] = figures[f"{name}_cycle_time_s"]
        assert run.log["time_s"][rows][0] == 0.0
        assert run.log["time_s"][rows][-1] == pytest.approx(times[name], abs=0.25)
        assert run.log["path_s_m"][rows][-1] == pytest.approx(LENGTH, abs=1e-5)
        ends = run.log["target_position_m"][rows]
        assert np.linalg.norm(ends[0] - ends[-1]) < 1e-6  # the trial's path is closed
        errors = np.array(figures[f"{name}_tracking_error_max_rad"])
        assert errors.shape == (6,)
        assert np.all((errors > 0.0) & (errors < 2e-4))
        largest = max(largest, errors.max())
    logged = np.abs(run.log["target_q_rad"] - run.log["q_rad"].astype(float)).max()
    assert logged == pytest.approx(largest, rel=0.05)
    slowest = max(times, key=lambda name: times[name])
    assert figures["equal_time_s"] == times[slowest]
    same = figures[f"{slowest}_tracking_error_max_rad_at_equal_time"]
    assert same == pytest.approx(figures[f"{slowest}_tracking_error_max_rad"], rel=1e-6)
    assert figures["spline_joint_jerk_ratio_max"] <= 1.0
    assert figures["spline_joint_acceleration_ratio_max"] <= 1.0
    assert figures["joint_acceleration_joint_jerk_ratio_max"] > 1.0


def corner(starts):
    """100 mm along x, then 100 mm along y, each a box of 2 s filtered by 0.5 and 0.1 s."""
    tips = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0]])
    chain = chain_from_axes(tips, np.tile([0.0, 0.0, -1.0], (3, 1)))
    return Smoothed(chain, fir_schedule(np.array(starts), np.tile([2.0, 0.5, 0.1], (2, 1))))


def test_a_filtered_box_has_the_peaks_of_its_closed_form():
    peaks = find_peaks(corner([0.0, 2.6]), None)
    assert peaks.values.shape == (3, 2)
    assert peaks.values[:, 0] == pytest.approx([0.05, 0.1, 1.0], rel=1e-6)
    assert peaks.values[:, 1] == pytest.approx([0.0, 0.0, 0.0])


@pytest.mark.parametrize(("overlap", "jerk"), [(0.1, np.sqrt(2.0)), (1e-15, 1.0), (1e-12, 1.0), (4e-11, 1.0)])
def test_jerks_add_where_segments_overlap_by_more_than_rounding(overlap, jerk):
    """For 0.1 s the last ramp of the old segment and the first one of the new, square to it, are one."""
    peaks = find_peaks(corner([0.0, 2.6 - overlap]), None)
    assert peaks.values[2, 0] == pytest.approx(jerk, rel=1e-9)
    assert overlap < 0.1 or 2.5 < peaks.times[2, 0] < 2.6


def played(rule, duration, heights, jerk=30.0):
    """100 mm at constant speed; a bump of error and jerk at the middle of the path for the joints named."""
    time = np.arange(0.0, duration, 0.001)
    place = 0.1 * time / duration
    bump = np.exp(-(((time - 0.5 * duration) / 0.01) ** 2))
    error, jerks = np.full((len(time), 6), 1e-6), np.zeros((len(time), 6))
    for joint, height in heights.items():
        error[:, joint] += height * bump
        jerks[:, joint] = jerk * bump
    return PlayedRule(rule, time, place, error, jerks)


def test_a_jerk_peak_is_found_once_where_the_limit_breaks_and_the_largest_reduction_names_its_joint():
    play = played("joint-acceleration", 4.0, {2: 1e-4})
    np.testing.assert_allclose(play.time[jerk_peaks(play, 2, 10.0)], [2.0], atol=0.002)
    calm = played("joint-acceleration", 4.0, {2: 1e-4}, jerk=8.0)
    assert len(jerk_peaks(calm, 2, 10.0)) == 1  # none breaks it: the largest counts
    reference = played("joint-acceleration", 4.0, {0: 1e-4, 3: 1e-4, 5: 1e-4})
    other = played("spline", 6.0, {0: 0.9e-4, 3: 0.2e-4, 5: 1.3e-4})  # at the same place, later
    limits = np.full(6, 10.0)
    places = [peak.place for peak in at_peaks(other, reference, limits)]
    assert places == pytest.approx([0.05] * 3, abs=1e-4)
    found = measure_tracking(reference)  # of the whole path
    assert found["tracking_error_max_rad"][3] == pytest.approx(1.01e-4, rel=1e-3)
    assert found["tracking_error_rms_rad"][1] == pytest.approx(1e-6)
    figures = compare_tracking(other, reference, limits)
    assert (figures["jerk_peaks"], figures["reduction_largest_joint"]) == (3, 4)
    shares = [figures[name] for name in ("reduction_largest", "reduction_median", "rise_largest")]
    assert [*shares, figures["reduction_max"][3]] == pytest.approx([0.79, 0.099, 0.297, 0.79], abs=0.01)
    assert figures["peaks_reduced"] == pytest.approx(2 / 3)


def test_on_the_real_arm_encoders_lag_by_the_servos_and_the_tool_by_the_gears_as_well():
    found = run_experiment(override(default_scenario("smooth"), ["robot.arm=ur5e"]))
    lag = found.scenario.robot.real.servo_lag_s
    log = found.log
    error = log["target_q_rad"] - log["encoder_q_rad"]
    assert np.abs(error - lag * log["target_qd_rad_s"]).max() < 0.3 * np.abs(error).max()
    hanging = np.abs(log["q_rad"] - log["encoder_q_rad"]).max(axis=0)
    assert 1e-3 < hanging[1] < 3e-3
    assert 2e-4 < found.trace.position_error_m.max() < 4e-3
