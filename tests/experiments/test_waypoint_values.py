"""Force and feed that change along the path: held where the path says so."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from polish_sim.config import Scenario
from polish_sim.errors import PlanError, place_in_mm
from polish_sim.experiments import RunResult, prepare_surface, run_experiment
from polish_sim.planning import PlanResult
from polish_sim.scenario_file import override

Cap = tuple[Scenario, PlanResult]
RISE_M = 0.06  #: Force and feed change over this length of the path [m]
FORCES, FEEDS = (12.0, 24.0), (0.006, 0.018)


@pytest.fixture(scope="module")
def rising(cap: Cap) -> RunResult:
    """Force from 12 to 24 N and feed from 6 to 18 mm/s over the first 60 mm, then both constant."""
    scenario, plan = cap
    s = plan.path.s
    start = float(s[plan.path.process][0])
    force, feed = (np.interp(s, [start, start + RISE_M], values) for values in (FORCES, FEEDS))
    path = replace(plan.path, force=force, feed=feed)
    longer = override(scenario, ["robot.arm=ideal", "process.max_feed_s=7"])
    return run_experiment(longer, replace(plan, path=path))


def fed(run: RunResult, after_s: float = 1.0) -> np.ndarray:
    feeding = run.trace.phase == 2
    return feeding & (run.trace.time_s > run.trace.time_s[feeding][0] + after_s)


def test_the_force_follows_the_path_s(rising: RunResult) -> None:
    rows = fed(rising)
    wanted = np.interp(rising.trace.path_s_m[rows], rising.path.s, rising.path.force)
    assert np.ptp(wanted) > 9.0
    assert np.abs(rising.trace.normal_force_n[rows] - wanted).max() < 2.0
    assert abs(np.mean(rising.trace.normal_force_n[rows] - wanted)) < 0.3
    # Its error is measured against the local set point.
    assert rising.figures["force_rms_error_n"] < 1.0
    assert rising.figures["force_max_deviation_n"] < 4.0


def test_the_feed_follows_the_path_s(rising: RunResult) -> None:
    rows = fed(rising)
    place, time = rising.trace.path_s_m[rows], rising.trace.time_s[rows]
    speed = np.gradient(place, time)
    fed_at_all = time < time[-1] - 0.15  # the target comes to rest before its time is over
    place, speed = place[fed_at_all], speed[fed_at_all]
    assert speed == pytest.approx(np.interp(place, rising.path.s, rising.path.feed), rel=0.02)


def test_the_target_is_pressed_in_by_the_local_force_over_the_stiffness(rising: RunResult) -> None:
    rows = rising.log["phase"] == 2
    along = np.asarray(rising.log["path_s_m"][rows], dtype=float)
    T_base_work = np.array(rising.figures["T_base_work"])
    axes, points = rising.path.axes_work, rising.path.positions_work
    depth = rising.path.force / 5000.0
    nominal = (points - depth[:, None] * axes) @ T_base_work[:3, :3].T + T_base_work[:3, 3]
    expected = np.stack([np.interp(along, rising.path.s, nominal[:, i]) for i in range(3)], axis=1)
    targets = rising.log["target_position_m"][rows]
    assert np.linalg.norm(targets - expected, axis=1).max() < 5e-5


def test_values_that_are_the_scenario_s_own_change_nothing(cap: Cap) -> None:
    scenario, plan = cap
    scenario = override(scenario, ["process.max_feed_s=0.5"])
    process, ones = scenario.process, np.ones(len(plan.path.s))
    force, feed = process.contact_force_n * ones, process.feed_m_s * ones
    plain = run_experiment(scenario, plan)
    named = run_experiment(scenario, replace(plan, path=replace(plan.path, force=force, feed=feed)))
    for name in plain.log.names:
        np.testing.assert_array_equal(plain.log[name], named.log[name])


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("force", 900.0, r"force of 900 N: .* 0\.5 to 200 N"),
        ("force", np.nan, "force of nan N"),
        ("feed", 0.0, r"feed of 0 m/s: .* 0\.0001 to 0\.5 m/s"),
    ],
)
def test_values_no_robot_should_follow_are_refused_with_their_place(
    cap: Cap, column: str, value: float, said: str
) -> None:
    scenario, plan = cap
    values = np.full(len(plan.path.s), 0.01 if column == "feed" else 20.0)
    row = int(np.flatnonzero(plan.path.process)[7])
    values[row] = value
    path = replace(plan.path, **{column: values})
    place = re.escape(place_in_mm(path.positions_work[row]))
    with pytest.raises(PlanError, match=f"at {place} .*{said}"):
        prepare_surface(scenario, replace(plan, path=path))
