"""What identification takes from a MuJoCo model: its serial chain and clearances; and a load added to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import InputError
from polish_sim.exchange.log_sources import JOINT_NAMES
from polish_sim.identification.excitation import Clearance, ClearanceCheck
from polish_sim.motion.serial_chain import (
    HINGE,
    SLIDE,
    ChainGeometry,
    SerialChain,
    link_parameters,
)

ARM_JOINTS = tuple(f"{joint}_joint" for joint in JOINT_NAMES)
"""Joints of the shipped robot, from base to flange."""
_KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): HINGE, int(mujoco.mjtJoint.mjJNT_SLIDE): SLIDE}


def read_chain(model: mujoco.MjModel, joints: Sequence[str] | None = None) -> SerialChain:
    """Read a serial chain, its armature and friction from a compiled model; what is welded to a link counts
    as part of it.

    ``joints``: others are held where the model starts; None: all are the chain's. Raises InputError, naming
    the joint, if the chain branches or closes, or a joint is neither hinge nor slide.
    """
    chosen = _joint_ids(model, joints)
    _refuse_loops(model, chosen)
    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[chosen]] = 0.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    dofs = model.jnt_dofadr[chosen]
    return SerialChain(
        _geometry(model, data, chosen),
        _inertias(model, data, chosen, _owners(model, chosen)),
        model.dof_armature[dofs],
        model.dof_damping.reshape(model.nv, -1)[dofs, 0],
        model.dof_frictionloss[dofs],
        tuple(model.joint(j).name for j in chosen),
        model.jnt_pos[chosen],
    )


def own_parameters(model: mujoco.MjModel, joints: Sequence[str]) -> Array:
    """Ten parameters of each joint's own body, without what is welded to it or rides on it, shape (n, 10)."""
    chosen = _joint_ids(model, joints)
    own = [-1] * model.nbody
    for number, joint in enumerate(chosen):
        own[model.jnt_bodyid[joint]] = number
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return _inertias(model, data, chosen, own)


def _joint_ids(model: mujoco.MjModel, joints: Sequence[str] | None) -> list[int]:
    names = [model.joint(j).name for j in range(model.njnt)]
    missing = [name for name in joints or () if name not in names]
    if missing:
        raise InputError(f"the model has no joint '{missing[0]}'. Known: {', '.join(names)}.")
    chosen = [j for j in range(model.njnt) if joints is None or names[j] in joints]
    if not chosen:
        raise InputError("the model has no joint: there is nothing to identify.")
    for j in chosen:
        if not names[j]:
            raise InputError(
                f"joint {j + 1} of the model has no name: name every joint that is to be identified."
            )
        if model.jnt_type[j] not in _KINDS:
            kind = mujoco.mjtJoint(model.jnt_type[j]).name.removeprefix("mjJNT_").lower()
            raise InputError(
                f"joint '{names[j]}' is a {kind} joint: only hinges and slides can be identified."
            )
    return chosen


def _owners(model: mujoco.MjModel, chosen: Sequence[int]) -> list[int]:
    """For every body the number of the chain's last joint above it, -1 for what stands still."""
    owner = [-1] * model.nbody
    for body in range(1, model.nbody):
        owner[body] = owner[model.body_parentid[body]]
        for number, joint in enumerate(chosen):
            if model.jnt_bodyid[joint] == body:
                if owner[body] != number - 1:
                    raise InputError(
                        f"the chain branches at joint '{model.joint(joint).name}': only a serial chain can "
                        "be identified. Name the joints of one branch."
                    )
                owner[body] = number
    return owner


def _refuse_loops(model: mujoco.MjModel, chosen: Sequence[int]) -> None:
    for tendon in range(model.ntendon):
        first = model.tendon_adr[tendon]
        wraps = range(first, first + model.tendon_num[tendon])
        ties = [
            w
            for w in wraps
            if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT and model.wrap_objid[w] in chosen
        ]
        if ties:
            name = model.tendon(tendon).name or "without a name"
            joint = model.joint(int(model.wrap_objid[ties[0]])).name
            raise InputError(
                f"the tendon ({name}) ties joint '{joint}' to others: a chain with a closed loop cannot be "
                "identified."
            )
    if model.neq:
        name = model.equality(0).name or "without a name"
        raise InputError(
            f"the model has an equality constraint ({name}): a chain with a closed loop cannot be identified."
        )


