"""The arm alone, elastic joints and no control loop: stepped, pulled at, and as a linear model."""

from typing import NamedTuple

import mujoco
import numpy as np
from numba import njit
from scipy.linalg import eig

from polish_sim.cell import build_scene
from polish_sim.cell.engine import engine_views, mj_step1, mj_step2, register_engine
from polish_sim.cell.gears import drive_joints, elastic_torque, follow_rotors, hear_joints
from polish_sim.cell.real_arm import build_real_arm
from polish_sim.experiments import default_scenario
from polish_sim.kernels import Record, Vector3, Vector6
from polish_sim.scenario_file import override
from tests.cell.cells import Array

NONE = "[0,0,0,0,0,0]"
REAL = "robot.arm=ur5e"
NO_FRICTION = [
    f"robot.real.viscous_nm_s_rad={NONE}", f"robot.real.coulomb_nm={NONE}", "robot.real.coulomb_driving=0",
    "robot.real.coulomb_driven=0",
]  # fmt: skip
NO_HYSTERESIS = f"robot.real.lost_motion_rad={NONE}"
SPRINGS_ONLY = [
    REAL, *NO_FRICTION, NO_HYSTERESIS, f"robot.real.gear_error_rad={NONE}", "robot.real.encoder_rad=0",
    "robot.real.kinematics=exact", "robot.real.servo_lag_s=0",
]  # fmt: skip
STRETCHED = np.array([0.3, -0.35, 0.5, -1.7, -1.57, 0.4])
HOME = np.array([1.3, -1.59, 1.51, -1.49, -1.57, -0.27])


class JointStep(Record):
    twist: Vector6
    q: Vector6
    tool: Vector3


@njit(error_model="numpy")  # kept on disk it would not notice that the kernels it calls have changed
def _go(e, arm, steps, tool):  # type: ignore[no-untyped-def]
    for k in range(len(steps)):
        mj_step1(e.model, e.data)
        hear_joints(arm, e)
        row = steps[k]
        for j in range(6):
            row.twist[j], row.q[j] = arm.twist[j], e.qpos[j]
        for i in range(3):
            row.tool[i] = e.site_xpos[tool, i]
        drive_joints(arm, e, 0.0)
        mj_step2(e.model, e.data)
        follow_rotors(arm, e)


class Joints(NamedTuple):
    """The arm alone, no control loop: its servos hold where it starts."""

    model: mujoco.MjModel
    data: mujoco.MjData
    arm: object
    dt: float

    def go(self, seconds: float) -> np.ndarray:
        """Step on; what happened, one row a step."""
        rows = np.zeros(round(seconds / self.dt), JointStep.dtype)
        e, tool = engine_views(self.model, self.data), self.model.site("tool").id
        _go(e, self.arm, rows.view(np.recarray), tool)
        return rows

    def pull(self, force: Array) -> None:
        """Pull at the tool point by a force in the base frame [N]."""
        mount, tool = self.model.body("tool_mount").id, self.data.site("tool").xpos
        self.data.xfrc_applied[mount, :3] = force
        self.data.xfrc_applied[mount, 3:] = np.cross(tool - self.data.xipos[mount], force)

    def jacobian(self) -> Array:
        """Of the tool point, shape (3, 6)."""
        J = np.zeros((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, J, None, self.model.site("tool").id)
        return J[:, :6]


def joints_at(q: Array, *settings: str, gravity: bool = True) -> Joints:
    register_engine()
    scenario = override(default_scenario("arc"), [REAL, *settings])
    model = build_scene(scenario)
    if not gravity:
        model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.qpos[:6] = data.ctrl[0:12:2] = q
    arm = build_real_arm(scenario.robot.real, scenario.seed, model, data, q)
    mujoco.mj_forward(model, data)
    return Joints(model, data, arm, scenario.simulation.timestep_s)


def tangents(joints: Joints) -> Array:
    """Stiffness of each gear at its twist [N m/rad], by differences."""
    h, twist, found = 1e-7, joints.arm.twist, []
    for j in range(6):
        high, low = (elastic_torque(joints.arm, j, twist[j] + step) for step in (h, -h))
        found.append((high - low) / (2.0 * h))
    return np.array(found)


def first_mode(joints: Joints) -> tuple[complex, Array]:
    """Slowest linear vibration of links, head and rotors at the pose: eigenvalue [1/s] and shape (13,)."""
    model, arm, nv, n = joints.model, joints.arm, joints.model.nv, joints.model.nv + 6
    M, K, D, links = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((nv, nv))
    mujoco.mj_fullM(model, joints.data, links)
    M[:nv, :nv], M[nv:, nv:] = links, np.diag(arm.inertia)
    for matrix, gear, servo in ((K, tangents(joints), arm.kp), (D, arm.coupling, arm.kv)):
        for j in range(6):
            matrix[np.ix_([j, nv + j], [j, nv + j])] += gear[j] * np.array([[1.0, -1.0], [-1.0, 1.0]])
            matrix[nv + j, nv + j] += servo[j]
    K[6, 6], D[6, 6] = model.jnt_stiffness[6], model.dof_damping[6]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    values, shapes = eig(A)
    slowest = min(np.flatnonzero(values.imag > 1.0), key=lambda k: values[k].imag)
    return complex(values[slowest]), shapes[:n, slowest]
