"""Joint positions and speeds played on the simulated servos, nothing else: no contact, no control."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.engine import mj_step, register_engine
from polish_sim.cell.real_arm import require_ideal
from polish_sim.cell.scene import build_scene, touching
from polish_sim.config import Scenario
from polish_sim.errors import ProtectiveStop, ReachError
from polish_sim.kernel_cache import njit

JOINTS = 6
LOOK_EVERY = 20  # rows between looks at links in contact


class JointTargets(NamedTuple):
    """Servo set-points, one row a step."""

    q: Array  #: Positions [rad], shape (n, 6)
    qd: Array  #: Speeds [rad/s], shape (n, 6)


class Played(NamedTuple):
    """What the joints did, one row a step, at the moment its target is given."""

    q: Array  #: [rad], shape (n, 6)
    qd: Array  #: [rad/s], shape (n, 6)
    torque: Array  #: Of the servos [N m], shape (n, 6)


def play_joints(
    scenario: Scenario,
    targets: JointTargets,
    settle: float = 0.5,
    change: Callable[[mujoco.MjModel], None] | None = None,
) -> Played:
    """Play joint targets, from rest to rest and one row a step, on the robot of the cell in free space, spindle at
    rest.

    The robot first stands at the first target for ``settle`` [s], so that gravity has settled. ``change`` changes the
    compiled scene before, e.g. adds a load to its last link.

    Raises:
        ReachError: Links or head would touch each other on the way.
        ProtectiveStop: The simulation ran away.
    """
    require_ideal(scenario, "playing joint targets")
    register_engine()
    model = build_scene(scenario, None, None)
    if change is not None:
        change(model)
    data = mujoco.MjData(model)
    _refuse_touch(model, data, targets.q)
    data.qpos[:JOINTS] = targets.q[0]
    mujoco.mj_forward(model, data)
    n = len(targets.q)
    played = Played(np.empty((n, JOINTS)), np.empty((n, JOINTS)), np.empty((n, JOINTS)))
    still = round(settle / float(model.opt.timestep))
    _play(
        (model._address, data._address), data.qpos, data.qvel, data.qfrc_actuator, data.ctrl,
        (np.ascontiguousarray(targets.q), np.ascontiguousarray(targets.qd)), played, still,
    )  # fmt: skip
    if not np.isfinite(played.q).all():
        raise ProtectiveStop("the simulated robot ran away while playing joint targets: lower simulation.timestep_s.")
    return played


def _refuse_touch(model: mujoco.MjModel, data: mujoco.MjData, q: Array) -> None:
    """Look for links in contact along the way."""
    for joints in q[::LOOK_EVERY]:
        data.qpos[:JOINTS] = joints
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        if data.ncon:
            pair = touching(model, data)
            raise ReachError(f"the robot cannot do this path: {pair} would touch. Move it with --part-pose.")


@njit(cache=True, error_model="numpy")
def _play(  # type: ignore[no-untyped-def]
    engine, qpos: Array, qvel: Array, torques: Array, ctrl: Array, targets, played: Played, still: int
) -> None:
    model, data = engine
    q, qd = targets
    for step in range(-still, len(q)):
        row = max(step, 0)
        for j in range(JOINTS):
            ctrl[2 * j] = q[row, j]
            ctrl[2 * j + 1] = qd[row, j] if step >= 0 else 0.0
            if step >= 0:
                played.q[row, j], played.qd[row, j] = qpos[j], qvel[j]
        mj_step(model, data)
        if step >= 0:
            for j in range(JOINTS):
                played.torque[row, j] = torques[j]
