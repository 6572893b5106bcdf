"""Pieces of the certified rule: connectors, bends, joint peaks, merged segments."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize

from polish_sim.motion.certified.connector import (
    CONNECTOR_PIECES,
    Ends,
    Peaks,
    connector_time,
    fill_connector,
    least_distance,
    least_peak,
)
from polish_sim.motion.certified.kernel import PIECES, Kernel, measure_peaks, runs_forwards, side_of
from polish_sim.motion.certified.line import (
    Law,
    Motion,
    fill_bend_kernel,
    fill_law,
    gone_at,
    law_at,
    time_at,
    turn_at,
)
from polish_sim.motion.certified.merge import Run, chord_deviation
from polish_sim.motion.certified.segment_limits import choose_limits, rest_to_rest, worst_share

PAPER = Peaks(0.05, 0.5, 10.0)


def _pieces(ends, distance, limits):
    durations, jerks = np.zeros(CONNECTOR_PIECES), np.zeros(CONNECTOR_PIECES)
    fill_connector(ends, distance, limits, durations, jerks)
    return durations, jerks


def _run(ends, durations, jerks):
    """Positions, speeds and accelerations at the pieces' ends."""
    x, v, a = 0.0, ends.v0, ends.a0
    rows = [(x, v, a)]
    for t, j in zip(durations, jerks, strict=True):
        x, v, a = x + v * t + a * t * t / 2 + j * t**3 / 6, v + a * t + j * t * t / 2, a + j * t
        rows.append((x, v, a))
    return np.array(rows)


def _random_ends(rng, limits):
    def side():
        a = limits.acceleration * rng.uniform() * rng.integers(0, 2)
        return rng.uniform() ** 3 * (limits.speed - a * a / limits.jerk / 2), a

    return Ends(*side(), *side())


@pytest.mark.parametrize(("distance", "time"), [(5e-5, 4 * math.cbrt(5e-5 / 20)), (0.05, 1.0 + 0.1 + 0.05)])
def test_rest_to_rest_takes_four_cube_roots_or_distance_over_speed_plus_both_ramps(distance, time):
    assert connector_time(Ends(0.0, 0.0, 0.0, 0.0), distance, PAPER) == pytest.approx(time, rel=1e-9)


def test_pieces_lead_from_one_end_to_the_other_within_the_limits():
    rng = np.random.default_rng(1)
    for _ in range(2000):
        limits = Peaks(*(10 ** rng.uniform(-2, 1, 3)))
        limits = limits._replace(acceleration=min(limits.acceleration, math.sqrt(2 * limits.speed * limits.jerk)))
        ends = _random_ends(rng, limits)
        shortest = least_distance(ends, limits)
        distance = shortest * (1 + 10 ** rng.uniform(-16, 3)) + rng.integers(0, 2) * 10 ** rng.uniform(-9, -1)
        durations, jerks = _pieces(ends, distance, limits)
        rows = _run(ends, durations, jerks)
        assert (durations >= 0).all()
        assert rows[-1] == pytest.approx(
            (distance, ends.v1, -ends.a1), rel=1e-9, abs=1e-9 * max(distance, limits.speed)
        )
        assert rows[:, 1].max() <= limits.speed * (1 + 1e-12)
        assert rows[:, 1].min() >= -1e-12
        assert np.abs(rows[:, 2]).max() <= limits.acceleration * (1 + 1e-12)
        assert durations.sum() == pytest.approx(connector_time(ends, distance, limits), rel=1e-9)


def test_a_distance_equal_to_the_least_one_is_feasible():
    rng = np.random.default_rng(2)
    for _ in range(2000):
        ends = _random_ends(rng, PAPER)
        assert math.isfinite(connector_time(ends, least_distance(ends, PAPER), PAPER))


def test_less_than_the_least_distance_is_refused():
    ends = Ends(0.04, 0.1, 0.0, 0.0)
    assert math.isinf(connector_time(ends, 0.999 * least_distance(ends, PAPER), PAPER))


