"""Marks on a part: far apart, on what is worked on, the tool square upon them."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.dual.frames import marks_on
from polish_sim.experiments.part_setup import part_file
from polish_sim.geometry import Region, Surface, fit_surface, load_part, select_region


def part(name: str, choice: str = "auto") -> tuple[Region, Surface]:
    mesh = load_part(part_file(name))
    surface = fit_surface(mesh)
    return select_region(surface, mesh, choice), surface


@pytest.mark.parametrize("name", ["wheel_hub_rim", "plate", "freeform"])
@pytest.mark.parametrize("count", [3, 7])
def test_marks_lie_on_the_region_with_the_tool_into_the_part(name: str, count: int) -> None:
    region, surface = part(name)
    T = marks_on(region, surface, count)
    there = region.surface.closest(T[:, :3, 3])
    np.testing.assert_allclose(there.positions, T[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(T[:, :3, 2], -there.normals, atol=1e-6)
    np.testing.assert_allclose(
        np.swapaxes(T[:, :3, :3], 1, 2) @ T[:, :3, :3], np.tile(np.eye(3), (count, 1, 1)), atol=1e-12
    )


@pytest.mark.parametrize("name", ["wheel_hub_rim", "plate", "freeform"])
def test_three_marks_span_a_good_part_of_the_region(name: str) -> None:
    """The triangle they make is not much narrower than what they lie on."""
    region, surface = part(name)
    points = marks_on(region, surface, 3)[:, :3, 3]
    size = np.ptp(region.surface.vertices[np.unique(region.surface.faces)], axis=0).max()
    sides = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    assert sides.min() > 0.4 * size
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    assert spread[1] > 0.3 * spread[0]


def test_on_a_rim_three_marks_are_a_third_of_a_turn_apart() -> None:
    points = marks_on(*part("wheel_hub_rim"), 3)[:, :2, 3]
    angles = np.sort(np.degrees(np.arctan2(points[:, 1], points[:, 0])))
    np.testing.assert_allclose(np.diff([*angles, angles[0] + 360.0]), 120.0, atol=4.0)


def test_a_narrow_strip_is_found_by_marks_all_over_the_part() -> None:
    region, surface = part("plate", "box:-100,-2,-50,100,2,50")
    points = marks_on(region, surface, 3)[:, :3, 3]
    assert np.ptp(points[:, 1]) > 0.03
