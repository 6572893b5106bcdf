"""Forward kinematics and Jacobian of the UR5e against the manufacturer's table and finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.motion import forward, jacobian, link_frames, smallest_singular_values

# a [m], d [m], alpha [deg] as published.
TABLE = [
    (0.0, 0.1625, 90),
    (-0.425, 0.0, 0),
    (-0.3922, 0.0, 0),
    (0.0, 0.1333, 90),
    (0.0, 0.0997, -90),
    (0.0, 0.0996, 0),
]
TOOL_POINT = np.array([0.01, -0.02, 0.22])


def turn(axis, angle):
    """Homogeneous rotation about coordinate axis 0 (x) or 2 (z)."""
    T = np.eye(4)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    T[i, i] = T[j, j] = np.cos(angle)
    T[j, i], T[i, j] = np.sin(angle), -np.sin(angle)
    return T


def shift(x, z):
    T = np.eye(4)
    T[0, 3], T[2, 3] = x, z
    return T


def pose_by_table(q):
    T = np.eye(4)
    for (a, d, alpha), angle in zip(TABLE, q, strict=True):
        T = T @ turn(2, angle) @ shift(0, d) @ shift(a, 0) @ turn(0, np.radians(alpha))
    return T


def random_configurations(n, seed=0):
    return np.random.default_rng(seed).uniform(-2 * np.pi, 2 * np.pi, (n, 6))


def test_flange_pose_is_the_product_of_the_tables_four_motions_per_joint():
    q = random_configurations(200)
    expected = np.array([pose_by_table(row) for row in q])
    np.testing.assert_allclose(forward(q), expected, atol=1e-14)


def test_the_arm_lies_along_minus_x_when_all_angles_are_zero():
    np.testing.assert_allclose(forward(np.zeros(6))[:3, 3], [-0.8172, -0.2329, 0.0628], atol=1e-12)


def test_every_link_frame_is_a_rigid_transform():
    frames = link_frames(random_configurations(1)[0])
    np.testing.assert_allclose(
        frames[:, :3, :3] @ frames[:, :3, :3].transpose(0, 2, 1), np.broadcast_to(np.eye(3), (7, 3, 3)), atol=1e-14
    )
    assert np.linalg.det(frames[:, :3, :3]) == pytest.approx(np.ones(7))


def velocity_by_differences(q, joint, step=1e-5):
    """Central difference of the tool point and of the rotation for one joint."""
    dq = step * np.eye(6)[joint]
    T_plus, T_minus = forward(q + dq), forward(q - dq)
    linear = (T_plus - T_minus)[:3] @ np.append(TOOL_POINT, 1.0) / (2 * step)
    W = (T_plus - T_minus)[:3, :3] @ forward(q)[:3, :3].T / (2 * step)
    return np.append(linear, [W[2, 1], W[0, 2], W[1, 0]])


def test_jacobian_is_the_derivative_of_the_pose():
    for q in random_configurations(20):
        expected = np.stack([velocity_by_differences(q, joint) for joint in range(6)], axis=1)
        np.testing.assert_allclose(jacobian(q, TOOL_POINT), expected, atol=1e-9)


@pytest.mark.parametrize("straight", [2, 4])
def test_a_stretched_elbow_or_aligned_wrist_is_singular(straight):
    q = np.array([[0.3, -1.2, 1.1, -0.7, -1.5, 0.4]])
    assert smallest_singular_values(q, TOOL_POINT)[0] > 0.05
    q[0, straight] = 0.0
    assert smallest_singular_values(q, TOOL_POINT)[0] < 1e-15


def test_the_jacobian_s_determinant_has_its_closed_form():
    q = random_configurations(50)
    radius = -0.425 * np.cos(q[:, 1]) - 0.3922 * np.cos(q[:, 1] + q[:, 2]) + 0.0997 * np.sin(q[:, 1:4].sum(axis=1))
    expected = np.abs(0.425 * 0.3922 * np.sin(q[:, 2]) * np.sin(q[:, 4]) * radius)
    np.testing.assert_allclose(np.abs(np.linalg.det(jacobian(q, TOOL_POINT))), expected, atol=1e-15)
