"""Hand guiding: moves in every mode, and paths taught by dragging the tool."""

from dataclasses import replace

import numpy as np
import pytest

from polish_sim.arrays import directions_at, rms
from polish_sim.cell.real_arm import gear_twists
from polish_sim.config import DragConfig, GuideConfig, HandConfig, Scenario
from polish_sim.errors import InputError, PlanError
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.geometry import fit_surface, load_part
from polish_sim.hand_guiding import CLAIMS, kind_of, teach
from polish_sim.hand_guiding.arm import home_pose, torque_arm
from polish_sim.hand_guiding.cell import GuidingRow, GuidingRun
from polish_sim.hand_guiding.drag import drag_table, teach_path
from polish_sim.hand_guiding.law import MODES
from polish_sim.identification.arm import ARM_JOINTS
from polish_sim.identification.model_file import identified_xml
from polish_sim.identification.robot_model import own_parameters
from polish_sim.log import PROCESS_PHASE
from polish_sim.models import workpiece_path
from polish_sim.scenario_file import override

GRIP = {"turn_stiffness_nm_rad": 30.0, "turn_damping_nm_s_rad": 10.0}
RADIUS, SPEED = 0.08, 0.05
IDEAL = override(default_scenario("teach"), ["robot.arm=ideal"])


def scenario(hand=None, **guide):
    held = replace(HandConfig(), off_s=5.0, **(hand or {}))
    return replace(IDEAL, guide=replace(GuideConfig(), **guide), hand=held)


@pytest.fixture(scope="module")
def trial():
    return run_experiment(scenario())


def assert_light(figures, direction):
    """Inertia compensation takes what is asked off the classical law, and the free arm stands."""
    assert figures[f"fast_peak_ratio_{direction}"] <= 0.45
    assert figures[f"fast_rms_ratio_{direction}"] <= 0.30
    assert figures["slow_peak_n"] <= 10.0
    assert figures["drift_rad"] < np.radians(0.01)


def test_each_step_of_compensation_lightens_the_move_and_the_log_has_the_hand_s_force(trial):
    for direction in "xy":
        assert_light(trial.figures, direction)
        felt = [trial.figures[f"{mode}_{direction}_slow_hand_force_rms_n"] for mode in MODES]
        assert felt == sorted(felt, reverse=True)
    assert trial.figures["drift_time_s"] == pytest.approx(4.0, abs=0.01)
    case, force = trial.log["case"], np.linalg.norm(trial.log["hand_force_n"], axis=1)
    moving = trial.log["phase"] == PROCESS_PHASE
    for number, name in enumerate(trial.figures["moves"]):
        peak = trial.figures[f"{name}_hand_force_peak_n"]
        assert force[moving & (case == number)].max() == pytest.approx(peak, rel=0.02)


