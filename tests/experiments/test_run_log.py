"""Logs: the contract's columns, and the same bytes again, also from where a cell was saved."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.cell import Silent, tool_on_flange
from polish_sim.experiments import default_scenario, prepare_surface, run_experiment
from polish_sim.experiments.assembly import build_cell
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.proof_play import restore_cell, save_cell, use_strokes
from polish_sim.log import COLUMNS
from polish_sim.motion import forward, jacobian
from polish_sim.scenario_file import override
from tests.cell.cells import along_tool, cell_for, part_under, pressing_stroke, tool_pose, way_through
from tests.kept import plate_file


def column(result, name):
    return np.asarray(result.log[name], dtype=float)


def test_every_column_of_the_contract_is_there_and_figures_say_what_was_run(freeform):
    for name, width in COLUMNS.items():
        values = freeform.log[name]
        assert values.shape == ((len(freeform.log), width) if width else (len(freeform.log),)), name
        assert np.all(np.isfinite(values)), name
    time, figures = column(freeform, "time_s"), freeform.figures
    np.testing.assert_allclose(time, 0.004 * np.arange(len(time)), atol=1e-9)
    for name in ("tcp_quaternion_wxyz", "target_quaternion_wxyz"):
        quaternions = column(freeform, name)
        np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-6)
        assert np.sum(quaternions[1:] * quaternions[:-1], axis=1).min() > 0.9  # no jump in sign
    torque = np.abs(column(freeform, "torque_nm")).max(axis=0)
    assert np.all(torque < [150.0, 150.0, 150.0, 28.0, 28.0, 28.0])
    assert torque.max() > 1.0
    assert figures["steps"] == len(freeform.trace.time_s)
    assert figures["simulated_s"] == pytest.approx(figures["steps"] * 0.001)
    assert (figures["seed"], figures["protective_stop"]) == (0, None)
    assert figures["real_time_factor"] == pytest.approx(figures["simulated_s"] / figures["wall_s"])


def test_tool_pose_and_speed_are_the_joints_by_forward_kinematics():
    """Of the ideal arm, whose table is the nominal one."""
    run = run_experiment(override(default_scenario("arc"), ["robot.arm=ideal", "process.max_feed_s=1"]))
    q, qd = column(run, "q_rad"), column(run, "qd_rad_s")
    T_base_tool = forward(q) @ tool_on_flange()
    np.testing.assert_allclose(T_base_tool[:, :3, 3], column(run, "tcp_position_m"), atol=1e-6)
    frames = Rotation.from_quat(column(run, "tcp_quaternion_wxyz"), scalar_first=True)
    assert (frames.inv() * Rotation.from_matrix(T_base_tool[:, :3, :3])).magnitude().max() < 1e-6
    twist = np.einsum("nij,nj->ni", jacobian(q, tool_on_flange()[:3, 3].copy()), qd)
    np.testing.assert_allclose(np.linalg.norm(twist[:, :3], axis=1), column(run, "tcp_speed_m_s"), atol=1e-6)


def test_the_traces_errors_are_those_of_the_log_whose_wrenches_differ_by_weight_bias_and_noise_only(freeform):
    error = column(freeform, "target_position_m") - column(freeform, "tcp_position_m")
    tool, target = (
        Rotation.from_quat(column(freeform, f"{name}_quaternion_wxyz"), scalar_first=True)
        for name in ("tcp", "target")
    )
    axis = target.apply([0.0, 0.0, 1.0])
    across = error - np.sum(error * axis, axis=1)[:, None] * axis
    trace, rows = freeform.trace, slice(None, None, 4)
    force = freeform.log["normal_force_n"]
    np.testing.assert_array_equal(force, freeform.log["wrench_true_tool"][:, 2])
    np.testing.assert_array_equal(force, trace.normal_force_n[rows].astype(np.float32))
    np.testing.assert_allclose(trace.position_error_m[rows], np.linalg.norm(error, axis=1), atol=1e-9)
    np.testing.assert_allclose(trace.tangential_error_m[rows], np.linalg.norm(across, axis=1), atol=1e-8)
    angle = (tool.inv() * target).magnitude()
    np.testing.assert_allclose(trace.orientation_error_rad[rows], angle, atol=1e-6)
    np.testing.assert_allclose(trace.path_s_m[rows], column(freeform, "path_s_m"), atol=1e-6)
    np.testing.assert_array_equal(trace.tcp_position_m[rows], freeform.log["tcp_position_m"])
    fed = freeform.log.fed
    travel, force = column(freeform, "pad_travel_m")[fed], column(freeform, "normal_force_n")[fed]
    assert travel.mean() * 20000.0 / 3.0 == pytest.approx(force.mean(), rel=0.01)
    path, along = freeform.path, column(freeform, "path_s_m")[fed]
    turns = path.pass_index[np.searchsorted(path.s, along + 1e-9, side="right") - 1]
    assert np.mean(turns == freeform.log["pass_index"][fed]) > 0.99
    measured, true = column(freeform, "wrench_measured_tool")[fed], column(freeform, "wrench_true_tool")[fed]
    np.testing.assert_allclose((measured - true)[:, :3].mean(axis=0), 0.0, atol=0.15)
    np.testing.assert_allclose((measured - true)[:, 3:].mean(axis=0), 0.0, atol=0.03)
    R = Rotation.from_quat(column(freeform, "tcp_quaternion_wxyz")[fed], scalar_first=True)
    weight = R.inv().apply([0.0, 0.0, 2.0 * 9.81])
    raw = column(freeform, "wrench_raw_sensor")[fed, :3]
    np.testing.assert_allclose((raw - weight - true[:, :3]).mean(axis=0), 0.0, atol=0.1)


def same(one, other):
    return all(one[name].tobytes() == other[name].tobytes() for name in one.names)


def test_the_same_seed_gives_the_same_bytes_another_others(cap):
    scenario, plan = cap
    run, again, other = (run_experiment(override(scenario, [f"seed={seed}"]), plan) for seed in (0, 0, 1))
    assert not same(run.log, other.log)
    assert other.figures["force_rms_error_n"] != run.figures["force_rms_error_n"]
    assert same(run.log, again.log)
    assert all(np.array_equal(a, b) for a, b in zip(run.trace, again.trace, strict=True))


class Onlooker(Silent):
    """Looks on every 11 steps."""

    frame_every_s = 0.011


def test_who_looks_on_changes_nothing_and_rows_thinned_out_keep_least_and_largest_force_between_them():
    short_force = run_experiment(override(default_scenario("force"), ["process.hold_s=1"]))
    assert same(short_force.log, run_experiment(short_force.scenario, observer=Onlooker()).log)
    second = tool_pose(0.02, -0.5, 0.1)
    way = way_through(along_tool(tool_pose(0.0, -0.5, 0.1), z=-0.005), along_tool(second, z=-0.005))
    strokes = [pressing_stroke(*at, hold=0.3, lift=0.005) for at in ((), (second,))]
    strokes[1] = strokes[1]._replace(travel=way)
    cells = [cell_for(default_scenario("force"), *strokes, part=part_under()) for _ in range(2)]
    runs = [cell.run(who) for cell, who in zip(cells, (Silent(), Onlooker()), strict=True)]
    assert runs[0].stop_reason is None
    assert same(runs[0].log, runs[1].log)
    rates = {0: 1, 50: 20}
    asked = {rate: override(short_force.scenario, [f"simulation.log_rate_hz={rate}"]) for rate in rates}
    runs = {rate: run_experiment(scenario) for rate, scenario in asked.items()} | {250: short_force}
    for rate, every in (rates | {250: 4}).items():
        for name in ("time_s", "tcp_position_m", "wrench_measured_tool", "command_twist", "phase"):
            np.testing.assert_array_equal(runs[rate].log[name], runs[0].log[name][::every])
        np.testing.assert_array_equal(runs[rate].trace.normal_force_n, runs[0].trace.normal_force_n)
    force, log = runs[50].trace.normal_force_n.astype(np.float32), runs[50].log
    extremes = zip(log["normal_force_min_n"], log["normal_force_max_n"], strict=True)
    for row, found in enumerate(extremes):
        between = force[max(0, 20 * (row - 1) + 1) : 20 * row + 1]
        assert found == (between.min(), between.max())


SHORT = (
    f"part.file={plate_file()}", "plan.stepover_m=0.05", "process.feed_m_s=0.06", "seed=500",
    "process.approach_speed_m_s=0.02", "simulation.log_rate_hz=0",
)  # fmt: skip


def cell(*changes):
    scenario = override(default_scenario("surface"), [*SHORT, *changes])
    return build_cell(scenario, prepare_surface(*planned(scenario)))


def played(one, before, piece):
    """The run of a cell played before, and now in pieces to its end."""
    rest = []
    while not one.done:
        rest.append(one.play(piece))
    return one.result([*before, *rest])


def assert_same(run, other):
    assert (run.stop_reason, run.safety) == (other.stop_reason, other.safety)
    assert run.trace.normal_force_n.tobytes() == other.trace.normal_force_n.tobytes()
    assert same(run.log, other.log)


@pytest.mark.parametrize(("controller", "arm"), [("hybrid-pi", "ideal"), ("hybrid-adaptive", "ur5e")])
def test_a_restored_cell_runs_on_as_if_it_had_never_been_cut(controller, arm):
    settings = (
        f"controller.name={controller}", f"robot.arm={arm}", "process.max_feed_s=2",
    )  # fmt: skip
    whole, one = cell(*settings).run(), cell(*settings)
    assert whole.trace.phase.max() >= 2
    before = [one.play(1000), one.play(777)]
    saved = save_cell(one)
    assert_same(played(one, before, 301), whole)
    restore_cell(one, saved)
    assert_same(played(one, before, 500), whole)


def test_strokes_and_course_can_be_exchanged_on_the_way():
    """Exchanged for equal ones nothing changes; for slower ones the rest of the run takes longer."""
    one, runs = cell("controller.name=hybrid-adaptive", "process.max_feed_s=2"), []
    before = [one.play(3000)]
    saved = save_cell(one)
    slow = [s._replace(motion=s.motion._replace(rates=0.5 * s.motion.rates)) for s in one.strokes]
    for strokes in (None, one.strokes, slow):
        if strokes is None:
            restore_cell(one, saved)
        else:
            use_strokes(one, strokes, one.course, saved)
        runs.append(played(one, before, 500))
    assert_same(runs[1], runs[0])
    fed, fed_slowly = (np.ptp(run.trace.path_s_m) for run in runs[1:])
    assert 0.5 < fed_slowly / fed < 0.75


def test_ctrl_c_while_a_law_is_compiled_is_not_lost_in_compiled_code():
    class Law:
        @property
        def address(self):
            raise KeyboardInterrupt

    one = cell()
    one.controller.law = Law()
    with pytest.raises(KeyboardInterrupt):
        one.use_controller(one.controller)
