"""Broken meshes: what is mended is mended right and said, with its place; what is left is said too."""

from itertools import pairwise, product

import numpy as np
import pytest
import trimesh

from benchmarks.fuzz import LARGEST, run_apart, try_files
from benchmarks.rounded_parts import draw_turned_part
from polish_sim.errors import MeshError
from polish_sim.geometry import fit_surface, load_part, part_from_arrays
from tests.geometry.shapes import BLOCK, at_middle, grid_faces, memory_to_load, stl_bytes

BALL = trimesh.creation.icosphere(subdivisions=3, radius=40.0)


def soup(mesh):
    return np.array(mesh.triangles)


def as_trimesh(part):
    return trimesh.Trimesh(part.vertices, part.faces, process=False)


def is_solid(part, volume, rel=1e-6):
    mesh = as_trimesh(part)
    return mesh.is_watertight and mesh.volume == pytest.approx(1e-9 * volume, rel=rel)


def said(part, *words):
    return any(all(word in note for word in words) for note in part.notes)


def joined(*meshes):
    triangles = np.concatenate(meshes, dtype=np.float64)
    return part_from_arrays(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), unit="mm")


def test_empty_double_and_flipped_facets_are_dropped_or_turned_so_that_bodies_look_outward():
    triangles = soup(BALL)
    corner, edge = triangles[0, 0], triangles[0, 1]
    empty = [[corner, edge, corner], [corner, corner, corner]]
    part = joined(empty, triangles, triangles[:40:2], triangles[100:120, ::-1])
    assert part.stl_facets.tolist() == list(range(2, 1282))
    assert said(part, "2 facets without area")
    assert is_solid(part, BALL.volume)
    assert said(part, "40 facets that occur twice", "the first at (")
    triangles = soup(BALL)
    triangles[::3] = triangles[::3, ::-1]
    part = joined(triangles)
    assert is_solid(part, BALL.volume)
    assert said(part, "turned")
    assert said(joined(soup(BALL)[:, ::-1]), "inside out")
    hollow, other = 0.5 * soup(BLOCK), soup(BLOCK) + [150.0, 0.0, 0.0]
    for outer_way, inner_way in product((1, -1), (1, -1)):
        part = joined(soup(BLOCK)[:, ::outer_way], hollow[:, ::inner_way], other[:, ::-1])
        assert as_trimesh(part).volume == pytest.approx(1e-9 * (2 - 1 / 8) * 100 * 60 * 20)
        assert said(part, "hollow inside: 1 closed shell within")


def test_facets_without_height_tiny_gaps_and_t_junctions_are_mended_so_that_the_skin_is_closed():
    """At a T-junction bridged by a flat facet two walls share an edge that is divided on one side only."""
    a, b, left, right = np.array([[0, 0, 0], [60, 0, 0], [30, 50, 0], [30, 20, 40.0]])
    middle = 0.5 * (a + b)
    undivided, divided = [a, left, b], [[a, middle, right], [middle, b, right], [a, b, middle]]
    part = joined([undivided, *divided, [b, left, right], [left, a, right]])
    assert said(part, "flipped the long edge of 1 needle,")
    assert is_solid(part, 60 * 50 * 40 / 6)
    assert as_trimesh(part).area_faces.min() > 1e-6
    # Each side of the box is divided into its own number of strips.
    rng, triangles = np.random.default_rng(4), []
    part = joined(soup(BALL) + np.random.default_rng(0).uniform(-1e-4, 1e-4, (1280, 3, 3)))
    assert len(part.vertices) == 642
    assert said(part, "closed gaps")
    for face in soup(trimesh.creation.box((90.0, 60.0, 40.0))):
        cuts = np.sort(rng.uniform(0.1, 0.9, 3))
        line = np.concatenate([[face[0]], face[0] + cuts[:, None] * (face[1] - face[0]), [face[1]]])
        triangles += [[a, b, face[2]] for a, b in pairwise(line)]
    part = joined(np.array(triangles))
    assert is_solid(part, 90 * 60 * 40)
    assert said(part, "T-junctions", "the first at (")
    assert len(part.stl_facets) > len(triangles) == len(np.unique(part.stl_facets))


def test_small_holes_are_closed_with_place_and_size_and_a_large_one_is_left():
    triangles = soup(BALL)
    middle = triangles.mean(axis=1)
    top = middle[:, 2] > 34.0
    one = np.argmin(np.linalg.norm(middle - [40.0, 0.0, 0.0], axis=1))
    part = joined(np.delete(triangles, np.append(np.flatnonzero(top), one), axis=0))
    assert said(part, "closed 1 small hole", "mm wide at (")
    assert said(part, "open surface", "in 1 line", "mm wide at (0, 0, 3")
    assert len(part.faces) == 1280 - top.sum()
    assert np.count_nonzero(part.stl_facets == -1) == 1
    assert fit_surface(part).is_open
    assert is_solid(joined(np.delete(triangles, one, axis=0)), BALL.volume, rel=1e-4)


