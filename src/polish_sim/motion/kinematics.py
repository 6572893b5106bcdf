"""Forward kinematics and Jacobian of the UR5e: from joint angles to poses and velocities of the tool.

The arm is its table of standard Denavit-Hartenberg parameters, T_i = Rz(q_i) Tz(d_i) Tx(a_i) Rx(alpha_i), as the
manufacturer publishes them (source: ``models/README.md``). The flange frame is DH frame 6.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.errors import ReachError
from polish_sim.kernel_cache import njit
from polish_sim.spatial import inverse

Array = NDArray[np.float64]

DH_A = np.array([0.0, -0.425, -0.3922, 0.0, 0.0, 0.0])
"""Link lengths [m]."""
DH_D = np.array([0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996])
"""Link offsets [m]."""
DH_ALPHA = np.array([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0])
"""Link twists [rad]."""
JOINT_LIMITS = np.array([[-2.0, 2.0], [-2.0, 2.0], [-1.0, 1.0], [-2.0, 2.0], [-2.0, 2.0], [-2.0, 2.0]]) * np.pi
"""Lowest and highest joint angle [rad], shape (6, 2)."""
JOINT_SPEED_LIMIT = np.pi
"""Highest speed of every joint [rad/s]."""

# Exact sines and cosines of the twists: cos(pi/2) in floating point would tilt every axis by 6e-17.
_SIN_ALPHA = np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0])
_COS_ALPHA = np.array([0.0, 1.0, 1.0, 0.0, 0.0, 1.0])


@njit(cache=True)
def link_frames(q: Array) -> Array:
    """Poses of all DH frames in the base frame.

    Args:
        q: Joint angles [rad], shape (6,).

    Returns:
        Frames 0 (base) to 6 (flange), shape (7, 4, 4).
    """
    frames = np.zeros((7, 4, 4))
    frames[:, 3, 3] = 1.0
    for j in range(3):
        frames[0, j, j] = 1.0
    for i in range(6):
        c, s, ca, sa = np.cos(q[i]), np.sin(q[i]), _COS_ALPHA[i], _SIN_ALPHA[i]
        for j in range(3):
            x, y, z = frames[i, j, 0], frames[i, j, 1], frames[i, j, 2]
            x_turned, y_turned = c * x + s * y, c * y - s * x
            frames[i + 1, j, 0] = x_turned
            frames[i + 1, j, 1] = ca * y_turned + sa * z
            frames[i + 1, j, 2] = ca * z - sa * y_turned
            frames[i + 1, j, 3] = frames[i, j, 3] + DH_D[i] * z + DH_A[i] * x_turned
    return frames


@njit(cache=True)
def forward(q: Array) -> Array:
    """Pose of the flange in the base frame.

    Args:
        q: Joint angles [rad], shape (6,).

    Returns:
        T_base_flange, shape (4, 4).
    """
    T_base_flange: Array = link_frames(q)[6]
    return T_base_flange


@njit(cache=True)
def forward_many(q: Array) -> Array:
    """Poses of the flange for many joint configurations.

    Args:
        q: Joint angles [rad], shape (n, 6).

    Returns:
        T_base_flange, shape (n, 4, 4).
    """
    poses = np.empty((q.shape[0], 4, 4))
    for i in range(q.shape[0]):
        poses[i] = forward(q[i])
    return poses


@njit(cache=True)
def jacobian(q: Array, point_flange: Array) -> Array:
    """Geometric Jacobian of a point that moves with the flange.

    Args:
        q: Joint angles [rad], shape (6,).
        point_flange: The point in the flange frame [m], shape (3,).

    Returns:
        (6, 6) matrix that maps joint speeds [rad/s] to the point's velocity [m/s] (rows 0-2) and the flange's
        angular velocity [rad/s] (rows 3-5), both in the base frame.
    """
    frames = link_frames(q)
    J = np.empty((6, 6))
    arm = np.empty(3)
    for i in range(6):
        axis = frames[i, :3, 2]
        for j in range(3):
            point = frames[6, j, 3]
            for k in range(3):
                point += frames[6, j, k] * point_flange[k]
            arm[j] = point - frames[i, j, 3]
        J[0, i] = axis[1] * arm[2] - axis[2] * arm[1]
        J[1, i] = axis[2] * arm[0] - axis[0] * arm[2]
        J[2, i] = axis[0] * arm[1] - axis[1] * arm[0]
        J[3:, i] = axis
    return J


@njit(cache=True)
def jacobian_many(q: Array, point_flange: Array) -> Array:
    """The Jacobian of one point at many joint configurations.

    Args:
        q: Joint angles [rad], shape (n, 6).
        point_flange: The point in the flange frame [m], shape (3,).

    Returns:
        Jacobians as in `jacobian`, shape (n, 6, 6).
    """
    jacobians = np.empty((q.shape[0], 6, 6))
    for i in range(q.shape[0]):
        jacobians[i] = jacobian(q[i], point_flange)
    return jacobians


def smallest_singular_values(q: Array, point_flange: Array) -> Array:
    """Smallest singular value of the Jacobian, in its mixed units of metres and radians: 0 at a singularity.

    Args:
        q: Joint angles [rad], shape (n, 6).
        point_flange: The tool point in the flange frame [m], shape (3,).

    Returns:
        Singular values, shape (n,). A tool twist of size v can need joint speeds of v divided by it.
    """
    values = np.linalg.svd(jacobian_many(q, point_flange), compute_uv=False)[:, 5]
    return np.asarray(values, dtype=np.float64)


def manipulability(q: Array) -> Array:
    """Yoshikawa's measure |det J| [m^3], the same for every point of the flange; 0 at a singularity.

    Args:
        q: Joint angles [rad], shape (n, 6).

    Returns:
        The measure, shape (n,): |a2 a3 sin(q3) sin(q5)| times the distance of wrist 1's origin from the pan axis
        within the arm's plane.
    """
    return np.asarray(np.abs(np.linalg.det(jacobian_many(q, np.zeros(3)))), dtype=np.float64)


# An arm as built: standard Denavit-Hartenberg parameters that may differ from the nominal ones.
#
# A table is an array (4, 6): joint offsets [rad], d [m], a [m], alpha [rad];
# T_i = Rz(q_i + offset) Tz(d) Tx(a) Rx(alpha).

NOMINAL = np.stack([np.zeros(6), DH_D, DH_A, DH_ALPHA])
"""The UR5e's table, shape (4, 6)."""
NOMINAL.setflags(write=False)
CLOSE: Final = 1e-12
"""Flange poses are reached to this [m] and [rad]."""
_ROUNDS: Final = 10


