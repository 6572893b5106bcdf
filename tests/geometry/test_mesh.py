"""Parts of arrays: the unit they are read in, and what is no mesh."""

import numpy as np
import pytest
import trimesh

from polish_sim.errors import InputError, MeshError
from polish_sim.geometry import PartMesh, part_from_arrays
from tests.geometry.shapes import BALL, BLOCK, part_of


def box(*sides: float, unit: str = "auto") -> PartMesh:
    mesh = trimesh.creation.box(sides)
    return part_from_arrays(np.array(mesh.vertices), np.array(mesh.faces), unit=unit)


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("cm", 1e-2), ("inch", 0.0254)])
def test_units_scale_the_part(unit, metres):
    part = box(20.0, 12.0, 6.0, unit=unit)
    assert np.ptp(part.vertices, axis=0) == pytest.approx(np.array([20.0, 12.0, 6.0]) * metres)
    assert part.unit == unit


@pytest.mark.parametrize(
    ("size", "taken"),
    [(0.3, "m"), (0.786, "m"), (5.0, "mm"), (700.0, "mm"), (0.8, None), (3.0, None), (2500.0, None)],
)
def test_the_only_unit_that_makes_a_sensible_part_is_taken_and_noted(size, taken):
    """In inches a part of 0.8 is 20 mm long, in metres 0.8 m: two units, one has to be named."""
    sides = size, 0.6 * size, 0.3 * size
    if taken is None:
        with pytest.raises(MeshError, match="units" if size < 5.0 else "No known unit"):
            box(*sides)
        return
    part = box(*sides)
    assert part.unit == taken
    assert any("the only unit" in note for note in part.notes) == (taken == "m")


@pytest.mark.parametrize(
    ("sides", "unit", "said"),
    [
        ((0.1, 0.06, 0.02), "mm", r"too small: 0.1 mm .*--units m"),
        ((100.0, 60.0, 20.0), "m", r"too large: 100 m .*--units mm, --units cm"),
        ((1e-4, 1e-4, 1e-4), "mm", "No known unit fits"),
        ((4.99, 3.0, 2.0), "auto", r"too small: 4.99 mm at its largest \(wanted: 5 to 2000 mm\)"),
    ],
)
def test_a_wrong_unit_is_refused_and_the_fitting_ones_named(sides, unit, said):
    with pytest.raises(MeshError, match=said):
        box(*sides, unit=unit)


def test_a_part_of_just_the_smallest_size_is_taken_whatever_the_rounding():
    for size in (5.0, 5.0 * (1.0 - 1e-7)):
        assert box(size, 3.0, 2.0).unit == "mm"


def test_unknown_units_and_sides_list_the_known_ones():
    with pytest.raises(InputError, match=r"unknown unit 'ft'. Known: cm, inch, m, mm"):
        box(100.0, 60.0, 20.0, unit="ft")
    with pytest.raises(InputError, match=r"unknown side .*'up'. Known: -x, -y, -z, X,Y,Z, auto, x, y, z"):
        part_of(BLOCK, "up")


def test_vertices_keep_their_order_and_repeated_ones_are_merged():
    points, faces = np.array(BALL.vertices), np.array(BALL.faces)
    part = part_from_arrays(points[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), unit="mm")
    assert len(part.vertices) == len(points)
    _, first = np.unique(faces.ravel(), return_index=True)
    assert np.array_equal(part.vertices, 1e-3 * points[faces.ravel()[np.sort(first)]])


def test_arrays_that_are_no_mesh_are_refused():
    points, faces = np.array(BALL.vertices), np.array(BALL.faces)
    for vertices, triangles, said in (
        (points[:, :2], faces, r"got \(2562, 2\) and \(5120, 3\)"),
        (points[:50], faces, "vertices that do not exist"),
        (points, faces.astype(float), "whole numbers"),
        (np.where(points > 49.0, np.nan, points), faces, "NaN or infinite"),
    ):
        with pytest.raises(MeshError, match=said):
            part_from_arrays(vertices, triangles, unit="mm")
