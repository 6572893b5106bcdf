"""The region to polish: what a person would pick, with clean borders."""

import numpy as np
import pytest
import trimesh

from polish_sim.errors import InputError, PlanError
from polish_sim.geometry import Region, fit_surface, load_part, select_region
from polish_sim.geometry.orientation import UP_CONE


@pytest.fixture
def select(tmp_path):
    """Select a region on a mesh given in mm."""

    def run(mesh: trimesh.Trimesh, choice: str, up: str = "z") -> Region:
        path = tmp_path / "part.stl"
        mesh.export(path)
        part = load_part(path, up=up)
        return select_region(fit_surface(part), part, choice)

    return run


BLOCK = trimesh.creation.box((100.0, 60.0, 20.0))
BALL = trimesh.creation.icosphere(subdivisions=4, radius=50.0)
FINE_BALL = trimesh.creation.icosphere(subdivisions=5, radius=50.0)
TORUS = trimesh.creation.torus(major_radius=40.0, minor_radius=15.0, major_sections=96, minor_sections=48)
RING = trimesh.creation.annulus(r_min=10.0, r_max=30.0, height=20.0, sections=48)


def length(loop: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(loop, axis=0), axis=1).sum())


def test_auto_takes_the_whole_top_of_a_block_and_nothing_else(select):
    region = select(BLOCK, "auto")
    assert region.area_m2 == pytest.approx(0.006)
    assert len(region.boundary_loops) == 1
    assert length(region.boundary_loops[0]) == pytest.approx(0.32)
    assert region.surface.bounds[:, 2] == pytest.approx([0.01, 0.01])
    assert region.up.tolist() == [0.0, 0.0, 1.0]


def test_auto_follows_the_side_that_looks_up(select):
    assert select(BLOCK, "auto", up="x").area_m2 == pytest.approx(60.0 * 20.0 * 1e-6)


def test_on_a_ball_auto_takes_the_cap_within_the_cone_cut_along_a_circle(select):
    region = select(FINE_BALL, "auto")
    assert region.area_m2 == pytest.approx(2.0 * np.pi * 0.05**2 * (1.0 - np.cos(UP_CONE)), rel=1e-3)
    (loop,) = region.boundary_loops
    assert np.array_equal(loop[0], loop[-1])
    # Not ragged: the border is the circle where the normal leaves the cone.
    assert np.abs(loop[:, 2] - 0.05 * np.cos(UP_CONE)).max() < 2e-4
    assert length(loop) == pytest.approx(2.0 * np.pi * 0.05 * np.sin(UP_CONE), rel=1e-3)


def test_a_ring_has_its_outer_border_first_and_its_hole_after(select):
    region = select(RING, "auto")
    assert [round(length(loop), 4) for loop in region.boundary_loops] == pytest.approx(
        [2.0 * np.pi * 0.03, 2.0 * np.pi * 0.01], rel=1e-3
    )
    # The region lies to the left: the outer loop runs counter-clockwise, the hole clockwise.
    for loop, sense in zip(region.boundary_loops, (1.0, -1.0), strict=True):
        area = 0.5 * np.cross(loop[:-1], loop[1:]).sum(axis=0)[2]
        assert sense * area > 0.0


def test_a_torus_gives_the_ring_that_looks_up(select):
    region = select(TORUS, "auto")
    outer, hole = (np.hypot(loop[:, 0], loop[:, 1]) for loop in region.boundary_loops)
    assert outer == pytest.approx(0.04 + 0.015 * np.sin(UP_CONE), abs=1e-4)
    assert hole == pytest.approx(0.04 - 0.015 * np.sin(UP_CONE), abs=1e-4)


def test_top_goes_over_creases_where_auto_stops(select):
    # A flat roof with two slopes of 40 deg: three smooth faces.
    rise = 20.0 * np.tan(np.radians(40.0))
    outline = np.array([[-50.0, 0.0], [50.0, 0.0], [50.0, 5.0], [30.0, 5.0 + rise], [-30.0, 5.0 + rise], [-50.0, 5.0]])
    front = np.insert(outline, 1, -20.0, axis=1)
    house = trimesh.convex.convex_hull(np.concatenate([front, front * [1.0, -1.0, 1.0]]))
    assert select(house, "auto").area_m2 == pytest.approx(60.0 * 40.0 * 1e-6)
    slope = 20.0 / np.cos(np.radians(40.0))
    assert select(house, "top").area_m2 == pytest.approx((60.0 + 2.0 * slope) * 40.0 * 1e-6)


