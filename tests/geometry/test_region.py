"""The region to polish: what a person would pick, cleanly cut, in pieces with a border each; its margin."""

import re

import numpy as np
import pytest
import trimesh

from polish_sim.arrays import chord_lengths
from polish_sim.errors import InputError, PlanError
from polish_sim.geometry import fit_surface, select_region
from polish_sim.geometry.orientation import UP_CONE
from tests.geometry import shapes
from tests.geometry.shapes import BALL, BLOCK, FINE_BALL, RING, at_middle, enclosed, part_of, prism, region_of


@pytest.fixture
def listed(tmp_path):
    def write(text):
        (tmp_path / "list.txt").write_text(text)
        return str(tmp_path / "list.txt")

    return write


def test_auto_takes_the_whole_top_of_a_block_and_of_a_ball_the_cap_within_the_cone():
    region = region_of(BLOCK, "auto")
    assert region.area_m2 == pytest.approx(0.006)
    assert [chord_lengths(loop).sum() for loop in region.boundary_loops] == [pytest.approx(0.32)]
    assert region.surface.bounds[:, 2] == pytest.approx([0.01, 0.01])
    assert region.up.tolist() == [0.0, 0.0, 1.0]
    assert region.components() == (region,)
    assert region_of(BLOCK, "auto", up="x").area_m2 == pytest.approx(60.0 * 20.0 * 1e-6)
    region = region_of(FINE_BALL, "auto")
    assert region.area_m2 == pytest.approx(2.0 * np.pi * 0.05**2 * (1.0 - np.cos(UP_CONE)), rel=1e-3)
    (loop,) = region.boundary_loops
    assert np.array_equal(loop[0], loop[-1])
    # Not ragged: the border is the circle where the normal leaves the cone.
    assert np.abs(loop[:, 2] - 0.05 * np.cos(UP_CONE)).max() < 2e-4
    assert chord_lengths(loop).sum() == pytest.approx(2.0 * np.pi * 0.05 * np.sin(UP_CONE), rel=1e-3)


def test_top_goes_over_creases_where_auto_stops_as_a_point_does_below_the_feature_angle():
    # A flat roof with two slopes of 40 deg: three smooth faces.
    rise = 20.0 * np.tan(np.radians(40.0))
    outline = [[-50, 0], [50, 0], [50, 5], [30, 5 + rise], [-30, 5 + rise], [-50, 5]]
    house = prism(np.array(outline, dtype=float), 40.0)
    slope = 20.0 / np.cos(np.radians(40.0))
    flat, whole = 60.0 * 40.0 * 1e-6, (60.0 + 2.0 * slope) * 40.0 * 1e-6
    assert region_of(house, "auto").area_m2 == pytest.approx(flat)
    assert region_of(house, "top").area_m2 == pytest.approx(whole)
    part = part_of(house)
    for feature_angle, area, rel in ((np.radians(30.0), flat, 1e-6), (np.radians(45.0), whole, 0.05)):
        surface = fit_surface(part, feature_angle)
        region = select_region(surface, part, f"point:0,20,{5 + rise}", feature_angle)
        # Where the ridges count as smooth the fit rounds the roof a little.
        assert region.area_m2 == pytest.approx(area, rel=rel)


def test_a_ring_has_its_outer_border_first_and_all_of_a_block_is_its_six_faces_the_largest_first():
    region = region_of(RING, "auto")
    # The region lies to the left: the outer loop runs counter-clockwise, the hole clockwise.
    for loop, radius, sense in zip(region.boundary_loops, (0.03, 0.01), (1.0, -1.0), strict=True):
        assert chord_lengths(loop).sum() == pytest.approx(2.0 * np.pi * radius, rel=1e-3)
        assert sense * enclosed(loop, region.up) > 0.0
    region = region_of(BLOCK, "all")
    assert region.area_m2 == pytest.approx(2.0 * (6000.0 + 2000.0 + 1200.0) * 1e-6)
    faces = region.components()
    assert [round(face.area_m2 * 1e6) for face in faces] == [6000, 6000, 2000, 2000, 1200, 1200]
    for face in faces:
        assert len(face.boundary_loops) == 1
        # A face is looked at from outside: from above, or along its own normal.
        assert at_middle(face.surface).normals[0] == pytest.approx(face.up)
    assert len(region.boundary_loops) == 6


