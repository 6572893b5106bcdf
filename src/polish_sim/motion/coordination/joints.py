"""Joints of both arms while one holds and moves the part and the other works on it (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.errors import ReachError
from polish_sim.motion.coordination.closed_chain import Chain2, chain_residual, follower_flange, master_flange
from polish_sim.motion.inverse_kinematics import nearest_solution
from polish_sim.motion.kinematics import JOINT_LIMITS, forward_many, smallest_singular_values
from polish_sim.spatial import transform

Array = NDArray[np.float64]

COMFORTABLE = 0.5 * np.pi
"""Distance from its limits from which on a joint counts as free [rad]."""
SPINS = 24
"""Turns about the tool axis that are tried."""
_SAMPLES = 40


class CoordinatedJoints(NamedTuple):
    """Joint angles of both arms along a coordinated motion."""

    q_master: Array
    """[rad], shape (n, 6)."""
    q_follower: Array
    """[rad], shape (n, 6)."""
    residual: float
    """Largest distance [m] or angle [rad] by which the chain of the planned joints does not close."""
    least_singular: float
    """Smallest singular value of the follower's Jacobian at the tool point on the way [m, rad]."""


def plan_coordinated(
    chain: Chain2, T_master_work: Array, T_work_tool: Array, q_near: tuple[Array, Array], spin: float = 0.0
) -> CoordinatedJoints:
    """Joints of both arms for a motion of the part and of the tool on it.

    Args:
        chain: What does not move.
        T_master_work: Pose of the part in the master's base, shape (n, 4, 4).
        T_work_tool: Pose of the tool on the part, shape (n, 4, 4).
        q_near: Configurations of master and follower to start close to [rad], each (6,).
        spin: Turn about the tool's z axis, which the process leaves free [rad].

    Returns:
        The joints, continuous, and how well the chain closes.

    Raises:
        ReachError: An arm cannot follow; names the arm and the point.
    """
    T_work_tool = spun(T_work_tool, spin)
    q_master = follow_joints(master_flange(chain, T_master_work), q_near[0], "master")
    q_follower = follow_joints(follower_flange(chain, T_master_work, T_work_tool), q_near[1], "follower")
    off = chain_residual(chain, forward_many(q_master), forward_many(q_follower), T_work_tool)
    least = smallest_singular_values(q_follower, np.ascontiguousarray(chain.T_flange_tool[:3, 3]))
    return CoordinatedJoints(q_master, q_follower, float(np.abs(off).max()), float(least.min()))


def spun(T_work_tool: Array, spin: float) -> Array:
    """Poses turned about their own z axis [rad], shape (n, 4, 4)."""
    return np.asarray(T_work_tool @ transform(Rotation.from_euler("z", spin).as_matrix(), np.zeros(3)))


def follow_joints(T_base_flange: Array, q_near: Array, arm: str) -> Array:
    """Joints along flange poses, each close to the last and inside the limits.

    Args:
        T_base_flange: Poses, shape (n, 4, 4).
        q_near: Configuration to start close to [rad], shape (6,).
        arm: Its name, for the message.

    Returns:
        Joint angles [rad], shape (n, 6).

    Raises:
        ReachError: The arm cannot reach a pose.
    """
    joints = np.empty((len(T_base_flange), 6))
    q = np.asarray(q_near, dtype=np.float64)
    for k, T in enumerate(T_base_flange):
        q = nearest_solution(np.ascontiguousarray(T), q, True)
        if np.isnan(q).any():
            x, y, z = 1e3 * T[:3, 3]
            raise ReachError(
                f"the {arm} cannot bring its flange to point {k + 1} of {len(T_base_flange)}, ({x:.1f}, {y:.1f}, "
                f"{z:.1f}) mm in its base, with the wanted direction. Move the part, the other base, or turn the tool."
            )
        joints[k] = q
    return joints


def limit_margin(q: Array) -> float:
    """Least distance of any joint from its limits [rad] over configurations (n, 6); negative beyond them."""
    return float(np.minimum(q - JOINT_LIMITS[:, 0], JOINT_LIMITS[:, 1] - q).min())


def choose_spin(chain: Chain2, T_master_work: Array, T_work_tool: Array, q_near: Array) -> float:
    """The turn about the tool axis that keeps the follower furthest from singularities and joint limits all the way.

    Worth of a turn: the smallest singular value of the Jacobian, less in proportion where a joint comes within a
    quarter turn of its limits. With a tool in line with wrist 3 the turn moves that joint alone.

    Args:
        chain: What does not move.
        T_master_work: Pose of the part in the master's base, shape (n, 4, 4).
        T_work_tool: Pose of the tool on the part, shape (n, 4, 4).
        q_near: Configuration of the follower to start close to [rad], shape (6,).

    Returns:
        The spin [rad], one of 24.

    Raises:
        ReachError: The follower can follow with none of them.
    """
    rows = np.unique(np.linspace(0, len(T_work_tool) - 1, _SAMPLES).astype(int))
    tip = np.ascontiguousarray(chain.T_flange_tool[:3, 3])
    best, best_value, trouble = 0.0, -1.0, None
    for spin in 2.0 * np.pi * np.arange(SPINS) / SPINS:
        wanted = follower_flange(chain, T_master_work[rows], spun(T_work_tool[rows], float(spin)))
        try:
            q = follow_joints(wanted, q_near, "follower")
        except ReachError as error:
            trouble = error
            continue
        value = float(smallest_singular_values(q, tip).min()) * min(1.0, limit_margin(q) / COMFORTABLE)
        if value > best_value:
            best, best_value = float(spin), value
    if best_value < 0.0 and trouble is not None:
        raise trouble
    return best