def test_bodies_are_counted_and_measured_loose_fins_dropped_and_glued_solids_made_one():
    part = joined(soup(BLOCK), soup(BLOCK) + [0.0, 0.0, 21.0])
    assert len(part.faces) == 24
    assert said(part, "2 bodies in one file (2 of them closed)", "100 x 60 x 20; 100 x 60 x 20 mm")
    assert not said(part, "self-intersecting")
    part = joined(soup(BLOCK), soup(trimesh.creation.box((10.0, 10.0, 80.0))))
    assert said(part, "self-intersecting: ", "pass through each other")
    small = joined(soup(BALL), [[*soup(BALL)[7, :2], 1.05 * soup(BALL)[7, 2]]])
    assert said(small, "dropped 1 facets of 1 loose fins")
    assert as_trimesh(small).is_watertight
    large = joined(soup(BLOCK), [[[-50, -30, 10], [50, -30, 10], [0, 0, 60]]])
    assert said(large, "2 bodies in one file (1 of them closed)")
    right = (soup(BLOCK) * [-1.0, 1.0, 1.0])[:, ::-1] + [100.0, 0.0, 0.0]
    part = joined(soup(BLOCK), right)
    assert is_solid(part, 200 * 60 * 20)
    assert said(part, "walls inside the part")
    for way in (1, -1):
        part = joined(soup(BLOCK)[:, ::way], (soup(BLOCK) + [100.0, 60.0, 0.0])[:, ::way])
        assert is_solid(part, 2 * 100 * 60 * 20)
        assert as_trimesh(part).body_count == 2
        assert said(part, "1 edges of more than two facets", "the first at (50, 30, 0) mm")


def dome(noise, seed=0):
    """A cap of a 100 mm ball, 1 mm facets, on a 50 mm square: vertices and faces [m]."""
    x, y = np.meshgrid(np.linspace(-0.025, 0.025, 51), np.linspace(-0.025, 0.025, 51), indexing="ij")
    points = np.stack([x, y, np.sqrt(0.1**2 - x**2 - y**2)], axis=-1).reshape(-1, 3)
    scatter = np.random.default_rng(seed).normal(scale=noise, size=points.shape) if noise else 0.0
    return points + scatter, grid_faces(51, 51)


def noise_mm(part):
    """The noise a part is said to have [mm]."""
    note = next(note for note in part.notes if "scanned noise" in note)
    return float(note.split()[3])


@pytest.mark.parametrize("noise", [0.00002, 0.0001])
def test_scanned_noise_is_measured_smoothed_and_said(noise):
    part = part_from_arrays(*dome(noise), up="z")
    assert noise_mm(part) == pytest.approx(1e3 * noise, rel=0.15)
    surface = fit_surface(part)
    inside = np.abs(surface.vertices[:, :2]).max(axis=1) < 0.020
    radius = np.linalg.norm(surface.vertices[inside], axis=1)
    assert np.sqrt(np.mean((radius - 0.1) ** 2)) < 0.35 * noise
    facets = np.flatnonzero(inside[surface.faces].all(axis=1)).astype(np.int32)
    points, normals = at_middle(surface, facets)
    tilt = np.arccos(np.clip((normals * points).sum(axis=1) / np.linalg.norm(points, axis=1), -1.0, 1.0))
    assert np.degrees(np.sqrt(np.mean(tilt**2))) < 0.4 * noise / 0.00005
    assert part.noise.slope == pytest.approx(np.sqrt(np.mean(tilt**2)), rel=0.35)
    assert np.sqrt(np.mean((radius - 0.1) ** 2)) < part.noise.offset < noise
    assert surface.smooth[facets].all()  # noise makes no creases


