"""Joint positions and speeds played on the simulated servos, nothing else: no contact, no control."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.engine import EngineViews, engine_views, mj_step1, mj_step2, register_engine
from polish_sim.cell.gears import RealArm, drive_joints, follow_rotors, hear_joints
from polish_sim.cell.real_arm import build_real_arm, built_table
from polish_sim.cell.scene import touching_at
from polish_sim.config import RobotConfig
from polish_sim.errors import ProtectiveStop, ReachError
from polish_sim.kernel_cache import njit
from polish_sim.motion.kinematics import NOMINAL

JOINTS = 6
LOOK_EVERY = 20  # rows between looks at links in contact
SETTLE_S = 0.5  # the robot stands before it plays [s]


class JointTargets(NamedTuple):
    """Servo set-points, one row a step."""

    q: Array  #: Positions [rad], shape (n, 6)
    qd: Array  #: Speeds [rad/s], shape (n, 6)


class PlayedBack(NamedTuple):
    """What the joints did, one row a step, at the moment its target is given."""

    q: Array  #: [rad], shape (n, 6)
    qd: Array  #: [rad/s], shape (n, 6)
    #: Of the servos [N m], shape (n, 6); with elastic joints the motors', the arm's weight included
    torque: Array
    motor: Array  #: Angles of the motors behind their gears [rad], shape (n, 6)
    read: Array  #: Angles by the encoders the servos use [rad], shape (n, 6)
    table: Array  #: Of the arm as built, shape (4, 6)


def play_joints(model: mujoco.MjModel, robot: RobotConfig, seed: int, targets: JointTargets) -> PlayedBack:
    """Play joint targets, from rest to rest and one row a step, on a scene's robot in free space, spindle at
    rest.

    The robot first stands at the first target for `SETTLE_S`, so that gravity has settled. Elastic joints
    are those of a ``seed``; the model becomes theirs.

    Raises:
        ReachError: Links or head would touch each other on the way.
        ProtectiveStop: The simulation ran away.
    """
    register_engine()
    data = mujoco.MjData(model)
    _refuse_touch(model, data, targets.q)
    data.qpos[:JOINTS] = targets.q[0]
    still = round(SETTLE_S / model.opt.timestep)
    wanted = JointTargets(*map(np.ascontiguousarray, targets))
    played = PlayedBack._make((*np.empty((5, *wanted.q.shape)), NOMINAL.copy()))
    arm = RealArm()
    if robot.elastic:
        played.table[:] = built_table(robot.real, seed, model, wanted.q[0])
        arm = build_real_arm(robot.real, seed, model, data, wanted.q[0])
    mujoco.mj_forward(model, data)
    _play(arm, engine_views(model, data), wanted, played, still)
    if not np.isfinite(played.q).all():
        raise ProtectiveStop(
            "the simulated robot ran away while playing joint targets: lower simulation.timestep_s."
        )
    return played


def _refuse_touch(model: mujoco.MjModel, data: mujoco.MjData, q: Array) -> None:
    """Look for links in contact along the way."""
    for joints in q[::LOOK_EVERY]:
        if pair := touching_at(model, data, joints):
            raise ReachError(f"the robot cannot do this path: {pair} would touch. Move it with --part-pose.")


@njit(_nrt=False)
def _play(arm: RealArm, e: EngineViews, targets: JointTargets, played: PlayedBack, still: int) -> None:
    for step in range(-still, len(targets.q)):
        row = max(step, 0)
        for j in range(JOINTS):
            e.ctrl[2 * j] = targets.q[row, j]
            e.ctrl[2 * j + 1] = targets.qd[row, j] if step >= 0 else 0.0
        mj_step1(e.model, e.data)
        if arm.elastic:
            hear_joints(arm, e)
        if step >= 0:
            for j in range(JOINTS):
                played.q[row, j], played.qd[row, j] = e.qpos[j], e.qvel[j]
                played.motor[row, j] = arm.angle[j] if arm.elastic else e.qpos[j]
                played.read[row, j] = arm.read[j] if arm.elastic else e.qpos[j]
        drive_joints(arm, e, (still + step) * e.dt)
        mj_step2(e.model, e.data)
        follow_rotors(arm, e)
        if step >= 0:
            for j in range(JOINTS):
                played.torque[row, j] = e.qfrc_actuator[j]
