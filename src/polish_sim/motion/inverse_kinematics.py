"""Inverse kinematics of the UR5e in closed form: from a flange pose to joint angles.

Three pairs of choices give up to eight solutions: the shoulder left or right of the wrist, the wrist turned one way
or the other, the elbow up or down. Every joint angle is taken from an atan2 of two exact terms, not from an acos,
so that accuracy holds near the singularities.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import ReachError
from polish_sim.kernel_cache import njit
from polish_sim.motion.kinematics import DH_A, DH_D, JOINT_LIMITS

Array = NDArray[np.float64]

_REACH_SLACK = 1e-9
"""How far a squared sine may be negative by rounding before a pose counts as out of reach [-]."""
_WRIST_ALIGNED = 1e-9
"""Sine of wrist 2 below which wrist 1 and wrist 3 turn about one line, so that only their sum is given [-]."""


@njit(cache=True)
def _pan_angles(x: float, y: float) -> tuple[float, float]:
    """Both pan angles that put the wrist centre (x, y) at distance d4 from the arm's plane, NaN if too close."""
    along = x * x + y * y - DH_D[3] ** 2
    if along < -_REACH_SLACK:
        return np.nan, np.nan
    bearing, offset = np.arctan2(y, x), np.arctan2(np.sqrt(max(along, 0.0)), DH_D[3])
    return bearing + offset + np.pi / 2, bearing - offset + np.pi / 2


