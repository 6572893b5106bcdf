"""The arm alone, elastic joints and no control loop: stepped, pulled at, and as a linear model."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numba import njit
from scipy.linalg import eig

from polish_sim.cell import build_scene
from polish_sim.cell.engine import engine_views, mj_step1, mj_step2, register_engine
from polish_sim.cell.gears import drive_joints, elastic_torque, follow_joints, hear_joints
from polish_sim.cell.real_arm import build_real_arm
from polish_sim.experiments import default_scenario
from polish_sim.kernels import Record, Vector6
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
FOLDED = np.array([1.1, -2.0, 2.3, -1.9, -1.57, 0.2])


class JointStep(Record):
    """What one step did to the joints."""

    angle: Vector6
    speed: Vector6
    twist: Vector6
    ratio: Vector6
    hysteresis: Vector6
    spring: Vector6
    q: Vector6
    qd: Vector6
    tool: Vector6  #: Position, then zeros


@njit(error_model="numpy")  # kept on disk it would not notice that the kernels it calls have changed
def _go(e, arm, steps, tool):  # type: ignore[no-untyped-def]
    for k in range(len(steps)):
        mj_step1(e.model, e.data)
        hear_joints(arm, e)
        row = steps[k]
        for j in range(6):
            row.angle[j], row.speed[j], row.twist[j] = arm.angle[j], arm.speed[j], arm.twist[j]
            row.ratio[j], row.hysteresis[j] = arm.ratio[j], arm.hysteresis[j]
            row.q[j], row.qd[j] = e.qpos[j], e.qvel[j]
        for i in range(3):
            row.tool[i] = e.site_xpos[tool, i]
        drive_joints(arm, e, 0.0)
        for j in range(6):
            row.spring[j] = arm.torque[j]
        mj_step2(e.model, e.data)
        follow_joints(arm, e)


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
    model = build_scene(scenario, None, None)
    if not gravity:
        model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.qpos[:6] = data.ctrl[0:12:2] = q
    arm = build_real_arm(scenario, model, data, q)
    mujoco.mj_forward(model, data)
    return Joints(model, data, arm, scenario.simulation.timestep_s)


def tangents(joints: Joints) -> Array:
    """Stiffness of each gear at its twist [N m/rad], by differences."""
    h, twist = 1e-7, joints.arm.twist
    return np.array([
        (elastic_torque(joints.arm, j, twist[j] + h) - elastic_torque(joints.arm, j, twist[j] - h)) / (2 * h)
        for j in range(6)
    ])  # fmt: skip


def poses(n: int) -> Array:
    rng = np.random.default_rng(3)
    low, high = [-3.0, -2.2, 0.3, -2.5, -2.4, -3.0], [3.0, -0.6, 2.2, -0.5, -0.7, 3.0]
    return rng.uniform(low, high, (n, 6))


def first_mode(joints: Joints) -> tuple[complex, Array]:
    """Slowest vibration of links, head and rotors around the pose, linear: eigenvalue [1/s] and complex shape
    (13,)."""
    model, arm, nv = joints.model, joints.arm, joints.model.nv
    M = np.zeros((nv + 6, nv + 6))
    links = np.zeros((nv, nv))
    mujoco.mj_fullM(model, joints.data, links)
    M[:nv, :nv], M[nv:, nv:] = links, np.diag(arm.inertia)
    K, D = np.zeros_like(M), np.zeros_like(M)
    for matrix, gear, servo in ((K, tangents(joints), arm.kp), (D, arm.coupling, arm.kv)):
        for j in range(6):
            matrix[np.ix_([j, nv + j], [j, nv + j])] += gear[j] * np.array([[1.0, -1.0], [-1.0, 1.0]])
            matrix[nv + j, nv + j] += servo[j]
    K[6, 6], D[6, 6] = model.jnt_stiffness[6], model.dof_damping[6]
    n = nv + 6
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    values, shapes = eig(A)
    slowest = min(np.flatnonzero(values.imag > 1.0), key=lambda k: values[k].imag)
    return complex(values[slowest]), shapes[:n, slowest]


# Energy: what gears and engine are given, store and lose.


class Balance(NamedTuple):
    """Energy of a motion of the joints [J]."""

    given: float  #: To the gears, by rotors and links
    stored: float  #: In the gears at the end, less that at the start
    damped: float  #: Lost in their dampers
    slid: float  #: Lost by hysteresis
    highest: float  #: The most they stored

    @property
    def left(self) -> float:
        """What the gears were given, less stored and lost."""
        return self.given - self.stored - self.damped - self.slid


def gear_balance(rows: np.ndarray, joints: Joints) -> Balance:
    """Balance over the steps ``rows`` of `Joints.go`."""
    arm, dt = joints.arm, joints.dt
    now, then = rows[:-1], rows[1:]
    damping = arm.coupling * (now["ratio"] * then["speed"] - then["qd"])
    # What a torque in a step does to the kinetic energy is its product with the mean of the speeds.
    turning = 0.5 * (now["qd"] + then["qd"])
    twisting = 0.5 * now["ratio"] * (now["speed"] + then["speed"]) - turning
    energy = [_stored(row, arm) for row in (rows[0], rows[-1], *rows[::10])]
    # What hysteresis takes in and does not hold.
    held = 0.5 * arm.rise / np.maximum(arm.lost_torque, 1e-9) * np.diff(rows["hysteresis"] ** 2, axis=0)
    slid = 0.5 * (now["hysteresis"] + then["hysteresis"]) * (then["twist"] - now["twist"]) - held
    return Balance(
        dt * np.sum((now["spring"] + damping) * twisting),
        energy[1] - energy[0],
        dt * np.sum(damping * twisting),
        np.sum(slid),
        max(energy),
    )


def _stored(row: np.void, arm) -> float:
    """Energy in the springs and, elastically, in the hysteresis [J]."""
    total = 0.0
    for j in range(6):
        size, (first, second) = abs(row["twist"][j]), arm.bends[j]
        edges = np.array([0.0, min(size, first), min(max(size, first), second), max(size, second)])
        knots = np.unique(edges[edges <= size])
        heights = [elastic_torque(arm, j, knot) for knot in knots]
        total += float(np.trapezoid(heights, knots))
        if arm.lost_torque[j] > 0.0:
            total += 0.5 * arm.rise / arm.lost_torque[j] * row["hysteresis"][j] ** 2
    return total


def vibrating(dt: float, *settings: str) -> tuple[np.ndarray, Joints]:
    """A stretched arm that was pulled down by 20 N and released, for a second."""
    little = "robot.real.damping_nm_s_rad=[5,5,5,1,1,1]"
    joints = joints_at(STRETCHED, REAL, *NO_FRICTION, little, *settings, f"simulation.timestep_s={dt}")
    joints.pull(np.array([0.0, 0.0, -20.0]))
    joints.go(1.0)
    joints.pull(np.zeros(3))
    return joints.go(1.0), joints
