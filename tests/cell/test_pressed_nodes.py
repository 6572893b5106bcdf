"""Nodes on the real part: they carry the true areas and lie where the pad meets the part."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from polish_sim.cell import RealPart, Touch, build_real_part
from polish_sim.cell.real_part import build_part_fields
from polish_sim.cell.removal import EDGE, Nodes, place_nodes, surroundings
from polish_sim.config import PartConfig
from polish_sim.geometry import Region, Surface, field_distance, part_from_arrays, select_region
from polish_sim.geometry.fit import fit_triangles

Array = NDArray[np.float64]

UP = np.array([0.0, 0.0, 1.0])
R = 0.02
TRACK = np.column_stack([np.linspace(-0.03, 0.03, 61), np.zeros(61), np.zeros(61)])


@pytest.fixture(scope="module")
def block() -> tuple[Surface, Region]:
    """A block of 100 x 100 x 20 mm with its top at z = 0, of which 80 x 30 mm in the middle are to be polished."""
    box = trimesh.creation.box((0.1, 0.1, 0.02))
    vertices, faces = np.array(box.vertices) - [0.0, 0.0, 0.01], np.array(box.faces, dtype=np.int32)
    surface, mesh = fit_triangles(vertices, faces), part_from_arrays(vertices, faces)
    return surface, select_region(surface, mesh, "box:-40,-15,-5,40,15,5")


def real(surface: Surface, region: Region, config: PartConfig) -> tuple[RealPart, Touch]:
    touch = Touch(TRACK, np.tile(UP, (len(TRACK), 1)), R)
    fields = build_part_fields(surface, touch)
    part = build_real_part(fields, config, np.eye(4), region.surface, UP, np.random.default_rng(3))
    return part, touch


def placed(block: tuple[Surface, Region], **changes: float) -> tuple[Nodes, RealPart]:
    part, touch = real(*block, PartConfig(**({"displacement_m": 0.0, "rotation_rad": 0.0} | changes)))  # type: ignore[arg-type]
    return place_nodes(*block, part, touch), part


def test_the_regions_areas_sum_to_the_region(block: tuple[Surface, Region]) -> None:
    nodes, _ = placed(block)
    own = len(nodes.mesh.vertices)
    assert nodes.pressed.areas[:own].sum() == pytest.approx(0.08 * 0.03, rel=1e-6)


def test_beside_the_region_lies_all_that_the_pad_comes_to(block: tuple[Surface, Region]) -> None:
    surface, region = block
    touch = Touch(TRACK, np.tile(UP, (len(TRACK), 1)), R)
    beside = surroundings(surface, region, touch, EDGE * R)
    x, y = beside.positions[:, 0], beside.positions[:, 1]
    assert np.abs(beside.positions[:, 2]).max() == pytest.approx(0.0, abs=1e-12)
    assert not ((np.abs(x) < 0.04) & (np.abs(y) < 0.015)).any()
    under = np.hypot(np.maximum(np.abs(x) - 0.03, 0.0), y) < R
    # The pad's way is 60 x 40 mm with half discs at its ends; off it goes what of the region it covers.
    in_region = 0.06 * 0.03 + 2.0 * (0.01 * 0.03 - _outside_the_end(0.01))
    assert float(beside.areas[under].sum()) == pytest.approx(0.06 * 0.04 + np.pi * R**2 - in_region, rel=0.03)


def _outside_the_end(length: float) -> float:
    """Of a strip 30 mm wide and so long past the last middle of the pad, what lies outside the pad's rim."""
    grid = np.stack(np.meshgrid(np.linspace(0.0, length, 801), np.linspace(-0.015, 0.015, 2401)), axis=-1)
    return float((np.hypot(grid[..., 0], grid[..., 1]) > R).mean()) * length * 0.03


def test_nodes_lie_on_the_bent_surface_with_normals_out_of_it(block: tuple[Surface, Region]) -> None:
    nodes, part = placed(block, form_error_m=0.002)
    places, normals = nodes.pressed.positions, nodes.pressed.normals
    assert np.ptp(places[:, 2]) > 0.001
    distances = [field_distance(part.field, *place) for place in places[::7]]
    assert np.median(np.abs(distances)) < 1e-9
    assert np.abs(distances).max() < 1e-4
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert (normals[:, 2] > 0.9).all()


def test_finer_nodes_are_more_and_share_the_same_region(block: tuple[Surface, Region]) -> None:
    part, touch = real(*block, PartConfig())
    coarse, fine = (place_nodes(*block, part, touch, edge).mesh for edge in (2.0 * EDGE, EDGE))
    assert len(fine.vertices) > 2 * len(coarse.vertices)
    assert fine.areas.sum() == pytest.approx(coarse.areas.sum())
