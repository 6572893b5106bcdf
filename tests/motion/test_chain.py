"""Chains of way points, and the torques of a serial chain."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.errors import SmoothingError
from polish_sim.identification.arm import ARM_JOINTS
from polish_sim.identification.regressor import TorqueModel, random_states
from polish_sim.identification.robot_model import read_chain
from polish_sim.models import robot_model_path
from polish_sim.motion.rules.chain import build_chain, chain_from_axes, repeated_points
from polish_sim.motion.serial_chain import chain_model, chain_torque


def test_every_segment_ends_in_the_next_way_point_s_frame():
    tips = np.random.default_rng(0).normal(size=(40, 3))
    frames = Rotation.random(40, random_state=0).as_matrix()
    chain = build_chain(tips, frames)
    ends = chain.tips[:-1] + chain.lengths[:, None] * chain.directions
    np.testing.assert_allclose(ends, tips[1:], atol=1e-14)
    turns = Rotation.from_rotvec(chain.angles[:, None] * chain.turn_axes).as_matrix()
    rolls = Rotation.from_rotvec(chain.rolls[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    np.testing.assert_allclose(turns @ frames[:-1] @ rolls, frames[1:], atol=1e-13)
    for axes in (chain.axes[:-1], chain.axes[1:]):
        np.testing.assert_allclose(np.sum(axes * chain.turn_axes, axis=1), 0.0, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 3.0, np.pi - 1e-5])
def test_angles_are_exact_from_nothing_to_nearly_half_a_turn(angle):
    axes = np.array([[1.0, 0.0, 0.0], [np.cos(angle), np.sin(angle), 0.0]])
    chain = chain_from_axes(np.zeros((2, 3)) + [[0.0], [0.01]], axes)
    assert chain.angles[0] == pytest.approx(angle, rel=1e-13, abs=1e-16)
    np.testing.assert_allclose(chain.turn_axes[0], [0.0, 0.0, float(angle > 0.0)], atol=1e-12)


TIPS = np.array([[0.0, 0, 0], [0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]])
NAN_TIPS, STRAIGHT = np.where(np.arange(4)[:, None] == 1, np.nan, TIPS), np.tile([0.0, 0, 1], (4, 1))
HALF_TURN, NO_AXIS = STRAIGHT * [[1], [1], [1], [-1]], STRAIGHT * [[1], [0], [1], [1]]
FRAMES = np.tile(np.eye(3), (4, 1, 1))


@pytest.mark.parametrize(
    ("build", "tips", "frames", "words"),
    [
        (chain_from_axes, TIPS, HALF_TURN, r"180 deg .*\(10, 0, 0\) mm .* 2 and 3"),
        (chain_from_axes, TIPS, NO_AXIS, r"way point 1 .* zero"),
        (build_chain, np.zeros((0, 3)), np.zeros((0, 3, 3)), "shape"),
        (build_chain, NAN_TIPS, FRAMES, "way point 1 .* not finite"),
        (
            build_chain,
            TIPS,
            np.array([1.0, 2.0, 1.0, 1.0])[:, None, None] * FRAMES,
            "way point 1 .* no rotation",
        ),
    ],
)
def test_what_is_no_chain_is_refused_with_its_place(build, tips, frames, words):
    with pytest.raises(SmoothingError, match=words):
        build(tips, frames)


def test_points_that_repeat_tip_and_axis_are_left_out_others_stay():
    tips = np.array([[0.0, 0, 0], [0.0, 0, 0], [0.0, 0, 0], [0.01, 0, 0], [0.01, 0, 0]])
    axes = np.array([[0.0, 0, -1], [0.0, 0, -1], [0.0, 0.6, -0.8], [0.0, 0.6, -0.8], [0.0, 0.6, -0.8]])
    chain = chain_from_axes(tips, axes)
    frames = np.stack([np.cross([0.0, 1.0, 0.0], axes), np.tile([0.0, 1.0, 0.0], (5, 1)), axes], axis=2)
    np.testing.assert_array_equal(repeated_points(tips, frames), [False, True, False, False, True])
    np.testing.assert_allclose(chain.lengths, [0.0, 0.01])
    np.testing.assert_allclose(chain.angles, [np.arctan2(0.6, 0.8), 0.0])
    np.testing.assert_array_equal(chain.directions[0], 0.0)
    np.testing.assert_array_equal(chain.turn_axes[1], 0.0)
    assert len(build_chain(tips[:1], frames[:1]).lengths) == 0


ROBOT = mujoco.MjModel.from_xml_path(str(robot_model_path()))


@pytest.mark.parametrize(("joints", "count"), [(ARM_JOINTS, 6), (None, 7)], ids=["arm", "arm and slide"])
def test_torques_are_those_of_the_regressor_and_without_gravity_scale_with_the_masses(joints, count):
    chain = read_chain(ROBOT, joints)
    rigid, states = TorqueModel(chain, ("armature",)), random_states(count, 100, np.random.default_rng(1))
    wanted, model, torque = rigid.torque(states, rigid.truth()), chain_model(chain), np.zeros(count)
    for row in range(100):
        chain_torque(model, states.q[row], states.qd[row], states.qdd[row], 1.0, torque)
        np.testing.assert_allclose(torque, wanted[row], atol=1e-11)
    chain, torque, more = read_chain(ROBOT, ARM_JOINTS), np.zeros(6), np.zeros(6)
    q, qdd, still = np.linspace(-1.0, 1.0, 6), np.linspace(2.0, -3.0, 6), np.zeros(6)
    chain_torque(chain_model(chain), q, still, qdd, 0.0, torque)
    chain_torque(chain_model(chain, 1.2), q, still, qdd, 0.0, more)
    np.testing.assert_allclose(more, 1.2 * torque, rtol=1e-12)
    chain_torque(chain_model(chain), q, still, still, 0.0, torque)
    np.testing.assert_array_equal(torque, still)
