"""Elastic joints against known truth: statics, resonance, energy, stability, and motions played on them."""

import math
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from polish_sim.cell import build_scene
from polish_sim.cell.gears import elastic_torque, slip, with_error
from polish_sim.cell.playback import JointTargets, play_joints
from polish_sim.cell.real_arm import gear_twists, weights
from polish_sim.errors import ConfigError, ReachError
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.scenario_file import override
from tests.cell.elastic import HOME, NONE, REAL, SPRINGS_ONLY, STRETCHED, first_mode, joints_at, tangents

ARC = default_scenario("arc")


@pytest.mark.parametrize("gravity", [True, False])
def test_compliance_at_the_tool_is_that_of_gears_and_servos_in_series(gravity):
    well_damped = "robot.real.damping_nm_s_rad=[300,300,300,40,40,40]"
    low, high = [-3.0, -2.2, 0.3, -2.5, -2.4, -3.0], [3.0, -0.6, 2.2, -0.5, -0.7, 3.0]
    for q in np.random.default_rng(3 + gravity).uniform(low, high, (2, 6)):
        joints = joints_at(q, *SPRINGS_ONLY, well_damped, gravity=gravity)
        joints.go(0.3)
        soft = tangents(joints)
        if not gravity:
            np.testing.assert_allclose(soft, joints.arm.stiffness[:, 0], rtol=1e-6)
        J = joints.jacobian()
        expected = J @ np.diag(1.0 / soft + 1.0 / joints.arm.kp) @ J.T
        measured = np.empty((3, 3))
        for i, force in enumerate(0.1 * np.eye(3)):
            found = []
            for sign in (1.0, -1.0):
                joints.pull(sign * force)
                found.append(joints.go(1.5)["tool"][-1])
            measured[:, i] = (found[0] - found[1]) / 0.2
        np.testing.assert_allclose(measured, expected, atol=0.02 * np.linalg.norm(expected, 2))


@pytest.mark.parametrize("q", [STRETCHED, HOME])
def test_the_first_resonance_and_its_decay_are_those_of_the_linear_model(q):
    joints = joints_at(q, *SPRINGS_ONLY)
    value, shape = first_mode(joints)
    shape *= 1e-5 / np.abs(shape).max()
    data, arm, moving = joints.data, joints.arm, (value * shape).real
    data.qpos[:] += shape[:7].real
    data.qvel[:], arm.speed = moving[:7], moving[7:]
    arm.angle = arm.angle + shape[7:].real
    arm.twist = arm.twist + (shape[7:] - shape[:6]).real
    swing = joints.go(1.0)["q"]
    swing = (swing - swing[-100:].mean(axis=0)) @ shape[:6].real
    ups = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))[:6]
    crossings = ups + swing[ups] / (swing[ups] - swing[ups + 1])
    measured = 2.0 * math.pi / (np.diff(crossings).mean() * joints.dt)
    assert measured == pytest.approx(value.imag, rel=0.05)
    peaks = [swing[first:last].max() for first, last in pairwise(ups)]
    assert np.polyfit(ups[1:] * joints.dt, np.log(peaks), 1)[0] == pytest.approx(value.real, rel=0.05)


def test_hysteresis_loses_on_every_closed_way_is_as_wide_as_it_should_be_and_knees_must_rise():
    rng, most, rise = np.random.default_rng(1), 4.5, 1e-4
    for _ in range(10):
        turns = rng.uniform(-1e-3, 1e-3, 6)
        way = np.interp(np.linspace(0, 7, 7001), np.arange(8), [0.0, *turns, 0.0])
        torque, work, start = 0.0, 0.0, 0.0
        for _lap in range(3):  # the last time it begins as it ends
            work, start = 0.0, torque
            for moved in np.diff(way):
                after = slip(torque, moved, most, rise)
                work += 0.5 * (torque + after) * moved
                torque = after
        assert abs(torque - start) < 1e-3 * most
        assert work > 0.0
    arm, widths = joints_at(HOME).arm, []
    for sign in (1.0, -1.0):
        torque, twist = sign * arm.lost_torque[0], sign * 2e-3
        while sign * (elastic_torque(arm, 0, twist) + torque) > 0.0:
            torque, twist = slip(torque, -sign * 1e-6, arm.lost_torque[0], arm.rise), twist - sign * 1e-6
        widths.append(twist)
    assert widths[0] - widths[1] == pytest.approx(2.9e-4, rel=0.02)
    with pytest.raises(ConfigError, match="knee_2_nm"):
        run_experiment(override(ARC, [REAL, "robot.real.knee_2_nm=[10,48,48,6.9,6.9,6.9]"]))


def test_the_last_wrist_is_stable_behind_its_stiffest_slope():
    dt = 2e-3
    stiff = [f"robot.real.stiffness_{i}_nm_rad=[57e3,57e3,57e3,7100,7100,7100]" for i in (1, 2)]
    undamped = f"robot.real.damping_nm_s_rad={NONE}"
    joints = joints_at(HOME, *SPRINGS_ONLY, *stiff, undamped, f"simulation.timestep_s={dt}")
    inertia = np.zeros((7, 7))
    mujoco.mj_fullM(joints.model, joints.data, inertia)
    alone = 1.0 / np.linalg.inv(inertia)[5, 5]
    assert alone < 0.0018
    assert 7100.0 * dt**2 > 4.0 * alone  # explicit steps would run away
    joints.data.qvel[5] = 0.5
    twist = np.abs(joints.go(2.0)["twist"][:, 5])
    assert twist.max() < 1.5 * 0.5 * math.sqrt(alone / 7100.0) + 2e-6
    assert twist[-100:].max() < 1e-6