def test_noise_is_found_on_a_scan_s_flat_base_not_on_exact_parts_and_leaves_creases_sharp():
    """Exact walls and base have more vertices than the scan; thin facets along creases are no needles."""
    points, faces = dome(0.00005)
    base = [np.column_stack([points[:, :2], np.full(len(points), height)]) for height in (0.0, 0.01)]
    below = np.concatenate([faces[:, ::-1] + len(points), faces + 2 * len(points)])
    part = part_from_arrays(np.concatenate([points, *base]), np.concatenate([faces, below]), up="z")
    assert noise_mm(part) == pytest.approx(0.05, rel=0.15)
    points, faces = dome(0.0)
    part = part_from_arrays(points, faces, up="z")
    assert not said(part, "noise")
    assert part.noise == (0.0, 0.0)
    assert np.abs(part.vertices[part.faces] - points[faces]).max() == 0.0
    # Its rings about a rounding look scattered to a piece fitted over them.
    turned = draw_turned_part(556)
    assert part_from_arrays(turned.vertices, turned.faces, "mm", "z").noise == (0.0, 0.0)
    assert not said(joined(soup(BLOCK.subdivide_to_size(30.0)) * [1.0, 1.0, 0.02]), "needles")
    # Two planes that meet at 60 deg, scattered by 5 % of their edges.
    points, faces = dome(0.0)
    points[:, 2] = -np.abs(points[:, 0]) * np.tan(np.radians(30.0))
    points += np.random.default_rng(3).normal(scale=0.00005, size=points.shape)
    part = part_from_arrays(points, faces, up="z")
    off = np.abs(part.vertices[:, 2] + np.abs(part.vertices[:, 0]) * np.tan(np.radians(30.0)))
    assert said(part, "scanned noise")
    assert np.sqrt(np.mean(off**2)) < 0.00005
    assert off.max() < 0.0003


def test_needles_on_a_ball_are_flipped_and_no_longer_bend_its_normals():
    """Facets split at a point beside one edge, as careless meshing leaves them: height 1 % of the edge."""
    rng = np.random.default_rng(0)
    points, faces = [*np.array(BALL.vertices)], [tuple(face) for face in np.array(BALL.faces)]
    for number in rng.choice(1280, 60, replace=False):
        a, b, c = faces[number]
        start = points[a] + rng.uniform(0.3, 0.7) * (points[b] - points[a])
        inward = points[c] - start
        beside = start + 0.01 * np.linalg.norm(points[b] - points[a]) * inward / np.linalg.norm(inward)
        points.append(40.0 * beside / np.linalg.norm(beside))
        faces[number] = (a, b, len(points) - 1)
        faces += [(b, c, len(points) - 1), (c, a, len(points) - 1)]
    part = part_from_arrays(np.array(points), np.array(faces), unit="mm")
    assert said(part, "flipped the long edge of 60 needles", "the first at (")
    assert as_trimesh(part).is_watertight
    positions, normals = at_middle(fit_surface(part))
    radius = np.linalg.norm(positions, axis=1)
    assert np.abs(radius - 0.04).max() < 1e-6
    assert np.degrees(np.arccos((normals * positions).sum(axis=1) / radius)).max() < 0.02


def test_broken_files_are_read_or_refused_without_traceback_hang_or_more_memory_than_whole_ones(tmp_path):
    """A byte lost in the middle; wrong corners, so that nearly every edge is a border; loose triangles."""
    file, rng, other = tmp_path / "broken.stl", np.random.default_rng(0), np.random.default_rng(1)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=50.0)
    whole = ball.export(file_type="stl")
    broken = np.frombuffer(whole[84:500_084] + whole[500_085:] + b"\0", dtype="V50")
    # Numbers that are not finite are refused as such: let all be finite.
    corners = np.array(broken.view("V12,V36,V2")["f1"]).view("<f4").reshape(-1, 3, 3)
    with np.errstate(invalid="ignore"):
        corners = np.nan_to_num(corners, nan=0.0, posinf=0.0, neginf=0.0).clip(-60.0, 60.0)
    faces, count = np.array(ball.faces), len(ball.vertices)
    faces = np.concatenate([faces, rng.integers(count, size=(len(faces) // 4, 3))])
    wrong = rng.random(len(faces)) < 0.28
    faces[wrong, 0] = rng.integers(count, size=int(wrong.sum()))
    for triangles in (corners, ball.vertices[faces], other.uniform(-60.0, 60.0, (14_400, 3, 3))):
        file.write_bytes(stl_bytes(triangles))
        assert memory_to_load(file) < 60
    with pytest.raises(MeshError, match=r"14400 of 14400 facets .* facet 0"):
        load_part(file)
    outcome = try_files(first_seed=10_000, count=56, folder=tmp_path)
    assert not outcome.faults
    # Edges without length that repairs leave.
    assert not try_files(first_seed=50_003, count=1, folder=tmp_path).faults
    assert min(outcome.counts["read"], outcome.counts["refused"]) > 10
    outcome = run_apart(first_seed=0, count=7)
    assert not outcome.faults
    assert sum(outcome.counts.values()) == 7
    assert outcome.peak < LARGEST
