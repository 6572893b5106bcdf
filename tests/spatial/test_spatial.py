"""Rotations, transforms and vectors against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.spatial import (
    apply,
    from_pose,
    inverse,
    perpendicular,
    quaternion_from_rotation,
    rotation_angle,
    rotation_from_quaternion,
    rotation_to_axis,
    skew,
    transform,
    unit,
)

FRAMES = Rotation.random(100, random_state=0)
HALF_TURNS = Rotation.from_rotvec(
    math.pi * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0], [0, 0.6, -0.8], [0.48, 0.6, 0.64]])
)


@pytest.mark.parametrize("frames", [FRAMES, HALF_TURNS, Rotation.identity(1)])
def test_quaternions_and_matrices_say_the_same_rotation(frames: Rotation) -> None:
    R, quaternion = np.zeros((3, 3)), np.zeros(4)
    for wanted in frames:
        rotation_from_quaternion(wanted.as_quat(scalar_first=True), R)
        np.testing.assert_allclose(R, wanted.as_matrix(), atol=1e-15)
        quaternion_from_rotation(R, quaternion)
        assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-12)
        assert quaternion[0 if np.trace(R) > 0.0 else np.argmax(np.abs(quaternion))] > 0.0
        np.testing.assert_allclose(
            Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), R, atol=1e-12
        )


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-3, 1.0, 3.0, math.pi - 1e-9, math.pi])
def test_the_angle_between_frames_is_accurate_near_zero_and_near_a_half_turn(angle: float) -> None:
    for R, axis in zip(FRAMES[:20].as_matrix(), FRAMES[:20].as_matrix()[:, 1], strict=True):
        turned = Rotation.from_rotvec(angle * axis).as_matrix() @ R
        assert rotation_angle(R, turned) == pytest.approx(angle, rel=1e-6, abs=3e-15)


def test_frames_to_an_axis_are_rotations_with_x_as_near_to_the_hint_as_can_be() -> None:
    z_axes, hint = FRAMES.as_matrix()[:, 2], np.array([0.6, -0.8, 0.0])
    frames = rotation_to_axis(z_axes, hint)
    np.testing.assert_allclose(frames[:, :, 2], z_axes, atol=1e-15)
    np.testing.assert_allclose(
        frames @ np.swapaxes(frames, 1, 2), np.tile(np.eye(3), (len(frames), 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    best = np.sqrt(1.0 - (z_axes @ hint) ** 2)  # of the hint's projection into the plane
    np.testing.assert_allclose(frames[:, :, 0] @ hint, best, atol=1e-12)


def test_skew_is_the_cross_product() -> None:
    v, w = np.random.default_rng(0).normal(size=(2, 3))
    np.testing.assert_allclose(skew(v) @ w, np.cross(v, w), rtol=1e-14)


RNG = np.random.default_rng(0)
R_STACK, P_STACK = Rotation.random(20, random_state=0).as_matrix(), RNG.normal(size=(20, 3))


def test_a_stack_of_transforms_holds_rotation_translation_and_a_last_row_and_has_an_inverse() -> None:
    T = transform(R_STACK, P_STACK)
    assert T.shape == (20, 4, 4)
    np.testing.assert_array_equal(T[:, :3, :3], R_STACK)
    np.testing.assert_array_equal(T[:, :3, 3], P_STACK)
    np.testing.assert_array_equal(T[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (20, 1)))
    np.testing.assert_allclose(inverse(T) @ T, np.tile(np.eye(4), (20, 1, 1)), atol=1e-14)
    # One rotation goes with many translations.
    np.testing.assert_array_equal(transform(R_STACK[0], P_STACK)[7], transform(R_STACK[0], P_STACK[7]))


def test_points_move_as_homogeneous_coordinates_do() -> None:
    T, points = transform(R_STACK[3], P_STACK[3]), RNG.normal(size=(50, 3))
    homogeneous = np.column_stack([points, np.ones(50)])
    np.testing.assert_allclose(apply(T, points), (homogeneous @ T.T)[:, :3], atol=1e-14)
    np.testing.assert_allclose(apply(inverse(T), apply(T, points)), points, atol=1e-14)


def test_a_pose_is_position_and_rotation_vector() -> None:
    T = from_pose([0.1, -0.5, 0.2, 0.0, 0.0, np.pi / 2])
    np.testing.assert_allclose(T @ [1.0, 0.0, 0.0, 1.0], [0.1, 0.5, 0.2, 1.0], atol=1e-15)


ANY = np.concatenate(
    [np.random.default_rng(0).normal(size=(200, 3)), np.eye(3), -np.eye(3), [[1.0, 1.0, 1.0]]]
)


def test_a_unit_vector_keeps_its_direction_and_zero_stays_zero():
    assert np.linalg.norm(unit(ANY), axis=1) == pytest.approx(np.ones(len(ANY)))
    assert np.cross(unit(ANY), ANY) == pytest.approx(np.zeros_like(ANY), abs=1e-15)
    assert (unit(np.zeros(3)) == 0.0).all()


def test_a_perpendicular_vector_is_of_length_one_and_square_to_its_own():
    across = perpendicular(ANY)
    assert np.linalg.norm(across, axis=1) == pytest.approx(np.ones(len(ANY)))
    assert (across * unit(ANY)).sum(axis=1) == pytest.approx(np.zeros(len(ANY)), abs=1e-15)
    assert perpendicular(ANY[7]) == pytest.approx(across[7])