def test_the_gears_error_has_two_periods_a_turn_of_the_motor_and_the_height_it_should():
    joints = joints_at(HOME)
    angles = np.linspace(0.0, 2.0 * np.pi, 202 * 20, endpoint=False)
    for j in range(6):
        error = np.empty_like(angles)
        for k, angle in enumerate(angles):
            error[k] = with_error(0.0, joints.arm.error[j], joints.arm.waves, angle)[0]
        assert np.ptp(error) == pytest.approx(2.9e-4 if j < 3 else 4.4e-4, rel=0.01)
        assert np.abs(np.fft.rfft(error)).argmax() == 202


@pytest.mark.parametrize("side", ["motor", "link"])
def test_it_rests_under_its_weight_where_the_encoders_say(side):
    joints = joints_at(STRETCHED, f"robot.real.servo_side={side}", "robot.real.encoder_rad=0")
    held = weights(joints.model, joints.data.qpos[None, :6].copy())
    hanging = gear_twists(ARC.robot.real, held)[0]
    rows = joints.go(0.5)
    np.testing.assert_allclose(joints.arm.read, STRETCHED, atol=1e-9)
    np.testing.assert_allclose(rows["twist"][-1], hanging, atol=1e-9)
    assert 5e-4 < abs(hanging[1]) < 3e-3
    assert np.abs(rows["tool"] - rows["tool"][0]).max() < 1e-8


@pytest.mark.parametrize(
    ("seed", "side", "low", "high"),
    [(0, "motor", 0.05e-3, 0.3e-3), (1, "motor", 0.05e-3, 0.3e-3), (0, "link", 0.005e-3, 0.1e-3)],
)
def test_the_arc_errs_as_a_real_arm_does(seed, side, low, high):
    settings = [REAL, f"seed={seed}", f"robot.real.servo_side={side}", "process.max_feed_s=20"]
    figures = run_experiment(override(ARC, settings)).figures
    assert figures["protective_stop"] is None
    assert low < figures["tracking_error_max_m"] < high
    assert figures["speed_mean_m_s"] == pytest.approx(0.01, abs=5e-5)


def swing(amplitude, dt=1e-3):
    """All joints there and back, in 2 s."""
    angle, rate = np.pi * np.arange(0.0, 2.0, dt) / 2.0, 0.5 * np.pi
    way, speed = np.sin(angle) ** 4, 4.0 * rate * np.sin(angle) ** 3 * np.cos(angle)
    return JointTargets(HOME + amplitude * way[:, None] * np.ones(6), amplitude * speed[:, None] * np.ones(6))


def played(scenario, targets):
    return play_joints(build_scene(scenario), scenario.robot, scenario.seed, targets)


def test_a_smooth_swing_is_followed_and_with_rigid_gears_as_the_ideal_arm_does():
    ideal_arm = override(ARC, ["robot.arm=ideal"])
    errors = [np.abs(played(ideal_arm, swing(a)).q - swing(a).q).max() for a in (0.0, 0.05, 0.2)]
    assert errors[0] < 5e-5
    assert errors[1] < 2e-4
    assert errors[1] < errors[2] < 6e-4
    folded = HOME.copy()
    folded[2] = 3.1  # the elbow closed
    with pytest.raises(ReachError, match="would touch"):
        played(ideal_arm, JointTargets(np.tile(folded, (50, 1)), np.zeros((50, 6))))
    scenario = override(ideal_arm, ["simulation.timestep_s=2.5e-4"])
    targets = swing(0.2, 2.5e-4)
    ideal, again = (played(scenario, targets) for _ in range(2))
    for one, other in zip(ideal, again, strict=True):
        np.testing.assert_array_equal(one, other)
    rigid = [f"robot.real.stiffness_{i}_nm_rad=[1e7,1e7,1e7,1e7,1e7,1e7]" for i in (1, 2, 3)]
    alike = ["robot.real.rotor_kg_m2=[1,1,1,0.2,0.2,0.2]", "robot.real.viscous_nm_s_rad=[8,8,8,1,1,1]"]
    cold = ["robot.real.cold_friction=0", "robot.real.coulomb_nm=[5,5,5,1.2,1.2,1.2]"]
    real = played(override(scenario, [*SPRINGS_ONLY, *rigid, *alike, *cold]), targets)
    # They stand by Coulomb's friction anywhere within what it takes of the servos.
    stuck = np.array([5.0] * 3 + [1.2] * 3) / np.array([2e5] * 3 + [3e4] * 3)
    assert np.all(np.abs(real.q - ideal.q).max(axis=0) < 2.0 * stuck)
    moving = np.flatnonzero(np.abs(ideal.qd[:, 0]) > 0.05)[::100]
    change = np.diff(ideal.qd, axis=0, append=ideal.qd[-1:])[moving]
    held = weights(build_scene(scenario), ideal.q[moving])
    expected = ideal.torque[moving] - np.array([1600.0] * 3 + [220.0] * 3) * change + held
    assert np.all(np.abs(real.torque[moving] - expected).max(axis=0) < 0.02 * np.ptp(expected, axis=0))
