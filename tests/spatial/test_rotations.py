"""Rotations against scipy's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.spatial import (
    quaternion_from_rotation,
    rotation_angle,
    rotation_from_quaternion,
    rotation_to_axis,
    skew,
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
        np.testing.assert_allclose(Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), R, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-3, 1.0, 3.0, math.pi - 1e-9, math.pi])
def test_the_angle_between_frames_is_accurate_near_zero_and_near_a_half_turn(angle: float) -> None:
    for R, axis in zip(FRAMES[:20].as_matrix(), FRAMES[:20].as_matrix()[:, 1], strict=True):
        turned = Rotation.from_rotvec(angle * axis).as_matrix() @ R
        assert rotation_angle(R, turned) == pytest.approx(angle, rel=1e-6, abs=3e-15)


def test_frames_to_an_axis_are_rotations_with_x_as_near_to_the_hint_as_can_be() -> None:
    z_axes, hint = FRAMES.as_matrix()[:, 2], np.array([0.6, -0.8, 0.0])
    frames = rotation_to_axis(z_axes, hint)
    np.testing.assert_allclose(frames[:, :, 2], z_axes, atol=1e-15)
    np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), np.tile(np.eye(3), (len(frames), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    best = np.sqrt(1.0 - (z_axes @ hint) ** 2)  # of the hint's projection into the plane
    np.testing.assert_allclose(frames[:, :, 0] @ hint, best, atol=1e-12)


def test_skew_is_the_cross_product() -> None:
    v, w = np.random.default_rng(0).normal(size=(2, 3))
    np.testing.assert_allclose(skew(v) @ w, np.cross(v, w), rtol=1e-14)
