"""Joints of both arms while one holds and moves the part and the other works on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from polish_sim.errors import ReachError
from polish_sim.motion.kinematics import JOINT_LIMITS, forward, nearest_solution, smallest_singular_values
from polish_sim.spatial import inverse, transform

# The chain two robots close over one part: flange poses from the part's pose and the tool's pose on it.
#
# master_T_flange1 = master_T_work (gripper_T_work)^-1 (flange1_T_gripper)^-1
# follower_T_flange2 = (master_T_follower)^-1 master_T_work work_T_tool (flange2_T_tool)^-1          (paper 2)

Array = NDArray[np.float64]


class Chain2(NamedTuple):
    """What does not move in the chain; each (4, 4)."""

    T_master_follower: Array
    """The follower's base in the master's, from base calibration."""
    T_flange_gripper: Array
    """The gripper on the master's flange, from tool calibration."""
    T_gripper_work: Array
    """The part in the gripper, from assembly."""
    T_flange_tool: Array
    """The tool on the follower's flange, from tool calibration."""


def master_flange(chain: Chain2, T_master_work: Array) -> Array:
    """Flange of the master that puts the part there, shape (..., 4, 4)."""
    return np.asarray(T_master_work @ inverse(chain.T_flange_gripper @ chain.T_gripper_work))


def follower_flange(chain: Chain2, T_master_work: Array, T_work_tool: Array) -> Array:
    """Flange of the follower, in its own base, that puts the tool there on the part, shape (..., 4, 4)."""
    return np.asarray(inverse(chain.T_master_follower) @ T_master_work @ T_work_tool @ inverse(chain.T_flange_tool))


def chain_residual(chain: Chain2, T_master_flange: Array, T_follower_flange: Array, T_work_tool: Array) -> Array:
    """How far the chain is from closing, in the axes of the tool as wanted.

    Args:
        chain: What does not move.
        T_master_flange: The master's flange in its base, shape (n, 4, 4).
        T_follower_flange: The follower's flange in its base, shape (n, 4, 4).
        T_work_tool: The tool as wanted on the part, shape (n, 4, 4).

    Returns:
        Displacement [m] and rotation vector [rad] of the tool as it is, shape (n, 6).
    """
    wanted = T_master_flange @ chain.T_flange_gripper @ chain.T_gripper_work @ T_work_tool
    is_now = chain.T_master_follower @ T_follower_flange @ chain.T_flange_tool
    off = inverse(wanted) @ is_now
    return np.concatenate([off[:, :3, 3], Rotation.from_matrix(off[:, :3, :3]).as_rotvec()], axis=1)


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
    off = chain_residual(chain, forward(q_master), forward(q_follower), T_work_tool)
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


# How a part is moved while it is worked on: a callable of time, from the pose it starts at.


class PartWay(NamedTuple):
    """A motion of a part: its origin goes along, and the part moves in its own frame. Smooth, C2 or better."""

    shift: Callable[[Array], Array]
    """Times (n,) [s] to how far its origin has gone, base of the robot that moves it [m], shape (n, 3)."""
    turn: Callable[[Array], Array]
    """Times (n,) [s] to how it has moved in its own frame, shape (n, 4, 4)."""
    lasts: float = math.inf
    """How long it goes on [s]."""

    def __call__(self, T_base_start: Array, times: Array) -> Array:
        """Poses of the part at times [s], (n, 4, 4), from that at time zero, (4, 4)."""
        poses = T_base_start @ self.turn(times)
        poses[:, :3, 3] += self.shift(times)
        return np.asarray(poses)


def along_arc(velocity: Array, bend: float) -> Callable[[Array], Array]:
    """Constant speed along a straight line, or along an arc about the base's z axis.

    Args:
        velocity: At time zero [m/s], shape (3,).
        bend: Rate at which its direction turns about z [rad/s]; 0: straight.
    """
    across = np.array([-velocity[1], velocity[0], 0.0])
    level = np.array([velocity[0], velocity[1], 0.0])

    def shift(times: Array) -> Array:
        half = 0.5 * bend * times
        ratio = np.sinc(half / math.pi)  # sin(half) / half
        along, aside = ratio * np.cos(half), ratio * np.sin(half)
        rise = np.array([0.0, 0.0, velocity[2]])
        return np.asarray(times[:, None] * (along[:, None] * level + aside[:, None] * across + rise))

    return shift


def about_axis(axis: Array, center: Array, rate: float) -> Callable[[Array], Array]:
    """A turn at constant rate about an axis of the part.

    Args:
        axis: Its unit direction, work frame, shape (3,).
        center: A point on it, work frame [m], shape (3,).
        rate: Right-handed [rad/s]; 0: the part keeps its orientation.
    """

    def turn(times: Array) -> Array:
        R = Rotation.from_rotvec(rate * times[:, None] * axis).as_matrix()
        return np.asarray(transform(R, center - R @ center))

    return turn


def through_poses(times: Array, poses: Array) -> PartWay:
    """Through poses at given times: position by a cubic spline, orientation by a rotation spline, both C2.

    Args:
        times: From zero, increasing [s], shape (n,), n at least 2.
        poses: Of the part, shape (n, 4, 4).
    """
    places = CubicSpline(times, poses[:, :3, 3] - poses[0, :3, 3])
    turned = RotationSpline(times, Rotation.from_matrix((inverse(poses[0]) @ poses)[:, :3, :3]))
    end = float(times[-1])

    def shift(t: Array) -> Array:
        return np.asarray(places(np.clip(t, 0.0, end)))

    def turn(t: Array) -> Array:
        return np.asarray(transform(turned(np.clip(t, 0.0, end)).as_matrix(), np.zeros(3)))

    return PartWay(shift, turn, end)


# From rest to rest along a quintic: speed and acceleration are zero at both ends.


class Progress(NamedTuple):
    """Share of a way done, and its derivatives by the share of the time."""

    share: Array
    speed: Array
    acceleration: Array


def rest_to_rest(time_share: Array) -> Progress:
    """10 x^3 - 15 x^4 + 6 x^5 and its derivatives.

    Args:
        time_share: Share of the time, 0 to 1, shape (k,).
    """
    x = np.clip(time_share, 0.0, 1.0)
    return Progress(
        x**3 * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * (1.0 - x) ** 2, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)
    )
