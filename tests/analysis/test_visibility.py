"""What a viewer sees of points on and about a part."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from polish_sim.analysis.style import depth_picture, seen_in


def from_above(points):
    return points


def test_a_box_hides_what_is_below_it_and_nothing_above_or_beside_it():
    box = trimesh.creation.box((2.0, 2.0, 2.0))
    picture = depth_picture(np.asarray(box.triangles), from_above)
    across = np.random.default_rng(0).uniform(-0.95, 0.95, (500, 2))
    up = np.tile([0.0, 0.0, 1.0], (500, 1))
    for height, seen in ((1.0, True), (3.0, True), (0.0, False), (-1.0, False), (-3.0, False)):
        points = np.column_stack([across, np.full(500, height)])
        assert (seen_in(picture, points, up if height > 0.0 else -up) == seen).all()
    beside = np.column_stack([across + [2.5, 0.0], np.full(500, -3.0)])
    assert seen_in(picture, beside, up).all()


@pytest.mark.parametrize("towards", [(0.0, 0.0, 1.0), (0.6, -0.48, 0.64)])
def test_of_a_sphere_the_half_that_faces_the_viewer_is_seen(towards):
    ball = trimesh.creation.icosphere(4)
    third = np.asarray(towards)
    first = np.cross([0.0, 1.0, 0.0], third)
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(third, first), third])
    picture = depth_picture(np.asarray(ball.triangles), lambda points: points @ frame.T)
    normals = np.random.default_rng(1).standard_normal((2000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    facing = normals @ third
    # What is lifted by 3% of the radius looks over the rim from 0.23 behind it.
    clear = np.abs(facing) > 0.25
    assert (seen_in(picture, normals, normals) == (facing > 0.0))[clear].all()


def test_long_thin_facets_hide_as_well_as_square_ones():
    low, high = np.array([0.0, 0.0, 0.0]), np.array([10.0, 0.02, 0.0])
    strip = np.array([[low, [10.0, 0.0, 0.0], high], [low, high, [0.0, 0.02, 0.0]]])
    picture = depth_picture(strip, from_above)
    along = np.column_stack([np.linspace(0.01, 9.99, 999), np.full(999, 0.01), np.full(999, -1.0)])
    assert not seen_in(picture, along, np.tile([0.0, 0.0, -1.0], (999, 1))).any()
