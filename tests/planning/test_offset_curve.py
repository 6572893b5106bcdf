"""Steps on a surface have their length, offset curves keep their distance everywhere (paper 1, fig. 4, 5)."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.planning.curves.curve import Curve, step_on_surface
from polish_sim.planning.curves.offset_curve import LevelLine, adapted_spacing, offset_curve
from tests.planning.shapes import UP, Ball, Bar, Floor, circle, level, square

STEP = 0.008


def roughly(points, noise=0.0):
    points = points + noise * np.random.default_rng(0).normal(size=points.shape) * [1.0, 1.0, 0.0]
    return LevelLine(points, np.tile(UP, (len(points), 1)), np.zeros(len(points), np.int64), True)


def test_on_a_sphere_the_offset_of_a_parallel_is_the_parallel_one_chord_up():
    radius, step = 0.1, 0.008
    low = np.arccos(0.5)
    ring = circle(radius * np.sin(low), radius * np.cos(low), 4000)
    high = low - 2.0 * np.arcsin(0.5 * step / radius)
    guess = circle(radius * np.sin(high), radius * np.cos(high))
    trial = LevelLine(guess, guess / radius, np.zeros(len(guess), np.int64), True)
    found = offset_curve(Ball(radius), [Curve(ring, ring / radius, True)], trial, step)
    assert found.positions[:, 2] == pytest.approx(
        np.full(len(found.positions), radius * np.cos(high)), abs=1e-7
    )


def test_no_point_comes_nearer_than_the_step_and_none_is_further():
    old = level(square(0.05), closed=True)
    found = offset_curve(Floor(), [old], roughly(square(0.042), noise=2e-4), STEP)
    distance = old.nearest(found.positions).distances
    assert distance == pytest.approx(np.full(len(distance), STEP), abs=1e-9)


def test_a_notch_is_rounded_not_cut():
    """Round a corner that points into the region the offset is an arc about the corner."""
    corner = np.array([0.0, 0.0, 0.0])
    arms = [np.linspace([-0.05, -0.05, 0.0], corner, 200), np.linspace(corner, [0.05, -0.05, 0.0], 200)]
    outline = np.concatenate([*arms, [[0.05, 0.05, 0.0], [-0.05, 0.05, 0.0]]])
    angle = np.linspace(0.75 * np.pi, 0.25 * np.pi, 40)
    trial = 0.0085 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    guess = LevelLine(trial, np.tile(UP, (40, 1)), np.zeros(40, np.int64), False)
    found = offset_curve(Floor(), [level(outline, closed=True)], guess, STEP)
    assert np.linalg.norm(found.positions, axis=1) == pytest.approx(
        np.full(len(found.positions), STEP), abs=1e-9
    )


@pytest.mark.parametrize("radius", [0.004, 0.02, 0.3])
def test_control_points_stand_so_that_the_chord_error_is_the_same(radius):
    """Chord error of a chord c on a circle is c^2 / 8 R; limits apply on nearly straight and very tight
    curves."""
    chords = adapted_spacing(level(circle(radius, count=4000), closed=True), STEP)
    wanted = np.clip(np.sqrt(8.0 * radius * STEP / 4000.0), STEP / 40.0, STEP / 8.0)
    assert chords == pytest.approx(np.full(len(chords), wanted), rel=0.06)
    assert chords.sum() == pytest.approx(2.0 * np.pi * radius, rel=1e-5)


# From a point on the surface to the point exactly one step away (paper 1, fig. 4).


@pytest.mark.parametrize("surface", [Ball(0.05), Ball(0.3), Bar(0.03), Floor()])
def test_a_step_has_the_asked_length_to_a_picometre_ahead_in_the_plane_of_direction_and_normal(surface):
    rng = np.random.default_rng(0)
    foot = surface.closest(rng.normal(size=(200, 3)))
    along = np.cross(foot.normals, rng.normal(size=(200, 3)))
    lengths = np.linspace(0.0, STEP, 200)
    end = step_on_surface(surface, foot.positions, foot.normals, along, lengths)
    way = end.positions - foot.positions
    assert np.linalg.norm(way, axis=1) == pytest.approx(lengths, abs=1e-12)
    assert surface.closest(end.positions).positions == pytest.approx(end.positions, abs=1e-12)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    assert (way * np.cross(foot.normals, along)).sum(axis=1) == pytest.approx(np.zeros(200), abs=1e-11)
    assert ((way * along).sum(axis=1) >= 0.9 * lengths).all()