def _geometry(model: mujoco.MjModel, data: mujoco.MjData, chosen: Sequence[int]) -> ChainGeometry:
    n = len(chosen)
    position = np.empty((n, 3))
    rotation = np.empty((n, 3, 3))
    axis = np.empty((n, 3))
    R_before, origin_before = np.eye(3), np.zeros(3)
    for i, joint in enumerate(chosen):
        R = data.xmat[model.jnt_bodyid[joint]].reshape(3, 3)
        origin = data.xanchor[joint]
        position[i] = R_before.T @ (origin - origin_before)
        rotation[i] = R_before.T @ R
        axis[i] = R.T @ data.xaxis[joint]
        R_before, origin_before = R, origin
    kind = np.array([_KINDS[model.jnt_type[j]] for j in chosen])
    return ChainGeometry(kind, position, rotation, axis, model.opt.gravity.copy())


def _inertias(
    model: mujoco.MjModel, data: mujoco.MjData, chosen: Sequence[int], owner: Sequence[int]
) -> Array:
    parameters = np.zeros((len(chosen), 10))
    for body in range(1, model.nbody):
        if owner[body] >= 0 and model.body_mass[body] > 0.0:
            joint = chosen[owner[body]]
            R = data.xmat[model.jnt_bodyid[joint]].reshape(3, 3)
            turn = R.T @ data.ximat[body].reshape(3, 3)
            center = R.T @ (data.xipos[body] - data.xanchor[joint])
            inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
            parameters[owner[body]] += link_parameters(model.body_mass[body], center, inertia)
    return parameters


# Distances of the robot from itself and from what stands around it, pose by pose.

FAR = 0.05  #: Larger distances count as this [m]
_TOUCH = 1e-9


def clearance_of(model: mujoco.MjModel, joints: int, also: Sequence[str] = ()) -> ClearanceCheck:
    """Distances between geoms of a model that could touch, and their derivatives by its first joints, at most
    `FAR`, where its slope is zero.

    ``also``: geoms that count although the engine lets them touch nothing, such as the head's pad. Joints
    beyond those stay where the model starts.
    """
    data, pairs = mujoco.MjData(model), _pairs(model, also)

    def measure(q: Array) -> Clearance:
        distance = np.full((len(q), len(pairs)), FAR)
        slope = np.zeros((*distance.shape, joints))
        ends = np.zeros(6)
        for row, pose in enumerate(q):
            data.qpos[:joints] = pose
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            for number, pair in enumerate(pairs):
                distance[row, number] = mujoco.mj_geomDistance(model, data, *pair, FAR, ends)
                way = ends[3:] - ends[:3]
                length = np.linalg.norm(way)
                if distance[row, number] < FAR and length >= _TOUCH:
                    J = np.zeros((2, 3, model.nv))
                    for jacobian, geom, point in zip(J, pair, (ends[:3], ends[3:]), strict=True):
                        mujoco.mj_jac(model, data, jacobian, None, point, int(model.geom_bodyid[geom]))
                    direction = way / length * np.sign(distance[row, number])
                    slope[row, number] = direction @ (J[1] - J[0])[:, :joints]
        return Clearance(distance, slope)

    return measure


def _pairs(model: mujoco.MjModel, also: Sequence[str]) -> list[tuple[int, int]]:
    """Pairs of geoms the engine would let touch: not on one body, not on neighbours, not excluded."""
    weld = model.body_weldid
    excluded = {(s >> 16, s & 0xFFFF) for s in model.exclude_signature}
    type_ = model.geom_contype.copy()
    affinity = model.geom_conaffinity.copy()
    for name in also:
        type_[model.geom(name).id] = 1
        affinity[model.geom(name).id] = 1
    pairs = []
    for one in range(model.ngeom):
        for two in range(one + 1, model.ngeom):
            meets = (type_[one] & affinity[two]) or (type_[two] & affinity[one])
            bodies = model.geom_bodyid[one], model.geom_bodyid[two]
            a, b = (weld[body] for body in bodies)
            next_to = 0 not in (a, b) and (
                a == weld[model.body_parentid[b]] or b == weld[model.body_parentid[a]]
            )
            if meets and a != b and not next_to and bodies not in excluded and bodies[::-1] not in excluded:
                pairs.append((one, two))
    return pairs


# A load bolted to the robot's last link, unknown to the host.


class CarriedLoad(NamedTuple):
    """A rigid body in the axes of the link it is bolted to."""

    mass: float  #: [kg]
    center: Array  #: From the body's origin [m], shape (3,)
    inertia: Array  #: About its centre [kg m^2], shape (3, 3)
