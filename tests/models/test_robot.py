"""The compiled UR5e model against the maker's figures, an independent dynamics library, closed forms."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from polish_sim.models import robot_model_path
from polish_sim.motion import JOINT_LIMITS, forward
from polish_sim.spatial import from_pose, transform
from tests.motion.test_kinematics import TABLE

# The UR5e as the manufacturer publishes it and the tool as models/README.md describes it, built in Pinocchio.

MASSES = [3.761, 8.058, 2.846, 1.37, 1.3, 0.365]
CENTRES = [
    (0.0, -0.02561, 0.00193), (0.2125, 0.0, 0.11336), (0.15, 0.0, 0.0265), (0.0, -0.0018, 0.01634),
    (0.0, 0.0018, 0.01634), (0.0, 0.0, -0.001159),
]  # fmt: skip
# ixx, iyy, izz, ixy, ixz, iyz at the centre of mass [kg m^2].
INERTIAS = [
    (0.00700210, 0.00648091, 0.00657286, 0.00000073, -0.00001053, 0.00049994),
    (0.01505885, 0.33388086, 0.33247207, -0.00005400, 0.00000563, -0.00000181),
    (0.00399632, 0.07879254, 0.07848510, -0.00001365, 0.00137272, -0.00000660),
    (0.00165491, 0.00135962, 0.00126279, -0.00000282, -0.00000438, 0.00010157),
    (0.00135617, 0.00127827, 0.00096614, -0.00000274, 0.00000444, -0.00005048),
    (0.00018694, 0.00018908, 0.00025756, 0.00000006, -0.00000017, -0.00000092),
]
TORQUE_LIMITS = [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]

# Solid cylinders along the tool axis: mass [kg], radius, both ends, distance from the axis along x [m].
TOOL_MOUNT = [
    (0.30, 0.040, 0.000, 0.040, 0.0), (0.15, 0.040, 0.040, 0.052, 0.0), (1.15, 0.032, 0.052, 0.160, 0.0),
    (0.10, 0.012, 0.060, 0.090, 0.040),
]  # fmt: skip
SLIDING_HEAD = [(0.18, 0.010, 0.110, 0.196, 0.0), (0.12, 0.025, 0.196, 0.220, 0.0)]


def cylinders(parts):
    """Inertia of solid cylinders along z, about the flange."""
    total = pin.Inertia.Zero()
    for mass, radius, first, second, x in parts:
        centre = pin.SE3(np.eye(3), np.array([x, 0.0, (first + second) / 2]))
        total += centre.act(pin.Inertia.FromCylinder(mass, radius, second - first))
    return total


def build_model():
    """Pinocchio model of the arm with the spindle and the sliding head (7 joints, the last the head's)."""
    model = pin.Model()
    parent, placement = 0, pin.SE3.Identity()
    for i, (a, d, alpha) in enumerate(TABLE):
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"joint_{i + 1}")
        placement = pin.SE3(pin.utils.rotate("x", np.radians(alpha)), np.array([a, 0.0, d]))
        xx, yy, zz, xy, xz, yz = INERTIAS[i]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        model.appendBodyToJoint(parent, pin.Inertia(MASSES[i], np.array(CENTRES[i]), inertia), placement)
    model.appendBodyToJoint(parent, cylinders(TOOL_MOUNT), placement)
    # The head slides against the tool axis: its joint frame is the flange turned half a turn about x.
    turned = placement * pin.SE3(pin.utils.rotate("x", np.pi), np.zeros(3))
    head = model.addJoint(parent, pin.JointModelPZ(), turned, "head")
    model.appendBodyToJoint(head, cylinders(SLIDING_HEAD), pin.SE3(pin.utils.rotate("x", np.pi), np.zeros(3)))
    return model


ARM, HEAD = slice(0, 6), 6


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_path(str(robot_model_path()))


def at_home(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    return data


def random_states(n, seed=0):
    """Joint positions and speeds of arm and head, each shape (n, 7)."""
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(-np.pi, np.pi, (n, 6)), rng.uniform(0.0, 0.03, n)])
    return q, np.column_stack([rng.uniform(-np.pi, np.pi, (n, 6)), rng.uniform(-0.1, 0.1, n)])


def site_pose(data, name):
    return transform(data.site(name).xmat.reshape(3, 3), data.site(name).xpos)


def test_flange_and_tool_are_where_the_dh_table_puts_them(model):
    """And the pad, pushed in by the head's joint, against the tool's axis."""
    data = mujoco.MjData(model)
    T_flange_tool = from_pose([0.0, 0.0, 0.22, 0.0, 0.0, 0.0])
    for q in random_states(40)[0]:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(site_pose(data, "flange"), forward(q[ARM]), atol=1e-9)
        np.testing.assert_allclose(site_pose(data, "sensor"), site_pose(data, "flange"), atol=1e-15)
        np.testing.assert_allclose(site_pose(data, "tool"), forward(q[ARM]) @ T_flange_tool, atol=1e-9)
        T_tool_pad = from_pose([0.0, 0.0, -q[HEAD], 0.0, 0.0, 0.0])
        np.testing.assert_allclose(site_pose(data, "pad"), site_pose(data, "tool") @ T_tool_pad, atol=1e-12)


