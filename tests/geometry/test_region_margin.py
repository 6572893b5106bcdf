"""Keeping away from edges: the new border lies at the margin, measured along the surface."""

import numpy as np
import pytest

from polish_sim.errors import PlanError
from polish_sim.geometry import fit_surface, part_from_arrays, select_region
from polish_sim.geometry.orientation import UP_CONE
from tests.geometry.shapes import BLOCK, FINE_BALL, RING, region_of


@pytest.mark.parametrize("margin", [0.0005, 0.02])
def test_a_rectangle_stays_a_rectangle(margin):
    region = region_of(BLOCK, margin=margin)
    (loop,) = region.boundary_loops
    assert region.surface.bounds[:, 0] == pytest.approx([-0.05 + margin, 0.05 - margin], abs=1e-4 * margin)
    assert region.surface.bounds[:, 1] == pytest.approx([-0.03 + margin, 0.03 - margin], abs=1e-4 * margin)
    # Only the corners may be missing, a small share of the margin wide.
    off = np.minimum(0.05 - np.abs(loop[:, 0]), 0.03 - np.abs(loop[:, 1])) - margin
    assert off.min() > -1e-4 * margin
    assert off.max() < 0.13 * margin
    missing = (0.1 - 2 * margin) * (0.06 - 2 * margin) - region.area_m2
    assert abs(missing) < 1e-3 * margin * (0.1 + 0.06 - 4 * margin)


def test_on_a_ball_the_distance_is_that_along_the_great_circle():
    margin = 0.015
    region = region_of(FINE_BALL, margin=margin)
    (loop,) = region.boundary_loops
    angle = np.arctan2(np.hypot(loop[:, 0], loop[:, 1]), loop[:, 2])
    # The border it starts from is a circle up to 0.2 mm where the cone cuts the facets of the ball.
    assert angle.mean() * 0.05 == pytest.approx(UP_CONE * 0.05 - margin, abs=2e-5)
    assert np.abs(angle * 0.05 - (UP_CONE * 0.05 - margin)).max() < 2e-4


@pytest.mark.parametrize(("margin", "holes"), [(0.003, 0.0), (0.0, 0.003), (0.002, 0.005)])
def test_outer_borders_and_holes_have_margins_of_their_own(margin, holes):
    region = region_of(RING, margin=margin, holes=holes)
    outer, hole = (np.hypot(loop[:, 0], loop[:, 1]) for loop in region.boundary_loops)
    assert outer == pytest.approx(0.030 - margin, abs=3e-5)
    assert hole == pytest.approx(0.010 + holes, abs=3e-5)


def test_a_dumbbell_falls_apart_and_a_margin_too_wide_is_refused_with_the_width():
    outline = np.array(
        [[0, 0], [40, 0], [40, 15], [80, 15], [80, 0], [120, 0], [120, 40], [80, 40], [80, 25], [40, 25]]
    )
    outline = np.vstack([outline, [[40, 40], [0, 40]]])
    side = np.array(
        [[0, 1, 2], [0, 2, 9], [0, 9, 10], [0, 10, 11], [2, 3, 8], [2, 8, 9], [3, 4, 5], [3, 5, 6]]
    )
    side = np.vstack([side, [[3, 6, 8], [6, 7, 8]]])
    part = part_from_arrays(np.column_stack([outline, np.zeros(12)]), side, unit="mm", up="z")
    surface = fit_surface(part)
    one, two = select_region(surface, part, edge_margin=0.007).components()
    # Two squares of 26 mm, each with a tip between the circles about the neck's corners.
    width = np.sqrt(49.0 - 25.0)
    tip = 10.0 * (7.0 - width) - (49.0 * np.pi / 2 - (width * 5.0 + 49.0 * np.arcsin(width / 7.0)))
    assert one.area_m2 == pytest.approx((26.0 * 26.0 + tip) * 1e-6, rel=1e-4)
    assert two.area_m2 == pytest.approx(one.area_m2, rel=1e-3)
    assert len(select_region(surface, part, edge_margin=0.004).components()) == 1
    with pytest.raises(PlanError, match="about 40 mm wide"):
        select_region(surface, part, edge_margin=0.025)
