"""Rotations, transforms, vectors and their kernels against their definitions."""

import math
import pickle
from types import GenericAlias
from typing import Annotated, Any

import numba
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim import arrays, kernels, spatial
from polish_sim.motion.derivatives import carried

FRAMES = Rotation.random(100, random_state=0)
HALF_TURNS = Rotation.from_rotvec(
    math.pi * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0], [0, 0.6, -0.8], [0.48, 0.6, 0.64]])
)
VECTORS = np.concatenate([np.random.default_rng(0).normal(size=(200, 3)), np.eye(3), -np.eye(3)])


def test_quaternions_and_matrices_say_the_same_rotation():
    R, quaternion = np.zeros((3, 3)), np.zeros(4)
    for wanted in Rotation.concatenate([FRAMES, HALF_TURNS, Rotation.identity(1)]):
        spatial.rotation_from_quaternion(wanted.as_quat(scalar_first=True), R)
        np.testing.assert_allclose(R, wanted.as_matrix(), atol=1e-15)
        spatial.quaternion_from_rotation(R, quaternion)
        assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-12)
        assert quaternion[0 if np.trace(R) > 0.0 else np.argmax(np.abs(quaternion))] > 0.0
        found = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        np.testing.assert_allclose(found, R, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-3, 1.0, 3.0, math.pi - 1e-9, math.pi])
def test_the_angle_between_frames_is_accurate_near_zero_and_near_a_half_turn(angle):
    for R, axis in zip(FRAMES[:20].as_matrix(), FRAMES[:20].as_matrix()[:, 1], strict=True):
        turned = Rotation.from_rotvec(angle * axis).as_matrix() @ R
        assert spatial.rotation_angle(R, turned) == pytest.approx(angle, rel=1e-6, abs=3e-15)


def test_frames_to_an_axis_are_rotations_with_x_as_near_to_the_hint_as_can_be():
    z_axes, hint = FRAMES.as_matrix()[:, 2], np.array([0.6, -0.8, 0.0])
    frames = spatial.rotation_to_axis(z_axes, hint)
    np.testing.assert_allclose(frames[:, :, 2], z_axes, atol=1e-15)
    np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), [np.eye(3)] * len(frames), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    best = np.sqrt(1.0 - (z_axes @ hint) ** 2)  # of the hint's projection into the plane
    np.testing.assert_allclose(frames[:, :, 0] @ hint, best, atol=1e-12)