def test_home_is_elbow_up_the_arm_carries_its_own_weight_alone_and_collides_where_it_is_folded(model):
    data = at_home(model)
    np.testing.assert_allclose(data.site("tool").xpos, [0.0, -0.5, 0.3], atol=1e-9)
    np.testing.assert_allclose(data.site("tool").xmat.reshape(3, 3)[:, 2], [0.0, 0.0, -1.0], atol=1e-9)
    assert data.body("link_2").xpos[2] > 0.5
    assert data.ncon == 0
    # The tool's is left to the servos.
    left_to_carry = data.qfrc_bias - data.qfrc_gravcomp
    J = np.zeros((3, model.nv))
    mount = model.body("tool_mount").id
    mujoco.mj_jac(model, data, J, None, data.xipos[mount], mount)
    np.testing.assert_allclose(left_to_carry, J.T @ [0, 0, 1.7 * 9.81], atol=1e-9)
    # Folded it collides; links that touch in the drawing and the pad do not.
    for q, collides in (([0, -1.2, 0, 0.3, 1.5, 0.2], False), ([0, -1.57, 2.9, 0.0, 1.57, 0.0], True)):
        data = mujoco.MjData(model)
        data.qpos[ARM] = q
        mujoco.mj_forward(model, data)
        assert (data.ncon > 0) == collides
    touching = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    assert not np.any(model.geom_bodyid[touching] == model.body("head").id)


def test_weight_velocity_torques_and_mass_matrix_agree_with_pinocchio_but_for_the_motors(model):
    data, reference, M = mujoco.MjData(model), build_model(), np.zeros((7, 7))
    reference_data = reference.createData()
    for q, qd in zip(*random_states(30), strict=True):
        for speed in (np.zeros(7), qd):
            data.qpos[:], data.qvel[:] = q, speed
            mujoco.mj_forward(model, data)
            expected = pin.nonLinearEffects(reference, reference_data, q, speed)
            np.testing.assert_allclose(data.qfrc_bias, expected, atol=1e-9)
        mujoco.mj_fullM(model, data, M)
        links = np.triu(pin.crba(reference, reference_data, q))
        links += np.triu(links, 1).T
        np.testing.assert_allclose(M - links, np.diag(model.dof_armature), atol=1e-9)


def test_limits_are_the_robots_and_the_heads_end_stops_hold_both_ways(model):
    np.testing.assert_allclose(model.jnt_range[ARM], JOINT_LIMITS)
    np.testing.assert_allclose(model.actuator_forcerange[:, 1], TORQUE_LIMITS)
    np.testing.assert_allclose(model.actuator_forcerange[:, 0], -np.array(TORQUE_LIMITS))
    for force, stop in ((220.0, 0.030), (-220.0, -0.001)):
        data = at_home(model)
        data.xfrc_applied[model.body("head").id, 2] = force
        mujoco.mj_step(model, data, 500)
        assert data.qpos[HEAD] == pytest.approx(stop, abs=1e-3)


def follow(model, joint, amplitude=0.05, frequency=0.5, seconds=2.0):
    """Swing one joint sinusoidally as commanded; how far the tool strays about its mean offset [m], (n,)."""
    data, errors, turning = at_home(model), [], 2.0 * np.pi * frequency
    home = data.qpos[ARM].copy()
    for i in range(round(seconds / model.opt.timestep)):
        phase = turning * i * model.opt.timestep
        q = home + amplitude * (1.0 - np.cos(phase)) * np.eye(6)[joint]
        data.ctrl[0::2], data.ctrl[1::2] = q, amplitude * turning * np.sin(phase) * np.eye(6)[joint]
        mujoco.mj_step1(model, data)
        errors.append(data.site("tool").xpos - (forward(q) @ [0, 0, 0.22, 1])[:3])
        mujoco.mj_step2(model, data)
    errors = np.array(errors)[500:]
    return np.linalg.norm(errors - errors.mean(axis=0), axis=1)


@pytest.mark.parametrize("joint", range(6))
def test_friction_at_reversals_costs_less_than_a_twentieth_of_a_millimetre_and_a_step_dies_out(model, joint):
    assert follow(model, joint).max() < 0.05e-3
    data = at_home(model)
    data.ctrl[2 * joint] = data.qpos[joint] + 1e-4
    speeds = []
    for _ in range(400):
        mujoco.mj_step(model, data)
        speeds.append(data.qvel[joint])
    assert np.abs(speeds[200:]).max() < 0.02 * np.abs(speeds).max()
