"""From a compiled model to the arrays of a serial chain; refuses what is none."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import InputError
from polish_sim.motion.serial_chain import HINGE, SLIDE, ChainGeometry, SerialChain, link_parameters

ARM_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
"""Of the shipped robot, from base to flange."""
_KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): HINGE, int(mujoco.mjtJoint.mjJNT_SLIDE): SLIDE}


def read_chain(model: mujoco.MjModel, joints: Sequence[str] | None = None) -> SerialChain:
    """Read a serial chain from a compiled model.

    Args:
        model: The model.
        joints: Names of the chain's joints; others are held where the model starts. All joints if None.

    Returns:
        Geometry, inertia (what is welded to a link counts as part of it), armature and friction.

    Raises:
        InputError: The chain branches or closes, or a joint is neither hinge nor slide; names the joint.
    """
    chosen = _joint_ids(model, joints)
    owner = _owners(model, chosen)
    _refuse_loops(model, chosen)
    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[chosen]] = 0.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    dofs = model.jnt_dofadr[chosen]
    return SerialChain(
        _geometry(model, data, chosen), _inertias(model, data, chosen, owner), model.dof_armature[dofs].copy(),
        model.dof_damping.reshape(model.nv, -1)[dofs, 0].copy(), model.dof_frictionloss[dofs].copy(),
        tuple(model.joint(j).name for j in chosen), tuple(model.body(model.jnt_bodyid[j]).name for j in chosen),
        model.jnt_pos[chosen].copy(),
    )  # fmt: skip


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
            raise InputError(f"joint {j + 1} of the model has no name: name every joint that is to be identified.")
        if int(model.jnt_type[j]) not in _KINDS:
            kind = mujoco.mjtJoint(model.jnt_type[j]).name.removeprefix("mjJNT_").lower()
            raise InputError(f"joint '{names[j]}' is a {kind} joint: only hinges and slides can be identified.")
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
                        f"the chain branches at joint '{model.joint(joint).name}': only a serial chain can be "
                        "identified. Name the joints of one branch."
                    )
                owner[body] = number
    return owner


def _refuse_loops(model: mujoco.MjModel, chosen: Sequence[int]) -> None:
    for tendon in range(model.ntendon):
        first = int(model.tendon_adr[tendon])
        wraps = range(first, first + int(model.tendon_num[tendon]))
        ties = [w for w in wraps if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT and model.wrap_objid[w] in chosen]
        if ties:
            name = model.tendon(tendon).name or "without a name"
            joint = model.joint(int(model.wrap_objid[ties[0]])).name
            raise InputError(
                f"the tendon ({name}) ties joint '{joint}' to others: a chain with a closed loop cannot be identified."
            )
    if model.neq:
        name = model.equality(0).name or "without a name"
        raise InputError(
            f"the model has an equality constraint ({name}): a chain with a closed loop cannot be identified."
        )


def _geometry(model: mujoco.MjModel, data: mujoco.MjData, chosen: Sequence[int]) -> ChainGeometry:
    n = len(chosen)
    position, rotation, axis = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3))
    R_before, origin_before = np.eye(3), np.zeros(3)
    for i, joint in enumerate(chosen):
        R = data.xmat[model.jnt_bodyid[joint]].reshape(3, 3).copy()
        origin = data.xanchor[joint].copy()
        position[i] = R_before.T @ (origin - origin_before)
        rotation[i] = R_before.T @ R
        axis[i] = R.T @ data.xaxis[joint]
        R_before, origin_before = R, origin
    kind = np.array([_KINDS[int(model.jnt_type[j])] for j in chosen])
    return ChainGeometry(kind, position, rotation, axis, model.opt.gravity.copy())


def _inertias(model: mujoco.MjModel, data: mujoco.MjData, chosen: Sequence[int], owner: Sequence[int]) -> Array:
    parameters = np.zeros((len(chosen), 10))
    for body in range(1, model.nbody):
        if owner[body] >= 0 and model.body_mass[body] > 0.0:
            joint = chosen[owner[body]]
            R = data.xmat[model.jnt_bodyid[joint]].reshape(3, 3)
            turn = R.T @ data.ximat[body].reshape(3, 3)
            center = R.T @ (data.xipos[body] - data.xanchor[joint])
            inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
            parameters[owner[body]] += link_parameters(float(model.body_mass[body]), center, inertia)
    return parameters