def test_vector_products_of_stacks_are_numpys_to_the_last_bit():
    for shape in ((3,), (206, 3), (2, 1, 3)):
        first = VECTORS[: math.prod(shape) // 3].reshape(shape)
        assert arrays.crosses(first, VECTORS).tobytes() == np.cross(first, VECTORS).tobytes()


def test_unit_and_perpendicular_vectors_have_length_one_and_skew_is_the_cross_product():
    units, across = arrays.unit(VECTORS), arrays.perpendicular(VECTORS)
    np.testing.assert_allclose(np.linalg.norm([units, across], axis=-1), 1.0)
    np.testing.assert_allclose((units * VECTORS).sum(axis=1), np.linalg.norm(VECTORS, axis=1))
    np.testing.assert_allclose((across * units).sum(axis=1), 0.0, atol=1e-15)
    np.testing.assert_array_equal(arrays.perpendicular(VECTORS[7]), across[7])
    assert (arrays.unit(np.zeros(3)) == 0.0).all()
    a, b = VECTORS[:2]
    np.testing.assert_allclose(spatial.skew(a) @ b, np.cross(a, b), rtol=1e-14)


def test_a_frame_is_tilted_about_its_own_x_and_y_also_in_place():
    R = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
    wanted = R @ Rotation.from_rotvec([0.05, -0.1, 0.0]).as_matrix()
    spatial.tilt_frame(R, 0.05, -0.1, R)
    np.testing.assert_allclose(R, wanted, atol=1e-12)
    spatial.tilt_frame(R.copy(), 0.0, 0.0, R)
    np.testing.assert_allclose(R, wanted, atol=1e-12)


def test_the_type_of_a_field_is_read_from_either_way_to_write_an_array():
    for array in (arrays.Array, GenericAlias(np.ndarray, (np.float64,))):  # here and in numpy 2.5
        state = type("State", (kernels.Record,), {"__annotations__": {"p": Annotated[array, (3,)], "n": int}})
        assert state.dtype["p"] == np.dtype((np.float64, (3,)))
        assert state.dtype["n"] == np.int64


def test_turns_are_those_of_rotation_vectors_and_derivatives_of_vectors_that_turn_of_a_growing_turn():
    n, v, p = np.array([0.6, 0.0, 0.8]), np.array([1.0, -2.0, 3.0]), np.array([0.5, 0.1, -0.2])
    R = Rotation.from_rotvec(0.7 * n).as_matrix()
    turned = kernels.turn_about(n, np.cos(0.7), np.sin(0.7), 1.0 - np.cos(0.7), v)
    np.testing.assert_allclose(turned, R @ v, atol=1e-14)
    np.testing.assert_allclose(kernels.matvec(R, v), R @ v, atol=1e-14)
    np.testing.assert_allclose(kernels.plus_matvec(p, R, v), p + R @ v, atol=1e-14)
    np.testing.assert_allclose(kernels.plus_cross(p, n, v), p + np.cross(n, v), atol=1e-14)
    # About a fixed axis z by phi = w t + e t^2 / 2 + f t^3 / 6, at t = 0: those of (cos phi, sin phi).
    w, e, f = 2.0, 3.0, 5.0
    x, turns = np.array([1.0, 0.0, 0.0]), [np.array([0.0, 0.0, rate]) for rate in (w, e, f)]
    np.testing.assert_allclose(kernels.second_by_turning(*turns[:2], x), (-(w**2), e, 0.0), atol=1e-14)
    jet = carried([turn[None] for turn in turns], x[None])
    np.testing.assert_allclose(jet[3], [(-3.0 * w * e, f - w**3, 0.0)], atol=1e-14)


class Level(kernels.Record):
    height: float


class Inner(kernels.Bundle):
    columns: Any
    factor: float = 2.0


class Outer(kernels.Bundle):
    inner: Inner
    level: Level
    rows: arrays.Array
    count: int
    raised: bool
    normal: tuple[float, float, float] = (0.0, 0.5, 0.25)


@numba.njit
def sum_of_fields(outer, row):
    outer.level.height += 1.0
    outer.rows[0, 0] = -1.0
    total = outer.normal[1] + outer.count + len(outer.rows) + (0.125 if outer.raised else 0.0)
    return total + outer.inner.factor * outer.inner.columns[row, 1] + outer.rows[row, 2]


def test_a_kernel_reads_and_writes_in_place_what_a_bundle_holds_and_a_copy_has_its_own_address():
    rows = np.arange(12.0).reshape(4, 3)
    for columns in (rows.T, rows[::2], np.arange(8).reshape(4, 2)):
        outer = Outer(Inner(columns), Level(height=7.0), rows.copy(), 3, True)
        for same in (outer, pickle.loads(pickle.dumps(outer)), outer._replace(count=3)):
            height = float(same.level.height)
            assert sum_of_fields(same, 1) == 0.5 + 3 + 4 + 0.125 + 2.0 * columns[1, 1] + rows[1, 2]
            assert (same.level.height, same.rows[0, 0]) == (height + 1.0, -1.0)
            assert sum_of_fields.py_func(same, 1) == sum_of_fields(same, 1)
        assert outer._replace(count=4).address != outer.address
    assert sum_of_fields(outer._replace(raised=False, inner=Inner(rows, 0.5)), 3) == 0.5 + 3 + 4 + 5.0 + 11.0
