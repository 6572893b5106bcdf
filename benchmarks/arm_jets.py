"""The UR5e's tool and its first three time derivatives from joint angles and theirs, by the table alone.

For checks: no Jacobian, no inverse kinematics, nothing shared with the package but the published numbers. A
jet is a stack of a quantity and its derivatives, order first; products follow Leibniz.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TABLE = (
    (0.0, 0.1625, 90),
    (-0.425, 0.0, 0),
    (-0.3922, 0.0, 0),
    (0.0, 0.1333, 90),
    (0.0, 0.0997, -90),
    (0.0, 0.0996, 0),
)
"""a [m], d [m], alpha [deg] of the six joints, as published."""
_LEIBNIZ = ((1.0,), (1.0, 1.0), (1.0, 2.0, 1.0), (1.0, 3.0, 3.0, 1.0))


def tool_jet(q: Array, T_flange_tool: Array) -> Array:
    """Pose of the tool and its derivatives.

    Args:
        q: Joint angles and three derivatives [rad/s^k], shape (4, n, 6).
        T_flange_tool: Shape (4, 4).

    Returns:
        T_base_tool and its derivatives, shape (4, n, 4, 4).
    """
    pose = np.zeros((4, q.shape[1], 4, 4))
    pose[0] = np.eye(4)
    for joint, (a, d, alpha) in enumerate(TABLE):
        pose = _product(pose, _turn_z(q[:, :, joint]))
        pose = pose @ _link(a, d, alpha)
    return np.asarray(pose @ T_flange_tool)


def _product(left: Array, right: Array) -> Array:
    return np.stack([
        sum((weight * left[k] @ right[n - k] for k, weight in enumerate(_LEIBNIZ[n])), np.zeros_like(left[0]))
        for n in range(4)
    ])  # fmt: skip


def _turn_z(q: Array) -> Array:
    """Rotation about z by an angle's jet (4, n), as transforms (4, n, 4, 4)."""
    c, s = np.cos(q[0]), np.sin(q[0])
    first, second, third = q[1], q[2], q[3]
    sines = np.stack([
        s, c * first, c * second - s * first**2, c * third - 3.0 * s * first * second - c * first**3,
    ])  # fmt: skip
    cosines = np.stack([
        c, -s * first, -s * second - c * first**2, -s * third - 3.0 * c * first * second + s * first**3,
    ])  # fmt: skip
    T = np.zeros((*q.shape, 4, 4))
    T[..., 0, 0] = T[..., 1, 1] = cosines
    T[..., 1, 0], T[..., 0, 1] = sines, -sines
    T[0, ..., 2, 2] = T[0, ..., 3, 3] = 1.0
    return T


def _link(a: float, d: float, alpha: float) -> Array:
    c, s = np.cos(np.radians(alpha)), np.sin(np.radians(alpha))
    return np.array([[1.0, 0.0, 0.0, a], [0.0, c, -s, 0.0], [0.0, s, c, d], [0.0, 0.0, 0.0, 1.0]])
