"""Turn and move the part: the same side looks up, the same region is chosen; and what up may be."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from polish_sim.errors import InputError
from polish_sim.geometry import PartMesh, fit_surface, load_part, part_from_arrays, select_region
from polish_sim.geometry.orientation import choose_up
from polish_sim.models import workpiece_path


def turned(part: PartMesh, R: np.ndarray, shift: np.ndarray) -> PartMesh:
    vertices = part.vertices @ R.T + shift
    return replace(part, vertices=vertices, up=choose_up(vertices, part.faces, "auto")[0])


@pytest.mark.parametrize("name", ["freeform", "plate_two_holes", "wheel_hub_rim"])
def test_a_turned_part_has_the_same_up_and_the_same_region(name):
    part = load_part(workpiece_path(name))
    assert part.up == pytest.approx([0.0, 0.0, 1.0])
    surface = fit_surface(part)
    for seed in (1,):
        R, shift = Rotation.random(random_state=seed).as_matrix(), np.array([0.3, -0.2, 0.1])
        other = turned(part, R, shift)
        assert np.abs(other.up - R @ part.up).max() < 1e-9
        other_surface = fit_surface(other)
        for choice, margin in (("auto", 0.0), ("all", 0.0), ("auto", 0.003)):
            region = select_region(surface, part, choice, edge_margin=margin)
            same = select_region(other_surface, other, choice, edge_margin=margin)
            assert len(region.boundary_loops) == len(same.boundary_loops)
            for loop, other_loop in zip(region.boundary_loops, same.boundary_loops, strict=True):
                assert loop.shape == other_loop.shape
                assert np.abs(loop @ R.T + shift - other_loop).max() < 1e-9
            assert np.array_equal(region.facets, same.facets)


@pytest.mark.parametrize("size", [0.02, 1.5])
def test_up_does_not_hang_on_the_size_of_the_part(size):
    wedge = trimesh.convex.convex_hull([[0, 0, 0], [9, 0, 0], [0, 6, 0], [9, 6, 0], [0, 0, 3], [0, 6, 3.0]])
    part = part_from_arrays(np.array(wedge.vertices) * size / 9.0, np.array(wedge.faces))
    # The slope is the largest face, and flat: it looks straight up.
    assert part.up == pytest.approx(np.array([1.0, 0.0, 3.0]) / 10**0.5, abs=1e-9)


def test_a_part_with_a_curved_face_stands_straight_on_its_flat_bottom():
    # Half a wave over a flat bottom: the mean of the wave leans by more than 5 deg, the bottom does not.
    x = np.linspace(0.0, 80.0, 41)
    height = 30.0 + 8.0 * np.sin(x / 80.0 * 1.5 * np.pi)
    top, bottom = (np.stack([x, np.zeros(41), z], axis=-1) for z in (height, np.zeros(41)))
    wide = np.array([0.0, 60.0, 0.0])
    points = np.concatenate([top, top + wide, bottom, bottom + wide])
    hull = []
    for a, b, outward in ((0, 41, 1), (82, 123, -1), (82, 0, 1), (41, 123, 1)):
        i = np.arange(40)
        strip = np.concatenate([np.stack([a + i, a + i + 1, b + i + 1], -1), np.stack([a + i, b + i + 1, b + i], -1)])
        hull.append(strip[:, ::outward])
    hull.append(np.array([[0, 41, 123], [0, 123, 82], [40, 163, 81], [40, 122, 163]]))
    part = part_from_arrays(points, np.concatenate(hull), unit="mm")
    slopes = np.degrees(np.arctan2(height[-1] - height[0], 80.0))
    assert abs(slopes) > 5.0
    assert part.up.tolist() == [0.0, 0.0, 1.0]


def test_a_part_without_a_flat_face_to_stand_on_looks_up_with_the_mean_of_its_face():
    cap = trimesh.creation.icosphere(subdivisions=4, radius=50.0)
    way = np.array([1.0, 2.0, 2.0]) / 3.0
    faces = cap.faces[(cap.triangles_center @ way) > 40.0]
    part = part_from_arrays(np.array(cap.vertices), faces, unit="mm")
    assert np.degrees(np.arccos(part.up @ way)) < 0.5


def sheet(points: np.ndarray) -> PartMesh:
    """An open sheet of facets between the points [mm] of a grid, shape (n, m, 3)."""
    n, m = points.shape[:2]
    at = (np.arange(n - 1)[:, None] * m + np.arange(m - 1)).ravel()
    faces = np.concatenate([np.stack([at, at + m, at + m + 1], -1), np.stack([at, at + m + 1, at + 1], -1)])
    mesh = trimesh.Trimesh(points.reshape(-1, 3), faces)
    mesh.merge_vertices(digits_vertex=6)
    return part_from_arrays(np.array(mesh.vertices), np.array(mesh.faces), unit="mm")


def test_a_dome_with_a_hole_looks_up_along_its_axis_however_it_is_turned():
    # From anywhere within 29 deg of its axis a dome that ends at 75 deg shows the whole cone of 46 deg.
    polar, around = np.meshgrid(np.linspace(np.arcsin(15 / 80), np.radians(75), 40), np.linspace(0, 2 * np.pi, 91))
    polar, around = polar.T, around.T
    ring = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    part = sheet(80.0 * ring)
    assert part.up.tolist() == [0.0, 0.0, 1.0]
    R = Rotation.random(random_state=3).as_matrix()
    assert turned(part, R, np.zeros(3)).up == pytest.approx(R[:, 2], abs=1e-9)


def test_an_axis_of_the_file_is_taken_where_a_wavy_sheet_looks_along_it_but_for_rounding():
    x, y = np.meshgrid(np.linspace(-90, 90, 61), np.linspace(-90, 90, 61), indexing="ij")
    points = np.stack([x, y, 3.0 * np.sin(x / 30.0) * np.cos(y / 35.0)], axis=-1)
    # The waves do not end where they began: the mean normal leans by (z(90, y) - z(-90, y)) / 180, 1 mrad.
    assert sheet(points).up.tolist() == [0.0, 0.0, 1.0]
    tilt = Rotation.from_euler("y", 10.0, degrees=True).as_matrix()
    assert np.degrees(np.arccos(sheet(points @ tilt.T).up @ tilt[:, 2])) < 0.1


@pytest.mark.parametrize(
    ("text", "expected"), [("0,0,1", [0, 0, 1]), ("1, 2, 2", [1 / 3, 2 / 3, 2 / 3]), ("-1e-200,0,0", [-1, 0, 0])]
)
def test_up_may_be_a_vector_of_any_length(text, expected):
    box = trimesh.creation.box((100.0, 60.0, 20.0))
    part = part_from_arrays(np.array(box.vertices), np.array(box.faces), unit="mm", up=text)
    assert part.up == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("text", ["0,0,0", "1,2", "1,2,3,4", "a,b,c", "nan,0,1", "1e400,0,0"])
def test_what_is_no_direction_is_refused(text):
    box = trimesh.creation.box((100.0, 60.0, 20.0))
    with pytest.raises(InputError, match="is not a direction"):
        part_from_arrays(np.array(box.vertices), np.array(box.faces), unit="mm", up=text)


def hexagon_of_slopes() -> PartMesh:
    """A low pyramid over a hexagon: six faces that bend by about 20 deg at the ridges, on a vertical wall."""
    angle = np.pi / 3.0 * np.arange(6)
    rim = np.column_stack([40.0 * np.cos(angle), 40.0 * np.sin(angle), np.full(6, 10.0)])
    pyramid = trimesh.convex.convex_hull(np.vstack([rim, rim * [1.0, 1.0, 0.0], [[0.0, 0.0, 25.0]]]))
    return part_from_arrays(np.array(pyramid.vertices), np.array(pyramid.faces), unit="mm", up="z")


def test_the_flood_from_a_point_stops_at_creases_of_the_feature_angle():
    part = hexagon_of_slopes()
    side = 0.5 * 40.0 * np.hypot(15.0, 40.0 * np.cos(np.pi / 6)) * 1e-6
    for feature_angle, faces in ((np.radians(10.0), 1), (np.radians(30.0), 6)):
        surface = fit_surface(part, feature_angle)
        region = select_region(surface, part, "point:20,5,18", feature_angle)
        assert len(region.facets) == faces
        # Where the ridges count as smooth the fit rounds the pyramid a little.
        assert region.area_m2 == pytest.approx(faces * side, rel=1e-9 if faces == 1 else 0.05)


def test_a_point_on_a_dome_takes_all_of_it_though_its_rim_is_steep():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=50.0)
    dome = trimesh.intersections.slice_mesh_plane(ball, [0.0, 0.0, 1.0], [0.0, 0.0, 15.0])
    part = part_from_arrays(np.array(dome.vertices), np.array(dome.faces), unit="mm", up="z")
    region = select_region(fit_surface(part), part, "point:0,0,50")
    # 72.5 deg of polar angle, more than the 46 deg auto takes.
    assert region.area_m2 == pytest.approx(2.0 * np.pi * 0.05 * 0.035, rel=2e-3)
