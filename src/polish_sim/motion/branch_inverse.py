"""Inverse kinematics on the branch a configuration is on: fast, for paths that never cross a singularity (layer 6).

The eight solutions differ in three signs: the side of the pan axis the wrist is on, and the signs of the elbow's and
of wrist 2's angle. A continuous motion changes a sign only at a singularity, so along a path one solution is enough.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.kinematics import DH_A, DH_D

Array = NDArray[np.float64]

_D1, _D4, _D5, _D6 = float(DH_D[0]), float(DH_D[3]), float(DH_D[4]), float(DH_D[5])
_A2, _A3 = float(DH_A[1]), float(DH_A[2])
_TURN = 2.0 * math.pi


@njit(cache=True, error_model="numpy", forceinline=True)
def _near(angle: float, reference: float) -> float:
    """The angle, full turns added, within half a turn of the reference."""
    return angle + _TURN * math.floor((reference - angle) / _TURN + 0.5)


@njit(cache=True, error_model="numpy")
def inverse_on_branch(T: Array, q_near: Array, q: Array) -> bool:
    """Joint angles that bring the flange to a pose, on the branch of a configuration (closed form).

    Args:
        T: T_base_flange, shape (4, 4).
        q_near: Configuration that says which branch, and which full turns [rad], shape (6,).
        q: Written: joint angles [rad], shape (6,); may be ``q_near`` itself.

    Returns:
        Whether the pose can be reached; ``q`` is untouched if not.
    """
    side = _A2 * math.cos(q_near[1]) + _A3 * math.cos(q_near[1] + q_near[2])
    side += _D5 * math.sin(q_near[1] + q_near[2] + q_near[3])
    # Pan: the wrist's centre seen from above is d4 beside the arm's plane.
    x, y, z = T[0, 3] - _D6 * T[0, 2], T[1, 3] - _D6 * T[1, 2], T[2, 3] - _D6 * T[2, 2]
    square = x * x + y * y
    if square < _D4 * _D4:
        return False
    out = math.copysign(math.sqrt(square - _D4 * _D4), side)
    c1, s1 = (out * x - _D4 * y) / square, (out * y + _D4 * x) / square
    # Wrist 2 and 3: the normal of the arm's plane seen from the flange is (s5 c6, -s5 s6, c5).
    nx = s1 * T[0, 0] - c1 * T[1, 0]
    ny = s1 * T[0, 1] - c1 * T[1, 1]
    c5 = s1 * T[0, 2] - c1 * T[1, 2]
    s5 = math.copysign(math.sqrt(nx * nx + ny * ny), math.sin(q_near[4]))
    if abs(s5) < 1e-12:
        c6, s6 = math.cos(q_near[5]), math.sin(q_near[5])
    else:
        c6, s6 = nx / s5, -ny / s5
    # What is left is a planar arm of two links.
    a, b = c5 * c6, c5 * s6
    ux = a * T[0, 0] - b * T[0, 1] - s5 * T[0, 2]
    uy = a * T[1, 0] - b * T[1, 1] - s5 * T[1, 2]
    uz = a * T[2, 0] - b * T[2, 1] - s5 * T[2, 2]
    q234 = math.atan2(uz, c1 * ux + s1 * uy)
    px = x + _D5 * (T[0, 0] * s6 + T[0, 1] * c6)
    py = y + _D5 * (T[1, 0] * s6 + T[1, 1] * c6)
    height = z + _D5 * (T[2, 0] * s6 + T[2, 1] * c6) - _D1
    radius = c1 * px + s1 * py
    c3 = (radius * radius + height * height - _A2 * _A2 - _A3 * _A3) / (2.0 * _A2 * _A3)
    if abs(c3) > 1.0:
        return False
    s3 = math.copysign(math.sqrt(1.0 - c3 * c3), math.sin(q_near[2]))
    q3 = math.atan2(s3, c3)
    q2 = math.atan2(height, radius) - math.atan2(_A3 * s3, _A2 + _A3 * c3)
    q[0] = _near(math.atan2(s1, c1), q_near[0])
    q[1] = _near(q2, q_near[1])
    q[2] = _near(q3, q_near[2])
    q[3] = _near(q234 - q2 - q3, q_near[3])
    q[4] = _near(math.atan2(s5, c5), q_near[4])
    q[5] = _near(math.atan2(s6, c6), q_near[5])
    return True