def test_time_falls_as_the_peak_rises():
    """Brute force over the peak speed: none that covers the distance is faster."""
    rng = np.random.default_rng(3)
    for _ in range(100):
        ends = _random_ends(rng, PAPER)
        distance = least_distance(ends, PAPER) + 10 ** rng.uniform(-6, -1)
        best = connector_time(ends, distance, PAPER)
        for speed in np.linspace(least_peak(ends, PAPER), PAPER.speed, 20)[1:]:
            assert connector_time(ends, distance, PAPER._replace(speed=speed)) >= best * (1 - 1e-9)


def _law(speed=0.03, acceleration=0.2):
    law = Law()
    durations, jerks = np.zeros(7), np.zeros(7)
    durations[:4] = 0.05, 0.02, 0.05, 0.1
    jerks[:3] = 2.0, 0.0, -3.0
    fill_law(law, Motion(0.0, speed, acceleration, 0.0), durations, jerks)
    return law


def test_a_place_is_passed_when_the_law_says():
    law = _law()
    assert law_at(law, time_at(law, 4e-3)).way == pytest.approx(4e-3, rel=1e-12)


def test_a_bend_ends_with_the_law_s_way_speed_and_acceleration():
    law = _law()
    turning = turn_at(law, 4e-3, 1.5e-3, 1e-3, 1e-3)
    end = turning.begin + turning.duration
    line, gone = law_at(law, end), gone_at(turning, end)
    assert gone.way == pytest.approx(line.way - 4e-3, rel=1e-9)
    assert gone.speed == pytest.approx(line.speed, rel=1e-12)
    assert gone.acceleration == pytest.approx(line.acceleration, rel=1e-9)


def test_a_bend_keeps_to_its_room():
    law = _law()
    turning = turn_at(law, 4e-3, 1.5e-3, 0.7e-3, 0.7e-3)
    assert 4e-3 - law_at(law, turning.begin).way <= 0.7e-3
    assert law_at(law, turning.begin + turning.duration).way - 4e-3 <= 0.7e-3


def test_a_bend_s_load_is_the_largest_of_the_tip_s_motion():
    law, angle = _law(), 0.1
    turning = turn_at(law, 4e-3, 1.5e-3, 1e-3, 1e-3)
    kernel = Kernel()
    nearest = fill_bend_kernel(law, turning, 4e-3, kernel)
    load = measure_peaks(side_of(1.0, 1.0, math.cos(angle), Peaks(1.0, 1.0, 1.0), 1.0, False), kernel, PIECES)
    old, new = np.array([1.0, 0.0]), np.array([math.cos(angle), math.sin(angle)])
    peaks, off = np.zeros(2), 0.0
    for time in np.linspace(turning.begin, turning.begin + turning.duration, 3000)[1:-1]:
        line, gone = law_at(law, time), gone_at(turning, time)
        motion = (line.acceleration - gone.acceleration) * old + gone.acceleration * new
        off = max(off, min(gone.way, 4e-3 + gone.way - line.way))
        peaks = np.maximum(peaks, [np.hypot(*motion), np.hypot(*((line.jerk - gone.jerk) * old + gone.jerk * new))])
    assert load.acceleration == pytest.approx(peaks[0], rel=1e-3)
    assert load.jerk == pytest.approx(peaks[1], rel=1e-9)
    assert 0.95 * nearest < off <= nearest * (1.0 + 1e-9)
    assert runs_forwards(kernel)


class Case(NamedTuple):
    most: np.ndarray
    joint: np.ndarray
    tool: np.ndarray


def random_case(seed: int) -> Case:
    """Derivatives, joint limits and tool limits; the jerk limit over six decades, some joints standing still."""
    rng = np.random.default_rng(seed)
    most = np.exp(1.5 * rng.normal(size=(3, 6))) * np.array([1.0, 0.5, 0.5])[:, None]
    most[:, rng.random(6) < 0.1] = 0.0
    joint = np.array([3.0, 5.0, 10.0 ** rng.uniform(-4, 2)])[:, None] * np.exp(0.3 * rng.normal(size=(3, 6)))
    return Case(most, joint, np.exp(rng.normal(size=3)) * [3.0, 30.0, 600.0])


