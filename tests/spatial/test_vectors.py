"""Unit and perpendicular vectors, for any direction and any stack of them."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.spatial import perpendicular, unit

ANY = np.concatenate([np.random.default_rng(0).normal(size=(200, 3)), np.eye(3), -np.eye(3), [[1.0, 1.0, 1.0]]])


def test_a_unit_vector_keeps_its_direction_and_zero_stays_zero():
    assert np.linalg.norm(unit(ANY), axis=1) == pytest.approx(np.ones(len(ANY)))
    assert np.cross(unit(ANY), ANY) == pytest.approx(np.zeros_like(ANY), abs=1e-15)
    assert (unit(np.zeros(3)) == 0.0).all()


def test_a_perpendicular_vector_is_of_length_one_and_square_to_its_own():
    across = perpendicular(ANY)
    assert np.linalg.norm(across, axis=1) == pytest.approx(np.ones(len(ANY)))
    assert (across * unit(ANY)).sum(axis=1) == pytest.approx(np.zeros(len(ANY)), abs=1e-15)
    assert perpendicular(ANY[7]) == pytest.approx(across[7])
