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


@pytest.mark.parametrize(
    ("size", "unit", "metres"),
    [
        (20.0, "cm", 0.2), (20.0, "inch", 0.508), (0.3, "m", 0.3), (0.786, "m", 0.786), (700.0, "mm", 0.7),
        (5.0 * (1.0 - 1e-7), "mm", 0.005),
    ],
)  # fmt: skip
def test_a_part_is_read_in_the_unit_named_or_the_only_one_that_makes_it_sensible(size, unit, metres):
    given = unit in ("cm", "inch")
    part = box(size, 0.6 * size, 0.3 * size, unit=unit if given else "auto")
    assert np.ptp(part.vertices, axis=0) == pytest.approx(np.array([1.0, 0.6, 0.3]) * metres)
    assert part.unit == unit
    assert any("the only unit" in note for note in part.notes) == (unit == "m")


@pytest.mark.parametrize(
    ("sides", "unit", "said"),
    [
        ((0.1, 0.06, 0.02), "mm", r"too small: 0.1 mm .*--units m"),
        ((100.0, 60.0, 20.0), "m", r"too large: 100 m .*--units mm, --units cm"),
        ((1e-4, 1e-4, 1e-4), "mm", "No known unit fits"),
        ((4.99, 3.0, 2.0), "auto", r"too small: 4.99 mm at its largest \(wanted: 5 to 2000 mm\)"),
        # In inches a part of 0.8 is 20 mm long, in metres 0.8 m: two units, one has to be named.
        ((0.8, 0.5, 0.2), "auto", "units"),
        ((2500.0, 1500.0, 750.0), "auto", "No known unit"),
    ],
)
def test_a_wrong_unit_is_refused_and_the_fitting_ones_named(sides, unit, said):
    with pytest.raises(MeshError, match=said):
        box(*sides, unit=unit)


def test_unknown_units_and_sides_list_the_known_ones():
    with pytest.raises(InputError, match=r"'ft'. Known: cm, inch, m, mm"):
        box(100.0, 60.0, 20.0, unit="ft")
    with pytest.raises(InputError, match=r"'up'. Known: -x, -y, -z, X,Y,Z, auto"):
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