def left_over(x: np.ndarray, case: Case) -> np.ndarray:
    """Shares of all limits that are not used at (log V, log A, log J); the last: way left at full speed."""
    v, a, j = np.exp(x)
    q1, q2, q3 = case.most
    used = np.stack([q1 * v, q2 * v**2 + q1 * a, q3 * v**3 + 3.0 * q2 * v * a + q1 * j]) / case.joint
    return np.concatenate([np.log(case.tool) - x, 1.0 - used.ravel(), [1.0 - (v / a + a / j) * v]])


def least_time(case: Case, start: np.ndarray) -> float:
    """Least V, A, J give by sequential quadratic programming from two starts."""
    best = math.inf
    for factor in (0.9, 0.4):
        found = minimize(
            lambda x: np.log(np.exp(-x[0]) + np.exp(x[0] - x[1]) + np.exp(x[1] - x[2])),
            np.log(factor * start),
            constraints=[{"type": "ineq", "fun": left_over, "args": (case,)}],
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-13},
        )
        if left_over(found.x, case).min() > -1e-7:
            best = min(best, math.exp(found.fun))
    return best


def test_nothing_faster_is_found_by_an_independent_optimiser() -> None:
    found = 0
    for seed in range(40):
        case = random_case(seed)
        motion = case.tool.copy()
        assert choose_limits(case.most, 1.0, case.joint, 1.0, motion)
        assert worst_share(case.most, 1.0, motion, case.joint) <= 1.0
        assert (motion <= case.tool).all()
        best = least_time(case, motion)
        found += math.isfinite(best)
        assert rest_to_rest(1.0, *motion) <= best * (1.0 + 1e-5)
    assert found > 35


@pytest.mark.parametrize("jerk", [1e-6, 1e-2, 1e2])
def test_a_joint_that_goes_with_the_tool_takes_four_cube_roots(jerk: float) -> None:
    """q = 2 s over 0.3: jerk alone binds, 4 cbrt(L / 2 j) with L = 0.6."""
    most, motion = np.zeros((3, 6)), np.array([1e3, 1e4, 1e6])
    most[0, 2] = 2.0
    joint = np.array([1e3, 1e4, jerk])[:, None] * np.ones(6)
    assert choose_limits(most, 1.0, joint, 0.3, motion)
    assert rest_to_rest(0.3, *motion) == pytest.approx(4.0 * math.cbrt(0.6 / 2.0 / jerk), rel=1e-5)


def test_where_no_speed_is_slow_enough_nothing_is_chosen() -> None:
    motion = np.array([1.0, 10.0, 100.0])
    assert not choose_limits(np.full((3, 6), math.inf), 1.0, np.ones((3, 6)), 1.0, motion)
    assert motion == pytest.approx([1.0, 10.0, 100.0])


def _run_merge(tips, tilts):
    run = Run()
    for i, (tip, tilt) in enumerate(zip(tips, tilts, strict=True)):
        run.tips[i] = tip
        c, s = math.cos(tilt), math.sin(tilt)
        run.rotations[i] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    return run


def test_an_arc_lies_its_sagitta_off_the_chord():
    angles = np.linspace(-0.02, 0.02, 11)
    run = _run_merge(0.05 * np.column_stack([np.sin(angles), np.cos(angles), 0 * angles]), np.zeros(11))
    assert chord_deviation(run, 10)[0] == pytest.approx(0.05 * (1 - math.cos(0.02)), rel=1e-9)


def test_an_axis_that_turns_evenly_does_not_deviate():
    along = np.linspace(0.0, 1.0, 6)
    run = _run_merge(np.column_stack([along, 0 * along, 0 * along]) * 1e-3, 0.3 * along)
    assert chord_deviation(run, 5)[1] < 1e-12


def test_an_axis_ahead_of_the_tip_deviates_by_its_lead():
    run = _run_merge([[0, 0, 0], [0.5e-3, 0, 0], [1e-3, 0, 0]], [0.0, 0.06, 0.1])
    assert chord_deviation(run, 2)[1] == pytest.approx(0.01, rel=5e-3)


def test_a_way_point_behind_the_one_before_is_no_part_of_a_chord():
    run = _run_merge([[0, 0, 0], [0.6e-3, 0, 0], [0.5e-3, 0, 0], [1e-3, 0, 0]], np.zeros(4))
    assert math.isinf(chord_deviation(run, 3)[0])