def arm_frames(table: Array, q: Array) -> Array:
    """Poses of all DH frames in the base, base first.

    Args:
        table: The arm's table, shape (4, 6).
        q: Joint angles [rad], shape (n, 6).

    Returns:
        Shape (n, 7, 4, 4).
    """
    frames = np.empty((len(q), 7, 4, 4))
    frames[:, 0] = np.eye(4)
    for i in range(6):
        offset, d, a, alpha = table[:, i]
        c, s = np.cos(q[:, i] + offset), np.sin(q[:, i] + offset)
        ca, sa, zero, one = np.cos(alpha), np.sin(alpha), np.zeros(len(q)), np.ones(len(q))
        rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s]]
        rows += [[zero, sa * one, ca * one, d * one], [zero, zero, zero, one]]
        frames[:, i + 1] = frames[:, i] @ np.moveaxis(np.array(rows), 2, 0)
    return frames


def is_nominal(table: Array) -> bool:
    """Whether a table is the UR5e's own, number by number."""
    return bool(np.array_equal(table, NOMINAL))


def link_poses(table: Array) -> Array:
    """Pose of each link's frame in the one before with the joints at zero, shape (6, 4, 4)."""
    frames = arm_frames(table, np.zeros((1, 6)))[0]
    return np.asarray(inverse(frames[:6]) @ frames[1:])


def table_slopes(frames: Array, points: Array) -> Array:
    """Derivative of points that move with the flange by the table's 24 numbers, row by row of the table.

    Offset and d act along and about z of the frame before, a and alpha along and about x of the frame behind.

    Args:
        frames: As from `arm_frames`, in any common frame, shape (n, 7, 4, 4).
        points: The point in every pose, same frame [m], shape (n, 3).

    Returns:
        Shape (n, 3, 24).
    """
    z, x = frames[:, :6, :3, 2], frames[:, 1:, :3, 0]
    about_z = np.cross(z, points[:, None] - frames[:, :6, :3, 3])
    about_x = np.cross(x, points[:, None] - frames[:, 1:, :3, 3])
    return np.concatenate([about_z, z, x, about_x], axis=1).transpose(0, 2, 1)


def flange_poses(table: Array, q: Array) -> Array:
    """Where the flange of an arm is in its base.

    Args:
        table: The arm's table, shape (4, 6).
        q: Joint angles [rad], shape (n, 6).

    Returns:
        Shape (n, 4, 4).
    """
    return np.ascontiguousarray(arm_frames(table, q)[:, 6])


def reach_with_table(table: Array, T_base_flange: Array, q: Array) -> Array:
    """Joint angles that bring the flange of an arm there, from ones that almost do: Newton's method.

    The closed form knows the nominal table only. Of an arm half a millimetre off it, its solution is that close.

    Args:
        table: The arm's table, shape (4, 6).
        T_base_flange: Wanted poses, shape (n, 4, 4).
        q: Where to start, of the configuration wanted [rad], shape (n, 6).

    Returns:
        Joint angles [rad], shape (n, 6).

    Raises:
        ReachError: A pose is not reached: near a singularity, or the start was not close.
    """
    q = q.copy()
    for _ in range(_ROUNDS):
        frames = arm_frames(table, q)
        off = _pose_errors(frames[:, 6], T_base_flange)
        if np.abs(off).max() < CLOSE:
            return q
        z, arms = frames[:, :6, :3, 2], frames[:, 6, None, :3, 3] - frames[:, :6, :3, 3]
        J = np.concatenate([np.cross(z, arms), z], axis=2).transpose(0, 2, 1)
        q += (np.linalg.pinv(J) @ off[:, :, None])[:, :, 0]
    worst = int(np.abs(off).max(axis=1).argmax())
    raise ReachError(
        f"an arm with this table cannot bring its flange to pose {worst + 1} of {len(q)}: "
        f"{np.abs(off[worst]).max():.1g} m or rad are left. It is near a singularity: move the part or turn the tool."
    )


def _pose_errors(T: Array, T_wanted: Array) -> Array:
    """Displacement [m] and rotation vector [rad] from poses (n, 4, 4) to others, base axes, shape (n, 6)."""
    turn = Rotation.from_matrix(T_wanted[:, :3, :3] @ T[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    return np.concatenate([T_wanted[:, :3, 3] - T[:, :3, 3], turn], axis=1)