def test_the_move_is_minimum_jerk_and_wander_and_tremor_have_the_size_and_band_asked_for():
    way, speed = teach.minimum_jerk(np.array([-1.0, 0.0, 0.5, 1.0, 2.0]))
    np.testing.assert_allclose(way, [0.0, 0.0, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(speed, [0.0, 0.0, 1.875, 0.0, 0.0])
    line = np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 50)
    upright = np.tile(np.eye(3), (50, 1, 1))
    rng, hand, dt = np.random.default_rng(3), HandConfig(), 0.001
    for changed, low, high, size in (
        ({"tremor_m": 0.0}, 0.0, 1.0, 0.0005), ({"wander_m": 0.0, "tremor_m": 0.0002}, 7.0, 13.0, 0.0002),
    ):  # fmt: skip
        table, meant = drag_table(line, upright, replace(DragConfig(follow="rim"), **changed), hand, dt, rng)
        off = (table.motion.positions - meant.positions)[2000:]
        power = np.abs(np.fft.rfft(off, axis=0)) ** 2
        at = np.fft.rfftfreq(len(off), dt)
        assert power[(at >= low) & (at <= high)].sum() > 0.9 * power.sum()
        assert np.sqrt(np.mean(off**2)) == pytest.approx(size, rel=0.15)
        np.testing.assert_allclose(meant.positions[[0, -1], 0], [0.0, 1.0], atol=1e-9)
        assert meant.velocities[:, 0].max() == pytest.approx(DragConfig().speed_m_s, rel=1e-3)
        assert np.abs(np.diff(meant.velocities[:, 0])).max() / dt < 0.2


@pytest.mark.parametrize(
    ("wrong", "stops"),
    [({"friction_scale": 0.8}, False), ({"friction_scale": 1.6}, True), ({"inertia_share": 0.96}, False)],
)
def test_wrong_friction_or_inertia_never_runs_away(wrong, stops):
    asked = scenario(GRIP, mode="inertia", direction="x", duration_s=0.6, **wrong)
    run = run_experiment(asked)
    assert np.abs(np.asarray(run.log["qd_rad_s"])).max() < 1.1 * asked.guide.joint_speed_limit_rad_s
    assert np.asarray(run.log["tcp_speed_m_s"]).max() < 1.1 * asked.guide.tool_speed_limit_m_s
    assert (run.stop_reason is not None) == stops
    assert stops or run.figures["drift_rad"] < np.radians(0.01)


def test_a_law_that_drives_by_itself_is_stopped_by_its_energy():
    wild = {"mode": "classical", "direction": "x", "duration_s": 0.6, "coulomb_share": 1.8}
    run = run_experiment(scenario(GRIP, **wild, energy_limit_j=1.0))
    assert "more energy than guide.energy_limit_j" in str(run.stop_reason)
    assert run.figures["lent_energy_j"] == pytest.approx(1.0, abs=0.1)
    assert run.figures["path_done"] == 0.0


def cut(rows, stop_step=0, interrupted=False, direction="x"):
    """The first rows of a fast move, at rest."""
    asked = scenario(mode="gravity", direction=direction, duration_s=0.6)
    move = teach.moves_of(asked.guide, asked.hand)[0]
    table = teach.move_table(move, asked.hand, home_pose(), 0.001)
    reason = "links touch" if stop_step else None
    recorded = np.zeros(rows, GuidingRow.dtype)
    recorded["R_base_tool"] = np.eye(3)
    return teach.PlayedMove(move, table, GuidingRun(recorded, reason, stop_step, interrupted, 0.0))


def test_only_a_whole_move_has_a_force_and_one_cut_short_leaves_its_mode_without_a_peak():
    """The hand moves from 1.1 s to 1.7 s; what brakes record of it after a stop is not the hand's move."""
    for rows, how, whole in (
        (1400, {"interrupted": True}, False), (1900, {"interrupted": True}, True),
        (1900, {"stop_step": 1400}, False), (2400, {"stop_step": 1900}, True),
    ):  # fmt: skip
        figures = teach.figures_of_moves(scenario(), [cut(rows, **how)], 1, 1.0)
        assert [np.isfinite(figures[f"hand_force_{name}_n"]) for name in ("peak", "rms")] == [whole] * 2
    # The largest of a known and an unknown force is unknown, whichever came first.
    for order in (1, -1):
        played = [cut(2400), cut(1400, interrupted=True, direction="y")][::order]
        assert np.isnan(teach.figures_of_moves(scenario(), played, 2, 1.0)["hand_force_peak_n"])
        known, unknown = {"hand_force_peak_n": 20.0, "hand_force_rms_n": 9.0}, {"hand_force_peak_n": np.nan}
        moves = "classical_x_slow", "classical_y_slow", "assist_x_slow", "assist_y_slow"
        modes = teach.compare_modes(dict(zip(moves, 2 * [known, unknown][::order], strict=True)))
        assert np.isnan([modes["classical_peak_n"], modes["slow_peak_n"]]).all()


def test_an_identified_model_is_as_good_as_the_true_one(tmp_path):
    file = tmp_path / "identified.xml"
    parameters = own_parameters(torque_arm(Scenario()), ARM_JOINTS)
    file.write_text(identified_xml(ARM_JOINTS, parameters, {}))
    move = {"mode": "assist", "direction": "x", "duration_s": 0.6}
    true, identified = (run_experiment(scenario(**move, **more)) for more in ({}, {"model_file": str(file)}))
    for figure in ("hand_force_peak_n", "hand_force_rms_n"):
        assert identified.figures[figure] == pytest.approx(true.figures[figure], rel=0.02)


def dragged(**drag):
    return replace(IDEAL, drag=replace(DragConfig(follow="rim"), **drag))


@pytest.fixture(scope="module")
def run():
    return run_experiment(dragged())


def test_every_figure_that_is_shown_is_measured_and_a_taught_path_no_worse_than_the_hand(trial, run):
    for result, kind in ((trial, "trial"), (run, "path")):
        assert kind_of(result.scenario.guide, result.scenario.drag.follow) == kind
        assert {claim.figure for claim in CLAIMS[kind]} <= set(result.figures)
        assert result.stop_reason is None
    assert trial.figures["path_done"] == 1.0
    # What is left is the slow wander within the surface; what left the surface and the tremor are gone.
    hand = np.sqrt(3.0 * (run.scenario.drag.wander_m**2 + run.scenario.drag.tremor_m**2))
    assert run.figures["recorded_deviation_rms_m"] == pytest.approx(hand, rel=0.35)
    assert run.figures["taught_deviation_rms_m"] < 0.85 * run.figures["recorded_deviation_rms_m"]
    elastic = run_experiment(on_real_arm(dragged()))
    assert elastic.figures["taught_deviation_rms_m"] < 1.5e-3
    for taught in (run, elastic):
        assert taught.stop_reason is None
        assert taught.figures["taught_axis_error_max_rad"] < 0.5 * run.scenario.drag.wobble_rad


def test_a_steady_hand_teaches_the_rim_but_for_what_its_spring_gives_and_the_same_seed_the_same_path():
    steady = dragged(wander_m=0.0, tremor_m=0.0, wobble_rad=0.0)
    figures = run_experiment(override(steady, ["part.file=sphere_50"])).figures
    assert figures["taught_deviation_max_m"] < figures["hand_force_peak_n"] / HandConfig().stiffness_n_m
    assert figures["taught_missed_max_m"] < 2e-3
    small = override(dragged(), ["part.file=sphere_50"])
    paths = [run_experiment(replace(small, seed=seed)).path.positions_work for seed in (0, 0, 1)]
    assert np.array_equal(paths[0], paths[1])
    assert not np.array_equal(paths[0], paths[2])


def test_an_arm_that_stops_itself_teaches_no_path_and_an_unknown_side_of_encoders_is_refused():
    asked = dragged(speed_m_s=0.2)
    run = run_experiment(replace(asked, guide=replace(asked.guide, tool_speed_limit_m_s=0.06)))
    assert run.stop_reason is not None
    assert run.path is None
    assert len(run.log)
    with pytest.raises(InputError, match=r"guide.encoder_side 'both'.*link, motor"):
        run_experiment(on_real_arm(scenario(mode="gravity"), "guide.encoder_side=both"))


def on_real_arm(asked, *settings):
    return override(asked, ["robot.arm=ur5e", *settings])


def test_inertia_is_compensated_for_elastic_joints_heard_on_the_link_s_side_not_by_the_motors_encoders():
    real_trial = run_experiment(on_real_arm(scenario(direction="x")))
    assert real_trial.stop_reason is None
    assert_light(real_trial.figures, "x")
    # Above the resonance a rotor is alone: less inertia than is compensated. Rigid gears are stable.
    move = scenario(mode="inertia", direction="x", duration_s=1.0)
    assert run_experiment(on_real_arm(move, "guide.encoder_side=motor")).stop_reason is not None
    rigid = [f"robot.real.stiffness_{i}_nm_rad=[1e8,1e8,1e8,1e8,1e8,1e8]" for i in (1, 2, 3)]
    assert run_experiment(on_real_arm(move, "guide.encoder_side=motor", *rigid)).stop_reason is None


def test_the_hand_pulls_the_link_and_winds_up_the_gear():
    """A hand that pulls at standing motors sees the gears' compliance between read and true joint angles."""
    move = scenario(mode="gravity", direction="x", duration_s=1.0)
    exact = [f"robot.real.{name}_rad=[0,0,0,0,0,0]" for name in ("gear_error", "lost_motion")]
    asked = on_real_arm(move, "guide.encoder_side=motor", "robot.real.kinematics=exact", *exact)
    run = run_experiment(asked)
    twist = np.asarray(run.log["q_rad"], float)[:, 1] - np.asarray(run.log["encoder_q_rad"], float)[:, 1]
    held = np.asarray(run.log["torque_nm"], float)[0]
    assert abs(twist[0]) == pytest.approx(abs(gear_twists(asked.robot.real, held[None])[0, 1]), rel=0.01)
    assert np.abs(twist - twist[0]).max() > 1e-4


def circle(tremor=0.0, still=0.0, height=0.02):
    """Once round a level circle at constant speed, held still before and after, with a tremor of 10 Hz."""
    duration = 2.0 * np.pi * RADIUS / SPEED
    t = np.arange(0.0, duration + 2.0 * still, 0.004)
    angle = np.clip((t - still) / duration, 0.0, 1.0) * 2.0 * np.pi
    radius = RADIUS + tremor * np.sin(2.0 * np.pi * 10.0 * t)
    return t, np.column_stack([radius[:, None] * directions_at(angle), np.full(len(t), height)])


def taught_on_plate(record):
    """On the shipped plate, level, its top at 20 mm."""
    return teach_path(*record, fit_surface(load_part(workpiece_path("plate"))), 4.0, 5e-5, 0.002)


def off_circle(points):
    return np.abs(np.linalg.norm(points[:, :2], axis=1) - RADIUS)


@pytest.mark.parametrize("tremor", [0.0, 0.0005])
def test_a_hand_s_circle_comes_back_and_tremor_is_filtered_to_a_fifth(tremor):
    hand = circle(tremor)
    taught = taught_on_plate(hand)
    off = off_circle(taught.path.positions_work)[3:-3]
    assert rms(off) < 0.2 * rms(off_circle(hand[1])) if tremor else off.max() < 1e-4
    assert taught.path.length_m == pytest.approx(2.0 * np.pi * RADIUS, rel=5e-3)
    assert np.diff(taught.path.s).max() < 0.0025


def test_standing_still_is_no_path_and_a_hand_that_hardly_moves_teaches_none():
    taught = taught_on_plate(circle(still=3.0))
    assert taught.path.length_m == pytest.approx(2.0 * np.pi * RADIUS, rel=0.02)
    assert np.diff(taught.path.s).min() > 0.001
    with pytest.raises(PlanError, match="too little to teach a path"):
        taught_on_plate((circle()[0], 0.01 * circle()[1]))


def test_on_a_sphere_points_lie_on_it_and_axes_are_its_normals():
    mesh = load_part(workpiece_path("sphere_300"))
    surface, low, high = fit_surface(mesh), mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    record = circle(height=float(high[2]) - 0.3 + np.sqrt(0.3**2 - RADIUS**2) + 0.002)
    record = record[0], record[1] + [*(0.5 * (low + high)[:2]), 0.0]
    found = teach_path(*record, surface, 4.0, 5e-5, 0.002)
    # The shipped calotte is a sphere of 300 mm; the hand was 2 mm above it.
    assert found.off_surface == pytest.approx(0.002, abs=3e-4)
    again = surface.closest(found.path.positions_work)
    np.testing.assert_allclose(again.positions, found.path.positions_work, atol=1e-9)
    np.testing.assert_allclose(np.sum(again.normals * found.path.axes_work, axis=1), 1.0, atol=1e-6)
