"""Records of compiled state, and products of vectors."""

from types import GenericAlias
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim import kernels
from polish_sim.arrays import Array


def test_the_type_of_a_field_is_read_from_either_way_to_write_an_array():
    for array in (Array, GenericAlias(np.ndarray, (np.float64,))):  # as here and as numpy 2.5 writes it
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
    np.testing.assert_allclose(kernels.third_by_turning(*turns, x), (-3.0 * w * e, f - w**3, 0.0), atol=1e-14)
