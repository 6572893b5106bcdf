"""The main job, its first seconds: a part polished along a planned path, whose force and feed may change."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from polish_sim.analysis.run_record import RunRecord, read_record, write_record
from polish_sim.errors import InputError, PlanError, place_in_mm
from polish_sim.experiments import default_scenario, prepare_surface, run_experiment
from polish_sim.experiments.assembly import check_settings
from polish_sim.experiments.even_removal import planned
from polish_sim.planning import plan_part
from polish_sim.scenario_file import override
from polish_sim.spatial import apply


def test_on_the_freeform_part_the_force_stays_where_the_part_stood_and_removal_is_mapped(freeform):
    assert freeform.stop_reason is None
    assert freeform.figures["force_max_deviation_n"] < 4.0
    assert freeform.figures["force_mean_n"] == pytest.approx(20.0, abs=0.3)
    assert freeform.figures["contact_lost_s"] == 0.0
    # Eight seconds at 10 mm/s, less the ramps.
    contact = np.ptp(freeform.path.s[freeform.path.process])
    assert freeform.figures["path_done"] * contact == pytest.approx(0.079, abs=0.001)
    # The tool's axis is the planned one but for the moment loop.
    tilt = freeform.trace.orientation_error_rad[freeform.trace.fed].max()
    assert tilt < freeform.scenario.controller.moment_tilt_limit_rad + 0.005
    # No loop makes the elastic arm swing: with both filters at 10 Hz the force loop feeds the mode at 26 Hz,
    # 53 um rms instead of 6.
    feeding = freeform.log.fed
    off = (freeform.log["tcp_position_m"][feeding] - freeform.log["target_position_m"][feeding])[250:]
    band = butter(4, [8.0, 60.0], "band", fs=250.0, output="sos")
    assert np.sqrt((sosfiltfilt(band, off, axis=0) ** 2).sum(axis=1).mean()) < 12e-6
    T_base_work = np.array(freeform.figures["T_base_work"])
    pressing = freeform.log["normal_force_n"] > 5.0
    tool = apply(np.linalg.inv(T_base_work), freeform.log["tcp_position_m"][pressing])
    prepared = prepare_surface(*planned(freeform.scenario))
    np.testing.assert_allclose(prepared.reach.T_base_work, T_base_work, atol=1e-12)
    assert np.linalg.norm(tool - prepared.surface.closest(tool).positions, axis=1).max() < 0.006
    removal, running = freeform.removal, np.asarray(freeform.log["exposure_nm"])
    assert (np.diff(running) >= 0.0).all()
    assert running[-1] == pytest.approx(removal.areas @ removal.exposure + removal.elsewhere_nm, rel=1e-6)
    assert freeform.figures["removal_unplaced"] < 0.01
    # The first seconds run along the part's edge, where the contact's springs fade out and the map's stay.
    assert freeform.figures["pressure_field_ratio"] == pytest.approx(1.0, abs=0.1)
    # A disc pressed flat slides at two thirds of its rim's speed on average, one on an edge near that.
    rim = 628.3 * freeform.scenario.pad.radius_m
    assert 0.3 < running[-1] / (freeform.trace.normal_force_n.sum() * 1e-3 * rim) < 0.9


def test_with_the_spindle_off_the_force_is_held_as_well(cap):
    """On the ideal arm, whose tool strays by less than 0.3 mm."""
    force, moment = {}, {}
    for name, change in (("on", "seed=0"), ("off", "spindle.speed_rpm=0")):
        result = run_experiment(override(cap[0], ["robot.arm=ideal", change]), cap[1])
        assert result.figures["force_max_deviation_n"] < 4.0
        assert result.figures["tracking_error_max_m"] < 0.3e-3
        fed = result.log.fed
        wrench = np.asarray(result.log["wrench_true_tool"][fed][100:], dtype=float).mean(axis=0)
        force[name], moment[name] = np.linalg.norm(wrench[:2]), wrench[5]
    # Sliding with the feed alone friction opposes it with mu F; spinning, points slide mostly round.
    assert force["off"] == pytest.approx(0.3 * 20.0, rel=0.1)
    assert force["on"] < 0.7 * force["off"]
    # The spindle turns about tool z and drags the part along, by no more than mu F a.
    assert 0.01 < moment["on"] - moment["off"] < 0.3 * 20.0 * 0.025


def test_force_and_feed_follow_the_path_s_and_the_target_is_pressed_in_by_the_local_force(cap):
    """From 12 to 24 N and from 6 to 18 mm/s over the first 60 mm, then both constant."""
    scenario, plan = cap
    s, start = plan.path.s, float(plan.path.s[plan.path.process][0])
    force, feed = (np.interp(s, [start, start + 0.06], ends) for ends in ((12.0, 24.0), (0.006, 0.018)))
    longer = override(scenario, ["robot.arm=ideal", "process.max_feed_s=7"])
    rising = run_experiment(longer, replace(plan, path=replace(plan.path, force=force, feed=feed)))
    feeding, time = rising.trace.fed, rising.trace.time_s
    rows = feeding & (time > time[feeding][0] + 1.0)
    wanted = np.interp(rising.trace.path_s_m[rows], rising.path.s, rising.path.force)
    assert np.ptp(wanted) > 9.0
    assert np.abs(rising.trace.normal_force_n[rows] - wanted).max() < 2.0
    assert abs(np.mean(rising.trace.normal_force_n[rows] - wanted)) < 0.3
    assert rising.figures["force_rms_error_n"] < 1.0
    assert rising.figures["force_max_deviation_n"] < 4.0
    place, time = rising.trace.path_s_m[rows], rising.trace.time_s[rows]
    speed = np.gradient(place, time)
    fed_at_all = time < time[-1] - 0.15  # the target comes to rest before its time is over
    place, speed = place[fed_at_all], speed[fed_at_all]
    assert speed == pytest.approx(np.interp(place, rising.path.s, rising.path.feed), rel=0.02)
    rows = rising.log.fed
    along = np.asarray(rising.log["path_s_m"][rows], dtype=float)
    T_base_work = np.array(rising.figures["T_base_work"])
    axes, points = rising.path.axes_work, rising.path.positions_work
    depth = rising.path.force / 5000.0
    nominal = (points - depth[:, None] * axes) @ T_base_work[:3, :3].T + T_base_work[:3, 3]
    expected = np.stack([np.interp(along, rising.path.s, nominal[:, i]) for i in range(3)], axis=1)
    targets = rising.log["target_position_m"][rows]
    assert np.linalg.norm(targets - expected, axis=1).max() < 5e-5


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("force", 900.0, r"force of 900 N: .* 0\.5 to 200 N"),
        ("force", np.nan, "force of nan N"),
        ("feed", 0.0, r"feed of 0 m/s: .* 0\.0001 to 0\.5 m/s"),
    ],
)
def test_values_no_robot_should_follow_are_refused_with_their_place(cap, column, value, said):
    scenario, plan = cap
    values = np.full(len(plan.path.s), 0.01 if column == "feed" else 20.0)
    row = int(np.flatnonzero(plan.path.process)[7])
    values[row] = value
    path = replace(plan.path, **{column: values})
    place = re.escape(place_in_mm(path.positions_work[row]))
    with pytest.raises(PlanError, match=f"at {place} .*{said}"):
        prepare_surface(scenario, replace(plan, path=path))


SHORT = (
    "part.file=saddle", "plan.stepover_m=0.03", "plan.edge_margin_m=0.05", "process.feed_m_s=0.03",
    "process.max_feed_s=8", "seed=931",
)  # fmt: skip


def scenario(*changes):
    return override(default_scenario("surface"), [*SHORT, *changes])


@cache
def plan_of_short():
    asked = scenario()
    return plan_part(asked.part, asked.plan, asked.process, asked.pad)


def run_short(asked):
    return run_experiment(asked, plan_of_short())


def kept(folder, asked):
    folder.mkdir()
    run = run_short(asked)
    write_record(folder, RunRecord(folder.name, run.scenario, run.figures, run.log, run.path))
    return folder


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    return kept(tmp_path_factory.mktemp("passes") / "first", scenario())


def test_the_second_pass_errs_less_than_the_first_with_another_noise(first, tmp_path):
    before = read_record(first)
    second = read_record(kept(tmp_path / "second", scenario(f"process.learn={first}")))
    assert second.metrics["learned_from"] == 1
    assert second.metrics["force_rms_error_n"] < 0.8 * before.metrics["force_rms_error_n"]
    # The part lies as it lay: the tool lands at the same height. The sensor's noise is not the same.
    landed = [record.log["tcp_position_m"][record.log.fed][0] for record in (before, second)]
    assert np.linalg.norm(landed[0] - landed[1]) < 3e-4
    air = [record.log["wrench_raw_sensor"][:100, 2] for record in (before, second)]
    reading = [record.log["wrench_measured_tool"][:100, 2] for record in (before, second)]
    assert np.allclose(air[0], air[1], atol=0.1)
    assert abs(np.corrcoef(*reading)[0, 1]) < 0.5
    assert run_short(scenario(f"process.learn={tmp_path / 'second'}")).figures["learned_from"] == 2


@pytest.mark.parametrize(
    ("by", "change", "named"),
    [
        (run_short, "seed=932", "seed"),
        (run_short, "process.contact_force_n=15", "process.contact_force_n"),
        (run_experiment, "plan.stepover_m=0.04", "the path"),
        (run_short, "part.displacement_m=0.002", "part.displacement_m"),
        (run_short, "part.pose=[0,-0.55,0.08,0,0,0]", "where the part stands"),
        (check_settings, "controller.name=hybrid-adaptive", "hybrid-adaptive"),
        (check_settings, "process.learn=nowhere", "not a run folder"),
        (check_settings, "experiment=arc", "run surface"),
    ],
)
def test_another_job_is_refused_by_what_differs_and_what_cannot_learn_at_once(first, by, change, named):
    with pytest.raises(InputError, match=named):
        by(scenario(f"process.learn={first}", change))
