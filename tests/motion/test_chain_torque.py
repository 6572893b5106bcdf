"""Torques of a chain by Newton-Euler, against the regressor (itself checked against the engine and pinocchio)."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from polish_sim.errors import InputError
from polish_sim.identification.arm import ARM_JOINTS
from polish_sim.identification.regressor import TorqueModel, random_states
from polish_sim.identification.robot_model import read_chain
from polish_sim.models import robot_model_path
from polish_sim.motion.serial_chain import chain_model, chain_torque


@pytest.fixture(scope="module")
def robot() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(robot_model_path()))


def test_torques_are_those_of_the_regressor(robot: mujoco.MjModel) -> None:
    chain = read_chain(robot, ARM_JOINTS)
    rigid, states = TorqueModel(chain, ("armature",)), random_states(6, 100, np.random.default_rng(1))
    wanted, model, torque = rigid.torque(states, rigid.truth()), chain_model(chain), np.zeros(6)
    for row in range(100):
        chain_torque(model, states.q[row], states.qd[row], states.qdd[row], 1.0, torque)
        np.testing.assert_allclose(torque, wanted[row], atol=1e-11)


def test_without_gravity_a_still_arm_needs_no_torque(robot: mujoco.MjModel) -> None:
    model, torque, still = chain_model(read_chain(robot, ARM_JOINTS)), np.full(6, np.nan), np.zeros(6)
    chain_torque(model, np.linspace(-1.0, 1.0, 6), still, still, 0.0, torque)
    np.testing.assert_array_equal(torque, still)


def test_torques_of_inertia_scale_with_the_masses(robot: mujoco.MjModel) -> None:
    chain, torque, more = read_chain(robot, ARM_JOINTS), np.zeros(6), np.zeros(6)
    q, qdd, still = np.linspace(-1.0, 1.0, 6), np.linspace(2.0, -3.0, 6), np.zeros(6)
    chain_torque(chain_model(chain), q, still, qdd, 0.0, torque)
    chain_torque(chain_model(chain, 1.2), q, still, qdd, 0.0, more)
    np.testing.assert_allclose(more, 1.2 * torque, rtol=1e-12)


def test_a_slide_is_refused_by_name(robot: mujoco.MjModel) -> None:
    with pytest.raises(InputError, match="'head_slide' is a slide"):
        chain_model(read_chain(robot))
