"""Regions of several pieces, polygons, closed skins: all of it, cleanly cut, each piece with its own border."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from polish_sim.errors import InputError, PlanError
from polish_sim.geometry import PartMesh, Region, fit_surface, load_part, merge_regions, part_from_arrays, select_region

BLOCK = trimesh.creation.box((100.0, 60.0, 20.0))
BALL = trimesh.creation.icosphere(subdivisions=4, radius=50.0)
TORUS = trimesh.creation.torus(major_radius=40.0, minor_radius=15.0, major_sections=96, minor_sections=48)


def part_of(mesh: trimesh.Trimesh, up: str = "z") -> PartMesh:
    """A part from a mesh in mm."""
    return part_from_arrays(np.array(mesh.vertices), np.array(mesh.faces), unit="mm", up=up)


def region_of(mesh: trimesh.Trimesh, choice: str, up: str = "z", margin: float = 0.0) -> Region:
    part = part_of(mesh, up)
    return select_region(fit_surface(part), part, choice, edge_margin=margin)


def turns(loop: np.ndarray, axis: np.ndarray) -> float:
    """Signed area enclosed, seen against the axis."""
    return 0.5 * float(np.cross(loop[:-1] - loop[0], loop[1:] - loop[0]).sum(axis=0) @ axis)


def steps() -> trimesh.Trimesh:
    """Two steps, 60 x 40 mm and, 10 mm lower, 80 x 40 mm."""
    outline = np.array([[0, 0], [140, 0], [140, 20], [60, 20], [60, 30], [0, 30.0]])
    ends = [np.column_stack([outline[:, 0], np.full(6, y), outline[:, 1]]) for y in (0.0, 40.0)]
    side = np.array([[3, 4, 5], [3, 5, 0], [3, 0, 1], [3, 1, 2]])
    i, j = np.arange(6), (np.arange(6) + 1) % 6
    walls = np.concatenate([np.stack([i, j + 6, j], -1), np.stack([i, i + 6, j + 6], -1)])
    return trimesh.Trimesh(np.concatenate(ends), np.concatenate([side, side[:, ::-1] + 6, walls]), process=False)


def test_a_box_over_two_steps_takes_both_the_larger_first():
    region = region_of(steps(), "box:10,5,1,130,35,100")
    one, two = region.components()
    assert one.area_m2 == pytest.approx(70.0 * 30.0 * 1e-6)
    assert two.area_m2 == pytest.approx(50.0 * 30.0 * 1e-6)
    assert one.surface.bounds[:, 2] == pytest.approx([0.02, 0.02])
    assert two.surface.bounds[:, 2] == pytest.approx([0.03, 0.03])
    assert region.area_m2 == pytest.approx(one.area_m2 + two.area_m2)
    assert len(region.boundary_loops) == 2
    # Each facet still knows which facet of the part it was.
    whole = fit_surface(part_of(steps()))
    for piece in region.components():
        middle = piece.surface.evaluate(np.arange(len(piece.facets)), np.full((len(piece.facets), 3), 1 / 3)).positions
        assert np.abs(whole.restrict(piece.facets).closest(middle).positions - middle).max() < 1e-9


def test_a_connected_region_is_its_own_component():
    region = region_of(BLOCK, "auto")
    assert region.components() == (region,)
    assert merge_regions(region.components(), region.up).area_m2 == pytest.approx(region.area_m2)


def test_slivers_of_a_selection_are_left_out_and_said():
    # The box reaches 0.02 mm over the edge of the lower step.
    region = region_of(steps(), "box:0,0,1,60.02,40,100")
    assert len(region.components()) == 1
    assert region.area_m2 == pytest.approx(60.0 * 40.0 * 1e-6)
    assert "left out 1 patch" in region.notes[0]


@pytest.mark.parametrize("up", ["z", "x", "1,0,2"])
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
    normals = region.surface.evaluate(np.arange(len(region.facets)), np.full((len(region.facets), 3), 1 / 3)).normals
    seen = float((region.surface.facet_areas * (normals @ part.up)).sum())
    assert seen == pytest.approx(flat, rel=1e-9 if up != "1,0,2" else 1e-6)


def test_a_polygon_from_a_file_is_the_same(tmp_path):
    corners = tmp_path / "corners.csv"
    corners.write_text("# x, y\n-20,-10\n30,-10\n30,12\n-20,12\n")
    region = region_of(BLOCK, f"polygon:{corners}")
    assert region.area_m2 == pytest.approx(50.0 * 22.0 * 1e-6)
    assert region_of(BLOCK, "polygon:-20,-10,0;30,-10,0;30,12,5;-20,12,5").area_m2 == pytest.approx(region.area_m2)


def test_an_outline_may_repeat_a_corner_run_straight_on_and_touch_itself():
    twice_its_first_corner = "polygon:0,0,0;10,0,0;20,0,0;20,10,0;0,10,0;0,0,0"
    assert region_of(BLOCK, twice_its_first_corner).area_m2 == pytest.approx(200e-6)
    two_squares_at_a_corner = "polygon:-10,-10,0;0,-10,0;0,0,0;10,0,0;10,10,0;0,10,0;0,0,0;-10,0,0"
    assert region_of(BLOCK, two_squares_at_a_corner).area_m2 == pytest.approx(200e-6)


@pytest.mark.parametrize(
    ("choice", "error", "words"),
    [
        ("polygon:0,0,0;1,1,1", InputError, "three or more corners"),
        ("polygon:0,0,0;10,0,0;x,1,1", InputError, "three or more corners"),
        ("polygon:0,0,0;10,0,0;20,0,5", InputError, "lie on a line seen from above"),
        ("polygon:0,0,0;0,0,5;0,0,9", InputError, "is a point seen from above"),
        ("polygon:-9,-9,0;9,9,0;9,-9,0;-9,9,0", InputError, "sides from corner 1 to 2 and from corner 3 to 4"),
        ("polygon:200,0,0;210,0,0;210,10,0", PlanError, "contains nothing of the part"),
        ("polygon:nowhere.csv", InputError, "cannot be read"),
    ],
)
def test_polygons_that_cannot_be_used_are_refused_with_the_reason(choice, error, words):
    with pytest.raises(error) as caught:
        region_of(BLOCK, choice)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("mesh", "count"), [(BALL, 6), (TORUS, 10)])
def test_all_of_a_closed_smooth_part_is_cut_into_patches_that_lie_open_and_lose_nothing(mesh, count):
    region = region_of(mesh, "all")
    pieces = region.components()
    assert len(pieces) == count
    assert region.area_m2 == pytest.approx(float(fit_surface(part_of(mesh)).facet_areas.sum()), rel=1e-6)
    for piece in pieces:
        count = len(piece.facets)
        normals = piece.surface.evaluate(np.arange(count), np.full((count, 3), 1 / 3)).normals
        # No farther from its own axis than the corner of a cube.
        assert (normals @ piece.up).min() > np.cos(np.radians(56.0))
        assert turns(piece.boundary_loops[0], piece.up) > 0.0


def test_an_open_scan_is_one_region_with_its_own_border():
    x, y = np.meshgrid(np.linspace(-50, 50, 21), np.linspace(-30, 30, 13), indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), (x**2 / 200).ravel()])
    number = np.arange(21 * 13).reshape(21, 13)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    part = part_from_arrays(vertices, faces, unit="mm")
    surface = fit_surface(part)
    for choice in ("auto", "top", "all"):
        region = select_region(surface, part, choice)
        assert len(region.facets) == len(faces)
        assert len(region.boundary_loops) == 1
    assert part.up[2] > 0.999


def test_one_facet_is_a_region(tmp_path):
    listing = tmp_path / "one.txt"
    listing.write_text("0")
    region = region_of(BLOCK, f"faces:{listing}")
    assert len(region.facets) == 1
    (loop,) = region.boundary_loops
    assert len(loop) == 4
    inner = region_of(BLOCK, f"faces:{listing}", margin=0.002)
    assert inner.area_m2 < region.area_m2


def test_pieces_that_touch_in_a_point_are_parted_there(tmp_path):
    # Two opposite corners of a chessboard of four squares, and a ring pinched to nothing at one corner.
    path = chessboard(tmp_path, 2)
    pair = chessboard_region(path, [(0, 0), (1, 1)])
    assert [round(piece.area_m2 * 1e6) for piece in pair.components()] == [100, 100]
    ring = chessboard_region(chessboard(tmp_path, 3), [(0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (1, 2), (2, 1)])
    assert len(ring.components()) == 1
    for region in (pair, ring):
        border = np.argwhere(region.surface.neighbours < 0)
        starts = region.surface.faces[border[:, 0], border[:, 1]]
        assert len(np.unique(starts)) == len(starts)
    assert len(ring.boundary_loops) == 1


def chessboard(folder: Path, squares: int) -> Path:
    """A plate whose top is a grid of 10 mm squares."""
    steps = np.arange(squares + 1) * 10.0
    x, y = np.meshgrid(steps, steps, indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    number = np.arange(x.size).reshape(x.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    path = folder / f"board{squares}.stl"
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


def chessboard_region(path: Path, squares: list[tuple[int, int]]) -> Region:
    part = load_part(path, up="z")
    count = round((len(part.faces) / 2) ** 0.5)
    listing = path.with_suffix(".txt")
    listing.write_text(" ".join(f"{2 * (i * count + j)} {2 * (i * count + j) + 1}" for i, j in squares))
    return select_region(fit_surface(part), part, f"faces:{listing}")
