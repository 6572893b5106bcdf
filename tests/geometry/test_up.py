"""Which side looks up: as named, or by the part; turn the part, and up and its region turn with it."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from polish_sim.errors import InputError
from polish_sim.geometry import PartMesh, part_from_arrays
from polish_sim.geometry.orientation import choose_up
from tests.geometry.shapes import BALL, BLOCK, grid_faces, part_of, prism


def test_a_part_with_a_curved_face_stands_on_its_flat_bottom_or_looks_up_with_the_mean_of_the_face():
    # Half a wave over a flat bottom: the mean of the wave leans by more than 5 deg, the bottom does not.
    x = np.linspace(0.0, 80.0, 41)
    height = 30.0 + 8.0 * np.sin(x / 80.0 * 1.5 * np.pi)
    outline = np.concatenate([np.column_stack([x, height]), [[80.0, 0.0], [0.0, 0.0]]])
    assert abs(np.degrees(np.arctan2(height[-1] - height[0], 80.0))) > 5.0
    assert part_of(prism(outline, 60.0), "auto").up.tolist() == [0.0, 0.0, 1.0]
    way = np.array([1.0, 2.0, 2.0]) / 3.0
    faces = BALL.faces[(BALL.triangles_center @ way) > 40.0]
    cap = part_from_arrays(np.array(BALL.vertices), faces, unit="mm")
    assert np.degrees(np.arccos(cap.up @ way)) < 0.5


def sheet(points: np.ndarray) -> PartMesh:
    """An open sheet of facets between the points [mm] of a grid, shape (n, m, 3)."""
    mesh = trimesh.Trimesh(points.reshape(-1, 3), grid_faces(*points.shape[:2]))
    mesh.merge_vertices(digits_vertex=6)
    return part_of(mesh, "auto")


def test_a_dome_with_a_hole_looks_up_along_its_axis_however_it_is_turned():
    # From anywhere within 29 deg of its axis a dome that ends at 75 deg shows the whole cone of 46 deg.
    polar = np.linspace(np.arcsin(15 / 80), np.radians(75), 40)[:, None]
    around = np.linspace(0, 2 * np.pi, 91)
    ring = [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar) + 0.0 * around]
    part = sheet(80.0 * np.stack(ring, axis=-1))
    assert part.up.tolist() == [0.0, 0.0, 1.0]
    R = Rotation.random(random_state=3).as_matrix()
    assert choose_up(part.vertices @ R.T, part.faces, "auto")[0] == pytest.approx(R[:, 2], abs=1e-9)


def test_an_axis_of_the_file_is_taken_where_a_wavy_sheet_looks_along_it_but_for_rounding():
    x, y = np.meshgrid(np.linspace(-90, 90, 61), np.linspace(-90, 90, 61), indexing="ij")
    points = np.stack([x, y, 3.0 * np.sin(x / 30.0) * np.cos(y / 35.0)], axis=-1)
    # The waves do not end where they began: the mean normal leans by (z(90, y) - z(-90, y)) / 180, 1 mrad.
    assert sheet(points).up.tolist() == [0.0, 0.0, 1.0]
    tilt = Rotation.from_euler("y", 10.0, degrees=True).as_matrix()
    assert np.degrees(np.arccos(sheet(points @ tilt.T).up @ tilt[:, 2])) < 0.1


def test_up_may_be_a_side_or_a_vector_of_any_length_and_what_is_no_direction_is_refused():
    given = {"x": [1, 0, 0], "-y": [0, -1, 0], "1, 2, 2": [1 / 3, 2 / 3, 2 / 3], "-1e-200,0,0": [-1, 0, 0]}
    for text, expected in given.items():
        assert part_of(BLOCK, text).up == pytest.approx(expected, abs=1e-12)
    for text in ("0,0,0", "1,2", "a,b,c", "nan,0,1", "1e400,0,0"):
        with pytest.raises(InputError, match="is not a direction"):
            part_of(BLOCK, text)


@pytest.mark.parametrize(
    ("solid", "up"),
    [
        (BLOCK, [0.0, 0.0, 1.0]),
        (trimesh.creation.box((100.0, 6.0, 80.0)), [0.0, 1.0, 0.0]),
        # What looks the same from its own z has that up.
        (trimesh.creation.uv_sphere(radius=30.0), [0.0, 0.0, 1.0]),
        (trimesh.creation.box((30.0, 30.0, 30.0)), [0.0, 0.0, 1.0]),
    ],
)
def test_up_is_where_the_largest_smooth_face_looks(solid, up):
    assert part_of(solid, "auto").up.tolist() == up


def test_the_largest_face_may_be_a_slope_or_one_of_two_alike_and_a_bar_has_a_side_of_the_file_up():
    # A wedge: its slope is the largest face, whatever the size.
    wedge = trimesh.convex.convex_hull([[0, 0, 0], [9, 0, 0], [0, 6, 0], [9, 6, 0], [0, 0, 3], [0, 6, 3.0]])
    for size in (0.02, 1.5):
        part = part_from_arrays(np.array(wedge.vertices) * size / 9.0, np.array(wedge.faces))
        assert part.up == pytest.approx(np.array([1.0, 0.0, 3.0]) / 10**0.5, abs=1e-9)
    part = part_of(trimesh.creation.torus(major_radius=40.0, minor_radius=10.0), "auto")
    # Both sides are alike; which it is depends on the order of the facets.
    assert np.abs(part.up) == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert any("assumed" in note for note in part.notes)
    up = part_of(trimesh.creation.cylinder(20.0, 80.0, sections=57), "auto").up
    assert sorted(np.abs(up)) == [0.0, 0.0, 1.0]
    assert up[2] == 0.0