def test_boxes_polygons_points_and_listed_facets_take_what_they_name_cut_along_straight_lines(listed):
    corners = "polygon:" + listed("# x, y\n-20,-10\n30,-10\n30,12\n-20,12\n")
    for choice in ("box:-20,-10,0,30,12,15", corners, "polygon:-20,-10,0;30,-10,0;30,12,5;-20,12,5"):
        region = region_of(BLOCK, choice)
        assert region.area_m2 == pytest.approx(50.0 * 22.0 * 1e-6)
        (loop,) = region.boundary_loops
        assert loop[:, :2].min(axis=0) == pytest.approx([-0.02, -0.01])
        assert loop[:, :2].max(axis=0) == pytest.approx([0.03, 0.012])
    assert region_of(BLOCK, "point:10,10,11").area_m2 == pytest.approx(0.006)
    side = region_of(BLOCK, "point:50,0,0")
    assert side.area_m2 == pytest.approx(60.0 * 20.0 * 1e-6)
    assert side.surface.bounds[:, 0] == pytest.approx([0.05, 0.05])
    up = np.flatnonzero(BLOCK.face_normals[:, 2] > 0.5)
    file = listed("# the top\n" + ", ".join(str(number) for number in up) + "\n")
    assert region_of(BLOCK, f"faces:{file}").area_m2 == pytest.approx(0.006)
    doubled = trimesh.Trimesh(BLOCK.vertices, [*BLOCK.faces, BLOCK.faces[-1]], process=False)
    one = region_of(doubled, f"faces:{listed('0 12')}")  # 12 is dropped when it is repaired
    assert len(one.facets) == 1
    assert [len(loop) for loop in one.boundary_loops] == [4]
    assert region_of(BLOCK, f"faces:{listed('0')}", margin=0.002).area_m2 < one.area_m2
    dome = trimesh.intersections.slice_mesh_plane(BALL, [0.0, 0.0, 1.0], [0.0, 0.0, 15.0])
    # 72.5 deg of polar angle, more than the 46 deg auto takes.
    assert region_of(dome, "point:0,0,50").area_m2 == pytest.approx(2.0 * np.pi * 0.05 * 0.035, rel=2e-3)


@pytest.mark.parametrize(
    ("choice", "error", "words"),
    [
        ("bottom", InputError, "'bottom'. Valid: auto, top, all"), ("faces:{# none}", InputError, "lists no"),
        ("point:1,2,z", InputError, "is not point:X,Y,Z"), ("box:1,2,3,1,5,6", InputError, "no volume"),
        ("box:1,2,3,4,5", InputError, "6 numbers in mm"), ("faces:{1 two 3}", InputError, "not a list"),
        ("box:200,200,200,300,300,300", PlanError, "contains nothing of the part"),
        ("box:-10,-10,-15,10,10,0", PlanError, "nothing of the region looks up"),
        ("point:0,0,90", PlanError, "80 mm away from the part"),
        ("faces:nowhere.txt", InputError, "cannot read the file of facet numbers 'nowhere.txt'"),
        ("faces:{3 12}", InputError, "facet 12"),
        ("polygon:0,0,0;1,1,1", InputError, "three or more corners"),
        ("polygon:0,0,0;10,0,0;x,1,1", InputError, "three or more corners"),
        ("polygon:0,0,0;10,0,0;20,0,5", InputError, "lie on a line seen from above"),
        ("polygon:0,0,0;0,0,5;0,0,9", InputError, "is a point seen from above"),
        ("polygon:-9,-9,0;9,9,0;9,-9,0;-9,9,0", InputError, "corner 1 to 2 and from corner 3 to 4"),
    ],
)  # fmt: skip
def test_choices_that_cannot_be_met_are_refused_with_the_reason(listed, choice, error, words):
    """What stands in braces stands in a file."""
    choice = re.sub(r"\{(.*)\}", lambda text: listed(text[1]), choice)
    with pytest.raises(error) as caught:
        region_of(BLOCK, choice)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_box_over_two_steps_takes_both_the_larger_first_and_leaves_out_slivers():
    # 60 x 40 mm and, 10 mm lower, 80 x 40 mm.
    steps = prism(np.array([[0, 0], [140, 0], [140, 20], [60, 20], [60, 30], [0, 30.0]]), 40.0)
    region = region_of(steps, "box:10,5,1,130,35,100")
    whole = fit_surface(part_of(steps))
    assert region.area_m2 == pytest.approx((70.0 + 50.0) * 30.0 * 1e-6)
    for piece, long, high in zip(region.components(), (70.0, 50.0), (0.02, 0.03), strict=True):
        assert piece.area_m2 == pytest.approx(long * 30.0 * 1e-6)
        assert piece.surface.bounds[:, 2] == pytest.approx([high, high])
        middle = at_middle(piece.surface).positions
        assert np.abs(whole.restrict(piece.facets).closest(middle).positions - middle).max() < 1e-9
    # The box reaches 0.02 mm over the edge of the lower step.
    region = region_of(steps, "box:0,0,1,60.02,40,100")
    assert len(region.components()) == 1
    assert region.area_m2 == pytest.approx(60.0 * 40.0 * 1e-6)
    assert "left out 1 patch" in region.notes[0]