@njit(cache=True)
def _fill_elbow_pair(x: float, y: float, q234: float, solutions: Array) -> None:
    """Write joints 2-4 of both elbow solutions that reach the wrist centre (x, y) [m] in the arm's plane."""
    a2, a3 = DH_A[1], DH_A[2]
    cos_elbow = (x * x + y * y - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
    sine_squared = 1.0 - cos_elbow * cos_elbow
    if sine_squared < -_REACH_SLACK:
        solutions[:] = np.nan
        return
    for branch in range(2):
        sin_elbow = np.sqrt(max(sine_squared, 0.0)) * (1.0 - 2.0 * branch)
        q3 = np.arctan2(sin_elbow, cos_elbow)
        q2 = np.arctan2(y, x) - np.arctan2(a3 * sin_elbow, a2 + a3 * cos_elbow)
        solutions[branch, 1], solutions[branch, 2], solutions[branch, 3] = q2, q3, q234 - q2 - q3


@njit(cache=True)
def inverse_all(T_base_flange: Array, q6_if_aligned: float = 0.0) -> Array:
    """All joint angles that bring the flange to a pose.

    Args:
        T_base_flange: Wanted pose, shape (4, 4).
        q6_if_aligned: Angle of wrist 3 where the pose leaves it free (wrist 2 at 0 or 180 deg) [rad].

    Returns:
        Joint angles in [-pi, pi], shape (8, 6); rows of solutions that do not exist are NaN. Rows 0-3 and 4-7 have
        the two pan angles, within them rows 0-1 and 2-3 the two signs of wrist 2, even and odd rows those of the elbow.
    """
    solutions = np.full((8, 6), np.nan)
    R = T_base_flange[:3, :3]
    wrist = T_base_flange[:3, 3] - DH_D[5] * R[:, 2]
    pans = _pan_angles(wrist[0], wrist[1])
    for row in range(0, 8, 2):
        q1 = pans[row // 4]
        if np.isnan(q1):
            continue
        # The arm plane's normal seen from the flange is (s5 c6, -s5 s6, c5).
        normal = np.sin(q1) * R[0] - np.cos(q1) * R[1]
        sign = 1.0 - (row % 4)
        sin_5 = sign * np.hypot(normal[0], normal[1])
        q5 = np.arctan2(sin_5, normal[2])
        q6 = q6_if_aligned if abs(sin_5) < _WRIST_ALIGNED else np.arctan2(-normal[1] * sign, normal[0] * sign)
        # Wrist 2's axis and the x axis of frame 4, seen from the flange, leave a planar arm with two links.
        c5, s5, c6, s6 = np.cos(q5), np.sin(q5), np.cos(q6), np.sin(q6)
        x_4 = R[:, 0] * (c5 * c6) - R[:, 1] * (c5 * s6) - R[:, 2] * s5
        p_4 = wrist + DH_D[4] * (R[:, 0] * s6 + R[:, 1] * c6)
        q234 = np.arctan2(x_4[2], np.cos(q1) * x_4[0] + np.sin(q1) * x_4[1])
        radius = np.cos(q1) * p_4[0] + np.sin(q1) * p_4[1]
        _fill_elbow_pair(radius, p_4[2] - DH_D[0], q234, solutions[row : row + 2])
        solutions[row : row + 2, 0] = q1
        solutions[row : row + 2, 4] = q5
        solutions[row : row + 2, 5] = q6
        if np.isnan(solutions[row, 1]):
            solutions[row : row + 2] = np.nan
    return solutions - 2.0 * np.pi * np.round(solutions / (2.0 * np.pi))


@njit(cache=True)
def wrap_near(q: Array, q_near: Array) -> Array:
    """Add full turns to joint angles so that each is within half a turn of its reference.

    Args:
        q: Joint angles [rad], shape (6,).
        q_near: Reference [rad], shape (6,).

    Returns:
        The same configuration, shape (6,).
    """
    return q + 2.0 * np.pi * np.round((q_near - q) / (2.0 * np.pi))


@njit(cache=True)
def _into_limits(q: Array) -> Array:
    """The same configuration with each joint turned into its limits by full turns; NaN where none fits."""
    turned = q.copy()
    for j in range(6):
        if turned[j] > JOINT_LIMITS[j, 1]:
            turned[j] -= 2.0 * np.pi * np.ceil((turned[j] - JOINT_LIMITS[j, 1]) / (2.0 * np.pi))
        if turned[j] < JOINT_LIMITS[j, 0]:
            turned[j] += 2.0 * np.pi * np.ceil((JOINT_LIMITS[j, 0] - turned[j]) / (2.0 * np.pi))
        if turned[j] > JOINT_LIMITS[j, 1]:
            turned[j] = np.nan
    return turned


@njit(cache=True)
def nearest_solution(T_base_flange: Array, q_near: Array, within_limits: bool) -> Array:
    """The solution closest to a configuration, in the sum of squared joint differences.

    Args:
        T_base_flange: Wanted pose, shape (4, 4).
        q_near: Configuration to stay close to [rad], shape (6,).
        within_limits: Whether only configurations inside the joint limits count.

    Returns:
        Joint angles [rad], shape (6,); NaN if there is no solution.
    """
    best, best_distance = np.full(6, np.nan), np.inf
    solutions = inverse_all(T_base_flange, q_near[5])
    for row in range(8):
        candidate = wrap_near(solutions[row], q_near)
        if within_limits:
            candidate = _into_limits(candidate)
        distance = np.sum((candidate - q_near) ** 2)
        if distance < best_distance:
            best, best_distance = candidate, distance
    return best


def inverse_near(T_base_flange: Array, q_near: Array) -> Array:
    """Joint angles inside the limits that bring the flange to a pose, closest to a configuration.

    Args:
        T_base_flange: Wanted pose, shape (4, 4).
        q_near: Configuration to stay close to [rad], shape (6,).

    Returns:
        Joint angles [rad], shape (6,).

    Raises:
        ReachError: The flange cannot be brought there.
    """
    q = nearest_solution(np.ascontiguousarray(T_base_flange, dtype=float), np.asarray(q_near, dtype=float), True)
    if np.isnan(q).any():
        x, y, z = 1e3 * np.asarray(T_base_flange)[:3, 3]
        raise ReachError(
            f"the UR5e cannot bring its flange to ({x:.1f}, {y:.1f}, {z:.1f}) mm in the base frame with the wanted "
            f"direction: it reaches 850 mm from the shoulder and not closer than 133 mm to its own axis. "
            f"Move the part or turn the tool."
        )
    return q


# Inverse kinematics on the branch a configuration is on: fast, for paths that never cross a singularity.
#
# The eight solutions differ in three signs: the side of the pan axis the wrist is on, and the signs of the elbow's and
# of wrist 2's angle. A continuous motion changes a sign only at a singularity, so along a path one solution is enough.

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
