"""Regressor and base parameters against the engine, Pinocchio and the papers' counts."""

import mujoco
import numpy as np
import pytest

from polish_sim.errors import InputError
from polish_sim.identification import regressor
from polish_sim.identification.estimate import base_names, base_of, base_of_rows, identifiable
from polish_sim.identification.robot_model import ARM_JOINTS, read_chain
from polish_sim.models import robot_model_path
from tests.identification.known import arm_chain, arm_model, inverse_dynamics, odd_model

TERMS = ("viscous", "armature")


@pytest.mark.parametrize(("engine", "joints"), [(arm_model(), ARM_JOINTS), (odd_model(), None)])
def test_torques_are_the_engines_also_of_slides_tilted_axes_and_two_joints_on_a_body(engine, joints):
    model = regressor.TorqueModel(read_chain(engine, joints), TERMS)
    states = regressor.random_states(model.joints, 200, np.random.default_rng(0))
    torque = model.torque(states, model.truth())
    assert np.abs(torque - inverse_dynamics(engine, *states)).max() <= 1e-10
    assert np.abs(torque).max() > 50.0


def test_the_regressor_is_pinocchios():
    pin = pytest.importorskip("pinocchio")
    theirs = pin.buildModelFromMJCF(str(robot_model_path()))
    assert theirs.nv == 7
    data, chain = theirs.createData(), arm_chain()
    states = regressor.random_states(6, 20, np.random.default_rng(2))
    # Pinocchio sees the head's slide as a seventh joint: standing still, it is part of link 6.
    own = np.array([theirs.inertias[k].toDynamicParameters() for k in range(1, 8)]).ravel()
    ours = regressor.rigid_regressor(chain.geometry, *states) @ chain.parameters.ravel()
    for row in range(20):
        q, qd, qdd = (np.append(part[row], 0.0) for part in states)
        full = pin.computeJointTorqueRegressor(theirs, data, q, qd, qdd) @ own
        np.testing.assert_allclose(ours[row], full[:6], atol=1e-9)


def test_derivatives_are_the_slopes_of_central_differences():
    geometry, step = arm_chain().geometry, 1e-6
    states = regressor.random_states(6, 4, np.random.default_rng(3))
    slopes = regressor.regressor_derivatives(geometry, *states)
    flat = np.concatenate(states, axis=1)
    for column in range(18):
        ends = []
        for sign in (1.0, -1.0):
            moved = flat.copy()
            moved[:, column] += sign * step
            ends.append(regressor.rigid_regressor(geometry, moved[:, :6], moved[:, 6:12], moved[:, 12:]))
        np.testing.assert_allclose(slopes[:, column], (ends[0] - ends[1]) / (2.0 * step), atol=1e-6)


LINK = '<geom size="0.1"/>'
HINGE = f'<body name="x"><joint name="a"/>{LINK}</body>'
PAIR = f'<worldbody><body><joint name="a"/>{LINK}<body><joint name="b"/>{LINK}</body></body></worldbody>'
RING = '<equality><connect name="ring" body1="x" anchor="0 0 1"/></equality>'
BELT = '<tendon><fixed name="belt"><joint joint="a" coef="1"/><joint joint="b" coef="-1"/></fixed></tendon>'


@pytest.mark.parametrize(
    ("xml", "said"),
    [
        (f'<worldbody><body><joint name="p" type="ball"/>{LINK}</body></worldbody>', "'p' is a ball joint"),
        (f'<worldbody>{HINGE}<body><joint name="b"/>{LINK}</body></worldbody>', "branches at joint 'b'"),
        (f"<worldbody><body>{LINK}</body></worldbody>", "no joint"),
        (f"<worldbody>{HINGE}</worldbody>{RING}", r"ring.*closed loop"),
        (PAIR + BELT, r"tendon \(belt\) ties joint 'a'"),
    ],
)
def test_what_is_no_serial_chain_is_refused_by_name(xml, said):
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    with pytest.raises(InputError, match=said):
        read_chain(model)
    with pytest.raises(InputError, match="elbow_joint"):  # the known ones
        read_chain(arm_model(), (*ARM_JOINTS, "knee"))


RNG = np.random.default_rng


@pytest.mark.parametrize(
    ("terms", "papers"),
    [((), 36), (("viscous", "coulomb", "armature"), 52), (("viscous", "coulomb", "armature", "offset"), 58)],
)
def test_the_rank_is_the_papers(terms, papers):
    assert base_of(regressor.TorqueModel(arm_chain(), terms)).rank == papers


RIGID = regressor.TorqueModel(arm_chain(), ())


def rank(rows: np.ndarray) -> int:
    """Number of base parameters of regressor rows (m, joints, columns)."""
    return base_of_rows(rows.reshape(-1, rows.shape[2])).rank


def test_poses_at_rest_tell_ten_numbers_and_three_axes_with_a_locked_wrist_fifteen():
    q = regressor.random_states(6, 100, RNG(1)).q
    assert rank(RIGID.regressor(regressor.States(q, 0.0 * q, 0.0 * q))) == 10
    states = regressor.random_states(6, 200, RNG(2))
    for part in states[1:]:
        part[:, 3:] = 0.0
    states.q[:, 3:] = (0.3, -1.1, 0.7)
    assert rank(RIGID.regressor(states)[:, :3]) == 15


def test_base_parameters_give_the_torques_of_all_and_a_change_along_the_null_space_none():
    model = regressor.TorqueModel(arm_chain())
    base, states = base_of(model), regressor.random_states(6, 50, RNG(4))
    torque = model.regressor(states)[:, :, base.columns] @ (base.combination @ model.truth())
    np.testing.assert_allclose(torque, model.torque(states, model.truth()), atol=1e-9)
    hidden = base.null_space() @ RNG(6).normal(size=model.columns - base.rank)
    assert np.abs(model.torque(states, hidden)).max() < 1e-8


def test_what_is_identifiable_is_said_parameter_by_parameter():
    model = regressor.TorqueModel(arm_chain(), ("viscous", "coulomb", "armature"))
    said = dict(zip(model.names, identifiable(base_of(model)), strict=True))
    assert (said["m1"], said["fc4"], said["Izz2"]) == ("no", "alone", "combined")
    names = base_names(base_of(model), model.names)
    assert any(name.startswith("Izz2 + ") for name in names)
