"""Joint targets played on servos, rigid and behind gears."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.cell import build_scene
from polish_sim.cell.playback import JointTargets, play_joints
from polish_sim.cell.real_arm import gear_twists, weights
from polish_sim.errors import ReachError
from polish_sim.experiments import default_scenario
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.scenario_file import override
from tests.cell.elastic import HOME, SPRINGS_ONLY, STRETCHED

IDEAL = override(default_scenario("arc"), ["robot.arm=ideal"])


def swing(amplitude: float, dt: float = 1e-3) -> JointTargets:
    """All joints there and back, in 2 s."""
    angle, rate = np.pi * np.arange(0.0, 2.0, dt) / 2.0, 0.5 * np.pi
    way, speed = np.sin(angle) ** 4, 4.0 * rate * np.sin(angle) ** 3 * np.cos(angle)
    return JointTargets(HOME + amplitude * way[:, None] * np.ones(6), amplitude * speed[:, None] * np.ones(6))


def test_a_smooth_swing_is_followed_and_the_error_grows_with_the_acceleration() -> None:
    errors = [np.abs(play_joints(IDEAL, swing(a)).q - swing(a).q).max() for a in (0.0, 0.05, 0.2)]
    assert errors[0] < 5e-5
    assert errors[1] < 2e-4
    assert errors[1] < errors[2] < 6e-4


def test_links_that_would_touch_are_refused_by_name() -> None:
    folded = HOME.copy()
    folded[2] = 3.1  # the elbow closed
    with pytest.raises(ReachError, match="would touch"):
        play_joints(IDEAL, JointTargets(np.tile(folded, (50, 1)), np.zeros((50, 6))))


def test_played_with_rigid_gears_it_moves_as_the_ideal_arm_does():
    """And its motors give what the ideal arm's servos and its weight's compensation give together."""
    scenario = override(IDEAL, ["simulation.timestep_s=2.5e-4"])
    targets = swing(0.2, 2.5e-4)
    ideal, again = (play_joints(scenario, targets) for _ in range(2))
    for one, other in zip(ideal, again, strict=True):
        np.testing.assert_array_equal(one, other)
    rigid = [f"robot.real.stiffness_{i}_nm_rad=[1e7,1e7,1e7,1e7,1e7,1e7]" for i in (1, 2, 3)]
    alike = ["robot.real.rotor_kg_m2=[1,1,1,0.2,0.2,0.2]", "robot.real.viscous_nm_s_rad=[8,8,8,1,1,1]"]
    cold = ["robot.real.cold_friction=0", "robot.real.coulomb_nm=[5,5,5,1.2,1.2,1.2]"]
    real = play_joints(override(scenario, [*SPRINGS_ONLY, *rigid, *alike, *cold]), targets)
    # They stand by Coulomb's friction anywhere within what it takes of the servos.
    stuck = np.array([5.0] * 3 + [1.2] * 3) / np.array([2e5] * 3 + [3e4] * 3)
    assert np.all(np.abs(real.q - ideal.q).max(axis=0) < 2.0 * stuck)
    moving = np.flatnonzero(np.abs(ideal.qd[:, 0]) > 0.05)[::100]
    change = np.diff(ideal.qd, axis=0, append=ideal.qd[-1:])[moving]
    held = weights(build_scene(scenario, None, None), ideal.q[moving])
    expected = ideal.torque[moving] - np.array([1600.0] * 3 + [220.0] * 3) * change + held
    assert np.all(np.abs(real.torque[moving] - expected).max(axis=0) < 0.02 * np.ptp(expected, axis=0))


def test_played_at_rest_the_links_hang_where_springs_say():
    scenario = override(default_scenario("smooth"), SPRINGS_ONLY)
    played = play_joints(scenario, JointTargets(np.tile(STRETCHED, (50, 1)), np.zeros((50, 6))))
    model = build_scene(scenario, None, None)
    twists = gear_twists(scenario.robot.real, weights(model, played.q[-1:]))
    np.testing.assert_allclose(played.motor[-1] - played.q[-1], twists[0], atol=2e-6)
    np.testing.assert_allclose(played.read[-1], STRETCHED, atol=1e-7)
    np.testing.assert_allclose(played.torque[-1], weights(model, played.q[-1:])[0], atol=0.05)
    np.testing.assert_array_equal(played.table, NOMINAL)