def test_all_of_a_block_is_its_six_faces_the_largest_first(select):
    region = select(BLOCK, "all")
    assert region.area_m2 == pytest.approx(2.0 * (6000.0 + 2000.0 + 1200.0) * 1e-6)
    faces = region.components()
    assert [round(face.area_m2 * 1e6) for face in faces] == [6000, 6000, 2000, 2000, 1200, 1200]
    for face in faces:
        assert len(face.boundary_loops) == 1
        # A face is looked at from outside: from above, or along its own normal.
        assert face.surface.evaluate(np.array([0]), np.full((1, 3), 1 / 3)).normals[0] == pytest.approx(face.up)
    assert len(region.boundary_loops) == 6


def test_a_box_cuts_coarse_facets_along_straight_lines(select):
    region = select(BLOCK, "box:-20,-10,0,30,12,15")
    assert region.area_m2 == pytest.approx(50.0 * 22.0 * 1e-6)
    (loop,) = region.boundary_loops
    assert loop[:, :2].min(axis=0) == pytest.approx([-0.02, -0.01])
    assert loop[:, :2].max(axis=0) == pytest.approx([0.03, 0.012])
    on_border = np.isclose(loop[:, 0], -0.02) | np.isclose(loop[:, 0], 0.03)
    on_border |= np.isclose(loop[:, 1], -0.01) | np.isclose(loop[:, 1], 0.012)
    assert on_border.all()


def test_a_box_on_a_curved_part_leaves_the_surface_and_its_normals_as_they_were(select):
    region = select(BALL, "box:-20,-20,0,20,25,60")
    points = np.random.default_rng(3).uniform([-0.015, -0.015, 0.04], [0.015, 0.02, 0.06], (300, 3))
    cut = region.surface.closest(points)
    whole = select(BALL, "all").surface.closest(points)
    assert np.abs(cut.positions - whole.positions).max() < 1e-12
    assert np.abs(cut.normals - whole.normals).max() < 1e-12
    (loop,) = region.boundary_loops
    off_plane = np.abs(loop[:, :2, None] - np.array([[-0.02, 0.02], [-0.02, 0.025]])).min(axis=(1, 2))
    assert off_plane.max() < 2e-5
    assert (region.facets < 5120).all()


def test_a_point_takes_the_smooth_face_under_it(select):
    assert select(BLOCK, "point:10,10,11").area_m2 == pytest.approx(0.006)
    # A side wall, though it does not look up.
    side = select(BLOCK, "point:50,0,0")
    assert side.area_m2 == pytest.approx(60.0 * 20.0 * 1e-6)
    assert side.surface.bounds[:, 0] == pytest.approx([0.05, 0.05])


def test_faces_takes_the_listed_facets_of_the_file(select, tmp_path):
    up = np.flatnonzero(BLOCK.face_normals[:, 2] > 0.5)
    listing = tmp_path / "faces.txt"
    listing.write_text("# the top\n" + ", ".join(str(number) for number in up) + "\n")
    assert select(BLOCK, f"faces:{listing}").area_m2 == pytest.approx(0.006)


@pytest.mark.parametrize(
    ("choice", "error", "words"),
    [
        ("bottom", InputError, "unknown region 'bottom'. Valid: auto, top, all"),
        ("point", InputError, "unknown region 'point'"),
        ("auto:1", InputError, "unknown region"),
        ("point:1,2", InputError, "region 'point:1,2' is not point:X,Y,Z"),
        ("point:1,2,z", InputError, "is not point:X,Y,Z"),
        ("box:1,2,3,4,5", InputError, "6 numbers in mm"),
        ("box:1,2,3,1,5,6", InputError, "no volume"),
        ("box:200,200,200,300,300,300", PlanError, "contains nothing of the part"),
        ("box:-10,-10,-15,10,10,0", PlanError, "nothing of the region looks up"),
        ("point:0,0,90", PlanError, "80 mm away from the part"),
        ("faces:nowhere.txt", InputError, "cannot be read"),
    ],
)
def test_choices_that_cannot_be_met_are_refused_with_the_reason(select, choice, error, words):
    with pytest.raises(error) as caught:
        select(BLOCK, choice)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("text", "words"), [("1 two 3", "not a list"), ("# none", "lists no"), ("3 12", "facet 12")])
def test_bad_lists_of_faces_are_refused(select, tmp_path, text, words):
    listing = tmp_path / "faces.txt"
    listing.write_text(text)
    with pytest.raises(InputError, match=words):
        select(BLOCK, f"faces:{listing}")
