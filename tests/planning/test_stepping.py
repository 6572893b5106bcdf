"""From a point on the surface to the point exactly one step away (paper 1, fig. 4)."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.planning.curves.curve import step_on_surface
from tests.planning.shapes import Ball, Bar, Floor, region_of

STEP = 0.008


def start_on(surface, points):
    foot = surface.closest(points)
    rng = np.random.default_rng(1)
    along = np.cross(foot.normals, rng.normal(size=points.shape))
    return foot.positions, foot.normals, along


@pytest.mark.parametrize("surface", [Ball(0.05), Ball(0.3), Bar(0.03), Floor()])
def test_the_step_has_the_asked_length_to_a_picometre_and_ends_on_the_surface(surface):
    start, normals, along = start_on(surface, np.random.default_rng(0).normal(size=(200, 3)))
    end = step_on_surface(surface, start, normals, along, STEP)
    assert np.linalg.norm(end.positions - start, axis=1) == pytest.approx(np.full(200, STEP), abs=1e-12)
    assert surface.closest(end.positions).positions == pytest.approx(end.positions, abs=1e-12)


def test_the_step_stays_in_the_plane_of_direction_and_normal():
    surface = Bar(0.03)
    start, normals, along = start_on(surface, np.random.default_rng(0).normal(size=(200, 3)))
    end = step_on_surface(surface, start, normals, along, STEP)
    across = np.cross(normals, along / np.linalg.norm(along, axis=1, keepdims=True))
    assert ((end.positions - start) * across).sum(axis=1) == pytest.approx(np.zeros(200), abs=1e-11)


def test_on_a_sphere_the_step_turns_by_twice_the_arcsine_of_half_of_it():
    radius = 0.05
    end = step_on_surface(Ball(radius), np.array([[0.0, 0.0, radius]]), np.eye(3)[2:], np.eye(3)[:1], STEP)
    angle = 2.0 * np.arcsin(0.5 * STEP / radius)
    assert end.positions[0] == pytest.approx(radius * np.array([np.sin(angle), 0.0, np.cos(angle)]), abs=1e-12)


def test_on_a_fitted_surface_the_step_is_exact_too():
    surface = region_of("freeform").surface
    middles = np.full((500, 3), 1.0 / 3.0)
    facets = np.random.default_rng(2).integers(0, len(surface.faces), 500).astype(np.int32)
    positions, normals = surface.evaluate(facets, middles)
    inner = np.linalg.norm(positions[:, :2], axis=1) < 0.09
    along = np.cross(normals, np.random.default_rng(3).normal(size=normals.shape))
    end = step_on_surface(surface, positions[inner], normals[inner], along[inner], STEP)
    gap = np.linalg.norm(end.positions - positions[inner], axis=1) - STEP
    assert np.abs(gap).max() < 1e-9


def test_steps_of_different_lengths_go_at_once():
    lengths = np.array([0.0, 0.001, 0.02])
    start = np.zeros((3, 3))
    end = step_on_surface(Floor(), start, np.tile([0.0, 0.0, 1.0], (3, 1)), np.tile([1.0, 1.0, 5.0], (3, 1)), lengths)
    assert np.linalg.norm(end.positions, axis=1) == pytest.approx(lengths, abs=1e-15)
