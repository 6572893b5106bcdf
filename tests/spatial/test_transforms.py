"""Poses as 4x4 matrices: neighbouring names cancel."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.spatial import apply, from_pose, inverse, transform

RNG = np.random.default_rng(0)
R_STACK, P_STACK = Rotation.random(20, random_state=0).as_matrix(), RNG.normal(size=(20, 3))


def test_a_stack_of_transforms_holds_rotation_translation_and_a_last_row() -> None:
    T = transform(R_STACK, P_STACK)
    assert T.shape == (20, 4, 4)
    np.testing.assert_array_equal(T[:, :3, :3], R_STACK)
    np.testing.assert_array_equal(T[:, :3, 3], P_STACK)
    np.testing.assert_array_equal(T[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (20, 1)))


def test_one_rotation_goes_with_many_translations() -> None:
    T = transform(R_STACK[0], P_STACK)
    np.testing.assert_array_equal(T[7], transform(R_STACK[0], P_STACK[7]))


def test_a_transform_times_its_inverse_is_the_identity() -> None:
    T = transform(R_STACK, P_STACK)
    np.testing.assert_allclose(inverse(T) @ T, np.tile(np.eye(4), (20, 1, 1)), atol=1e-14)


def test_points_move_as_homogeneous_coordinates_do() -> None:
    T, points = transform(R_STACK[3], P_STACK[3]), RNG.normal(size=(50, 3))
    homogeneous = np.column_stack([points, np.ones(50)])
    np.testing.assert_allclose(apply(T, points), (homogeneous @ T.T)[:, :3], atol=1e-14)
    np.testing.assert_allclose(apply(inverse(T), apply(T, points)), points, atol=1e-14)


def test_a_pose_is_position_and_rotation_vector() -> None:
    T = from_pose([0.1, -0.5, 0.2, 0.0, 0.0, np.pi / 2])
    np.testing.assert_allclose(T @ [1.0, 0.0, 0.0, 1.0], [0.1, 0.5, 0.2, 1.0], atol=1e-15)
