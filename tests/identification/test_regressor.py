"""The regressor gives the engine's torques, and its derivatives are those of its values."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from polish_sim.errors import InputError
from polish_sim.identification.regressor import TorqueModel, random_states, regressor_derivatives, rigid_regressor
from polish_sim.identification.robot_model import read_chain
from polish_sim.models import robot_model_path
from tests.identification.chains import ARM, arm_chain, arm_model, inverse_dynamics, odd_model

TERMS = ("viscous", "armature")


def test_torques_of_the_arm_are_the_engines_over_a_thousand_random_states() -> None:
    model = TorqueModel(arm_chain(), TERMS)
    states = random_states(6, 1000, np.random.default_rng(0))
    torque = model.torque(states, model.truth())
    assert np.abs(torque - inverse_dynamics(arm_model(), *states)).max() <= 1e-10
    assert np.abs(torque).max() > 50.0


def test_slides_tilted_axes_and_two_joints_on_a_body_give_the_engines_torques() -> None:
    engine = odd_model()
    model = TorqueModel(read_chain(engine), TERMS)
    states = random_states(4, 200, np.random.default_rng(1))
    torque = model.torque(states, model.truth())
    assert np.abs(torque - inverse_dynamics(engine, *states)).max() <= 1e-10


def test_the_regressor_is_pinocchios() -> None:
    pin = pytest.importorskip("pinocchio")
    theirs = pin.buildModelFromMJCF(str(robot_model_path()))
    assert theirs.nv == 7
    data, chain = theirs.createData(), arm_chain()
    states = random_states(6, 20, np.random.default_rng(2))
    # Pinocchio sees the head's slide as a seventh joint: standing still, it is part of link 6.
    own = np.array([theirs.inertias[k].toDynamicParameters() for k in range(1, 8)]).ravel()
    ours = rigid_regressor(chain.geometry, *states) @ chain.parameters.ravel()
    for row in range(20):
        q, qd, qdd = (np.append(part[row], 0.0) for part in states)
        full = pin.computeJointTorqueRegressor(theirs, data, q, qd, qdd) @ own
        np.testing.assert_allclose(ours[row], full[:6], atol=1e-9)


def test_derivatives_are_the_slopes_of_central_differences() -> None:
    geometry, step = arm_chain().geometry, 1e-6
    states = random_states(6, 4, np.random.default_rng(3))
    slopes = regressor_derivatives(geometry, *states)
    flat = np.concatenate(states, axis=1)
    for column in range(18):
        ends = []
        for sign in (1.0, -1.0):
            moved = flat.copy()
            moved[:, column] += sign * step
            ends.append(rigid_regressor(geometry, moved[:, :6], moved[:, 6:12], moved[:, 12:]))
        np.testing.assert_allclose(slopes[:, column], (ends[0] - ends[1]) / (2.0 * step), atol=1e-6)


def test_tool_and_head_are_part_of_the_last_link() -> None:
    engine = arm_model()
    masses = [engine.body(name).mass[0] for name in ("link_6", "tool_mount", "head")]
    assert arm_chain().parameters[5, 0] == pytest.approx(sum(masses))


@pytest.mark.parametrize(
    ("xml", "said"),
    [
        ('<body><joint name="ball" type="ball"/><geom size="0.1"/></body>', "joint 'ball' is a ball joint"),
        ('<body><freejoint name="adrift"/><geom size="0.1"/></body>', "joint 'adrift' is a free joint"),
        (
            '<body><joint name="a"/><geom size="0.1"/></body><body><joint name="b"/><geom size="0.1"/></body>',
            "branches at joint 'b'",
        ),
        ('<body><geom size="0.1"/></body>', "no joint"),
    ],
)
def test_what_is_no_serial_chain_is_refused_by_name(xml: str, said: str) -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{xml}</worldbody></mujoco>")
    with pytest.raises(InputError, match=said):
        read_chain(model)


def test_a_closed_loop_is_refused_by_name() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="x"><joint name="a"/><geom size="0.1"/></body></worldbody>'
        '<equality><connect name="ring" body1="x" anchor="0 0 1"/></equality></mujoco>'
    )
    with pytest.raises(InputError, match=r"ring.*closed loop"):
        read_chain(model)


def test_joints_tied_by_a_tendon_are_refused_by_name() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="a"/><geom size="0.1"/><body><joint name="b"/><geom size="0.1"/></body>'
        '</body></worldbody><tendon><fixed name="belt"><joint joint="a" coef="1"/><joint joint="b" coef="-1"/></fixed>'
        "</tendon></mujoco>"
    )
    with pytest.raises(InputError, match=r"tendon \(belt\) ties joint 'a'"):
        read_chain(model)


def test_an_unknown_joint_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match="elbow_joint"):
        read_chain(arm_model(), (*ARM, "knee"))
