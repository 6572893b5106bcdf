"""Joint positions and speeds played on the simulated servos, nothing else: no contact, no control."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.engine import mj_step, register_engine
from polish_sim.cell.scene import build_scene
from polish_sim.config import Scenario
from polish_sim.errors import ProtectiveStop, ReachError
from polish_sim.kernel_cache import njit

# How far the robot is from itself and what stands around it, asked of MuJoCo pose by pose.


FAR: Final = 0.05
"""Distances are not told beyond this [m]."""
_TOUCH: Final = 1e-9


class RobotClearance:
    """Distances between geoms that could touch, and their derivatives by the joints."""

    def __init__(self, model: mujoco.MjModel, joints: int, also: Sequence[str] = ()) -> None:
        """Prepare for a model.

        Args:
            model: The scene.
            joints: How many joints, the first ones, the poses name.
            also: Geoms that count although the engine lets them touch nothing, such as the head's pad.
        """
        self._model, self._data, self._joints = model, mujoco.MjData(model), joints
        self._pairs = _pairs(model, also)

    def measure(self, q: Array) -> tuple[Array, Array]:
        """Clearance of poses.

        Args:
            q: Joint positions [rad], shape (m, n); joints beyond n stay where the model starts.

        Returns:
            Distance of each pair of geoms [m], at most `FAR`, shape (m, pairs), and its derivatives [m/rad], shape
            (m, pairs, n), zero where it is far.
        """
        shape = (len(q), len(self._pairs))
        distance, slope, ends = np.full(shape, FAR), np.zeros((*shape, self._joints)), np.empty(6)
        for row, pose in enumerate(q):
            self._data.qpos[: self._joints] = pose
            mujoco.mj_kinematics(self._model, self._data)
            near = []
            for number, pair in enumerate(self._pairs):
                distance[row, number] = mujoco.mj_geomDistance(self._model, self._data, *pair, FAR, ends)
                if distance[row, number] < FAR:
                    near.append((number, ends.copy()))
            if near:
                mujoco.mj_comPos(self._model, self._data)
            for number, points in near:
                slope[row, number] = self._slope(distance[row, number], points, self._pairs[number])
        return distance, slope

    def _slope(self, distance: float, ends: Array, pair: tuple[int, int]) -> Array:
        way = ends[3:] - ends[:3]
        length = float(np.linalg.norm(way))
        if length < _TOUCH:
            return np.zeros(self._joints)
        jacobians = []
        for geom, point in zip(pair, (ends[:3], ends[3:]), strict=True):
            J = np.zeros((3, self._model.nv))
            mujoco.mj_jac(self._model, self._data, J, None, point, int(self._model.geom_bodyid[geom]))
            jacobians.append(J)
        direction = way / length * np.sign(distance)
        return np.asarray(direction @ (jacobians[1] - jacobians[0])[:, : self._joints])


def _pairs(model: mujoco.MjModel, also: Sequence[str]) -> list[tuple[int, int]]:
    """Pairs of geoms the engine would let touch: not on one body, not on neighbours, not excluded."""
    weld, parent = model.body_weldid, model.body_parentid
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    type_, affinity = model.geom_contype.copy(), model.geom_conaffinity.copy()
    for name in also:
        type_[model.geom(name).id], affinity[model.geom(name).id] = 1, 1
    pairs = []
    for one in range(model.ngeom):
        for two in range(one + 1, model.ngeom):
            meets = (type_[one] & affinity[two]) or (type_[two] & affinity[one])
            bodies = (int(model.geom_bodyid[one]), int(model.geom_bodyid[two]))
            a, b = (int(weld[body]) for body in bodies)
            next_to = 0 not in (a, b) and (a == weld[parent[b]] or b == weld[parent[a]])
            if meets and a != b and not next_to and bodies not in excluded and bodies[::-1] not in excluded:
                pairs.append((one, two))
    return pairs


# A load bolted to the robot's tool, which no host is told of.


class CarriedLoad(NamedTuple):
    """A rigid body in the axes of the link it is bolted to."""

    mass: float
    """[kg]."""
    center: Array
    """From the body's origin [m], shape (3,)."""
    inertia: Array
    """About its centre [kg m^2], shape (3, 3)."""


def carry(model: mujoco.MjModel, body: str, load: CarriedLoad) -> None:
    """Make a load part of a body of a compiled model.

    Args:
        model: The model, changed in place.
        body: The body it is bolted to.
        load: The load.
    """
    number = model.body(body).id
    mass, center = float(model.body_mass[number]), model.body_ipos[number].copy()
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[number])
    R = turn.reshape(3, 3)
    together = mass + load.mass
    middle = (mass * center + load.mass * load.center) / together
    inertia = _about(middle, mass, center, R @ np.diag(model.body_inertia[number]) @ R.T)
    inertia += _about(middle, load.mass, load.center, load.inertia)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(axes).ravel())
    model.body_mass[number], model.body_ipos[number] = together, middle
    model.body_inertia[number], model.body_iquat[number] = moments, quaternion
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _about(point: Array, mass: float, center: Array, inertia: Array) -> Array:
    """Inertia about a point of a body whose inertia about its centre is given."""
    arm = center - point
    return np.asarray(inertia + mass * (float(arm @ arm) * np.eye(3) - np.outer(arm, arm)))


JOINTS = 6
LAST_LINK = "link_6"
LOOK_EVERY = 20  # rows between looks at links in contact


class JointTargets(NamedTuple):
    """What the servos are told, one row a step."""

    q: Array
    """Positions [rad], shape (n, 6)."""
    qd: Array
    """Speeds [rad/s], shape (n, 6)."""


class Played(NamedTuple):
    """What the joints did, one row a step, at the moment its target is given."""

    q: Array
    """[rad], shape (n, 6)."""
    qd: Array
    """[rad/s], shape (n, 6)."""
    torque: Array
    """Of the servos [N m], shape (n, 6)."""


def play_joints(
    scenario: Scenario, targets: JointTargets, settle: float = 0.5, load: CarriedLoad | None = None
) -> Played:
    """Play joint targets on the robot of the cell, in free space, spindle at rest.

    Args:
        scenario: Robot, head and time step; a row of the targets is one step.
        targets: From rest to rest, free of jumps.
        settle: The robot stands at the first target this long before [s], so that gravity has settled.
        load: What is bolted to its last link.

    Returns:
        What the joints did.

    Raises:
        ReachError: Links or head would touch each other on the way.
        ProtectiveStop: The simulation ran away.
    """
    register_engine()
    model = build_scene(scenario, None, None)
    if load is not None:
        carry(model, LAST_LINK, load)
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
            pair = " and ".join(model.geom(int(g)).name for g in data.contact[0].geom)
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