@pytest.mark.parametrize("up", ["x", "1,0,2"])
def test_a_polygon_cuts_what_lies_under_it_along_straight_lines(up):
    # An arrow head (one corner points inward), lifted off the block: only what is seen along up counts.
    part = part_of(BLOCK, up)
    across = np.linalg.svd(part.up[None])[2][1:]
    if np.linalg.det(np.vstack([across, part.up])) < 0.0:
        across = across[::-1]
    shape = np.array([[-8.0, -7.0], [9.0, 0.0], [-8.0, 8.0], [-3.0, 0.5]])
    corners = shape @ across + 37.0 * part.up
    text = ";".join(",".join(f"{value:.9f}" for value in corner) for corner in corners)
    region = select_region(fit_surface(part), part, f"polygon:{text}")
    x, y = shape.T
    flat = 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) * 1e-6
    seen = region.surface.facet_areas @ (at_middle(region.surface).normals @ part.up)
    assert seen == pytest.approx(flat, rel=1e-9 if up != "1,0,2" else 1e-6)


@pytest.mark.parametrize(
    "outline",
    [
        "0,0,0;10,0,0;20,0,0;20,10,0;0,10,0;0,0,0",
        "-10,-10,0;0,-10,0;0,0,0;10,0,0;10,10,0;0,10,0;0,0,0;-10,0,0",  # two squares at a corner
    ],
)
def test_an_outline_may_repeat_a_corner_run_straight_on_and_touch_itself(outline):
    assert region_of(BLOCK, f"polygon:{outline}").area_m2 == pytest.approx(200e-6)


@pytest.mark.parametrize(("mesh", "count"), [(BALL, 6), (shapes.TORUS, 10)])
def test_all_of_a_closed_smooth_part_is_cut_into_patches_that_lie_open_and_lose_nothing(mesh, count):
    region = region_of(mesh, "all")
    pieces = region.components()
    assert len(pieces) == count
    assert region.area_m2 == pytest.approx(float(fit_surface(part_of(mesh)).facet_areas.sum()), rel=1e-6)
    for piece in pieces:
        # No farther from its own axis than the corner of a cube.
        assert (at_middle(piece.surface).normals @ piece.up).min() > np.cos(np.radians(56.0))
        assert enclosed(piece.boundary_loops[0], piece.up) > 0.0


def test_pieces_that_touch_in_a_point_are_parted_there(listed):
    # Two opposite corners of a chessboard of four squares, and a ring pinched to nothing at one corner.
    pair = region_of(chessboard(2), f"faces:{listed(facets_of(2, [(0, 0), (1, 1)]))}")
    assert [round(piece.area_m2 * 1e6) for piece in pair.components()] == [100, 100]
    pinched = facets_of(3, [(0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (1, 2), (2, 1)])
    ring = region_of(chessboard(3), f"faces:{listed(pinched)}")
    assert len(ring.components()) == 1
    for region in (pair, ring):
        border = np.argwhere(region.surface.neighbours < 0)
        starts = region.surface.faces[border[:, 0], border[:, 1]]
        assert len(np.unique(starts)) == len(starts)
    assert len(ring.boundary_loops) == 1


def chessboard(squares):
    """A plate whose top is a grid of 10 mm squares."""
    x, y = 10.0 * np.indices((squares + 1, squares + 1)).reshape(2, -1)
    points = np.column_stack([x, y, np.zeros(x.size)])
    return trimesh.Trimesh(points, shapes.grid_faces(squares + 1, squares + 1), process=False)


def facets_of(count, squares):
    return " ".join(f"{2 * (i * count + j)} {2 * (i * count + j) + 1}" for i, j in squares)


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
    (loop,) = region_of(FINE_BALL, margin=margin).boundary_loops
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
    below = [[0, 0], [40, 0], [40, 15], [80, 15], [80, 0], [120, 0]]
    above = [[120, 40], [80, 40], [80, 25], [40, 25], [40, 40], [0, 40]]
    points = np.column_stack([np.array(below + above), np.zeros(12)])
    left, right = "012 029 09A 0AB", "345 356 368 678"
    side = np.array([[int(corner, 16) for corner in face] for face in f"{left} {right} 238 289".split()])
    part = part_of(trimesh.Trimesh(points, side, process=False))
    surface = fit_surface(part)
    one, two = select_region(surface, part, edge_margin=0.007).components()
    # Two squares of 26 mm, each with a tip between the circles about the neck's corners.
    width = np.sqrt(49.0 - 25.0)
    tip = 10.0 * (7.0 - width) - (49.0 * np.pi / 2 - (width * 5.0 + 49.0 * np.arcsin(width / 7.0)))
    assert one.area_m2 == pytest.approx((26.0 * 26.0 + tip) * 1e-6, rel=1e-4)
    assert two.area_m2 == pytest.approx(one.area_m2, rel=1e-3)
    assert len(select_region(surface, part, edge_margin=0.004).components()) == 1
    with pytest.raises(PlanError, match=r"no place is further than about 19\.9 mm"):
        select_region(surface, part, edge_margin=0.025)
