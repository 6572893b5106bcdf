"""Reading parts: what is repaired is said, what cannot be used is refused with one clear message."""

import struct

import numpy as np
import pytest
import trimesh

from polish_sim.errors import InputError, MeshError
from polish_sim.geometry import load_part, part_from_arrays


def write(folder, mesh: trimesh.Trimesh, name="part.stl", kind="stl"):
    path = folder / name
    mesh.export(path, file_type=kind)
    return path


def write_triangles(folder, triangles, name="part.stl"):
    """Binary STL with exactly these corners, (m, 3, 3)."""
    triangles = np.asarray(triangles, dtype="<f4")
    record = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    record["c"] = triangles
    path = folder / name
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(triangles)) + record.tobytes())
    return path


BLOCK = trimesh.creation.box((100.0, 60.0, 20.0))


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_binary_and_ascii_give_the_same_part_in_metres(tmp_path, kind):
    part = load_part(write(tmp_path, BLOCK, kind=kind))
    assert np.ptp(part.vertices, axis=0) == pytest.approx([0.1, 0.06, 0.02])
    assert part.vertices.shape == (8, 3)
    assert part.faces.shape == (12, 3)
    assert part.name == "part"
    assert len(part.sha256) == 64
    assert any("mm" in note for note in part.notes)


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("cm", 1e-2), ("inch", 0.0254)])
def test_units_scale_the_part(tmp_path, unit, metres):
    part = load_part(write(tmp_path, trimesh.creation.box((20.0, 12.0, 6.0))), unit=unit)
    assert np.ptp(part.vertices, axis=0) == pytest.approx(np.array([20.0, 12.0, 6.0]) * metres)
    assert part.unit == unit


@pytest.mark.parametrize(
    ("size", "taken"), [(0.3, "m"), (0.786, "m"), (5.0, "mm"), (700.0, "mm"), (0.8, None), (3.0, None), (2500.0, None)]
)
def test_the_only_unit_that_makes_a_sensible_part_is_taken_and_noted(tmp_path, size, taken):
    """In inches a part of 0.8 is 20 mm long, in metres 0.8 m: two units, one has to be named."""
    file = write(tmp_path, trimesh.creation.box((size, 0.6 * size, 0.3 * size)))
    if taken is None:
        with pytest.raises(MeshError, match="units" if size < 5.0 else "No known unit"):
            load_part(file)
        return
    part = load_part(file)
    assert part.unit == taken
    assert any("the only unit" in note for note in part.notes) == (taken == "m")
    if taken == "m":
        with pytest.raises(MeshError, match="too small"):
            load_part(file, unit="mm")


def test_facets_wound_inward_or_at_random_end_up_outward(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=40.0)
    triangles = np.array(mesh.triangles)
    flipped = triangles.copy()
    flipped[::3] = flipped[::3, ::-1]
    for soup in (triangles[:, ::-1], flipped):
        part = load_part(write_triangles(tmp_path, soup))
        a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a) * (a + b + c)).sum(axis=1).min() > 0.0
        assert any("turned" in note for note in part.notes)


def test_empty_and_double_facets_are_dropped_and_reported(tmp_path):
    triangles = np.array(BLOCK.triangles)
    corner, edge = triangles[0, 0], triangles[0, 1]
    extra = np.array([triangles[3], [corner, edge, corner], [corner, corner, corner]])
    part = load_part(write_triangles(tmp_path, np.concatenate([extra[1:], triangles, extra[:1]])))
    assert len(part.faces) == 12
    assert any("2 facets without area" in note for note in part.notes)
    assert any("1 facets that occur twice" in note for note in part.notes)
    # Facets keep their numbers in the file.
    assert part.stl_facets.tolist() == list(range(2, 14))


def test_facets_without_height_are_flipped_away_so_that_the_skin_stays_closed(tmp_path):
    """A T-junction bridged by a facet whose three corners lie on a line, as CAD systems write it."""
    triangles = [list(map(tuple, triangle)) for triangle in np.array(BLOCK.triangles)]
    upper = [t for t in triangles if all(corner[2] > 0.0 for corner in t)]
    a, b = next((t[i], t[(i + 1) % 3]) for t in upper for i in range(3) if t[i][0] == t[(i + 1) % 3][0])
    middle = (a[0], 0.0, a[2])
    wall = next(t for t in triangles if t not in upper and a in t and b in t)
    end = next(corner for corner in wall if corner not in (a, b))
    triangles.remove(wall)
    # The wall's facet is split at the middle of its edge, the top's is not: a flat facet closes the slit.
    triangles += [[b, middle, end], [middle, a, end], [a, middle, b]]
    part = load_part(write_triangles(tmp_path, np.array(triangles)))
    assert any("flipped the long edge of 1 facets" in note for note in part.notes)
    assert not any("open" in note for note in part.notes)
    normals = np.cross(*(part.vertices[part.faces[:, k]] - part.vertices[part.faces[:, 0]] for k in (1, 2)))
    assert np.linalg.norm(normals, axis=1).min() > 1e-6


def test_tiny_gaps_are_closed_and_reported(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=40.0)
    shaken = np.array(mesh.triangles) + np.random.default_rng(0).uniform(-1e-4, 1e-4, (1280, 3, 3))
    part = load_part(write_triangles(tmp_path, shaken))
    assert len(part.vertices) == 642
    assert any("closed gaps" in note for note in part.notes)


def test_an_open_surface_is_allowed_and_said(tmp_path):
    part = load_part(write_triangles(tmp_path, np.array(BLOCK.triangles)[:6]))
    assert any("open surface" in note for note in part.notes)


def test_a_hollow_inside_a_body_is_not_a_second_body(tmp_path):
    outer, inner = np.array(BLOCK.triangles), 0.5 * np.array(BLOCK.triangles)[:, ::-1]
    assert len(load_part(write_triangles(tmp_path, np.concatenate([outer, inner]))).faces) == 24


@pytest.mark.parametrize(
    ("up", "expected"),
    [("x", [1, 0, 0]), ("-x", [-1, 0, 0]), ("y", [0, 1, 0]), ("-y", [0, -1, 0]), ("z", [0, 0, 1]), ("-z", [0, 0, -1])],
)
def test_up_can_be_named(tmp_path, up, expected):
    assert load_part(write(tmp_path, BLOCK), up=up).up.tolist() == expected


def test_up_is_where_the_largest_smooth_face_looks(tmp_path):
    assert load_part(write(tmp_path, BLOCK)).up.tolist() == [0.0, 0.0, 1.0]
    on_its_side = trimesh.creation.box((100.0, 6.0, 80.0))
    assert load_part(write(tmp_path, on_its_side)).up.tolist() == [0.0, 1.0, 0.0]
    # A wedge: its slope is the largest face.
    wedge = trimesh.convex.convex_hull([[0, 0, 0], [90, 0, 0], [0, 60, 0], [90, 60, 0], [0, 0, 90], [0, 60, 90.0]])
    assert load_part(write(tmp_path, wedge)).up == pytest.approx([0.5**0.5, 0.0, 0.5**0.5], abs=1e-6)
    torus = trimesh.creation.torus(major_radius=40.0, minor_radius=10.0)
    part = load_part(write(tmp_path, torus))
    # Both sides are alike; which it is hangs on the order of the facets.
    assert np.abs(part.up) == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert any("assumed" in note for note in part.notes)


def bad_files(folder):
    whole = write(folder, BLOCK, "whole.stl").read_bytes()
    text = write(folder, BLOCK, "text.stl", "stl_ascii").read_bytes()
    triangles = np.array(BLOCK.triangles)
    not_a_number = triangles.copy()
    not_a_number[5, 1, 2] = np.nan
    infinite = triangles.copy()
    infinite[7, 0, 0] = np.inf
    (folder / "folder.stl").mkdir()
    contents = {
        "empty.stl": b"",
        "blank.stl": b" \n \n",
        "header_only.stl": whole[:84].replace(b"\x0c\0\0\0", b"\0\0\0\0"),
        "no_facets.stl": b"solid empty\nendsolid empty\n",
        "cut.stl": whole[:-120],
        "cut_in_header.stl": whole[:60],
        "cut_text.stl": text[: len(text) // 2],
        "cut_text_after_facet.stl": text[: text.index(b"endfacet") + len(b"endfacet\n")],
        "garbage.stl": b"This is a letter, not a part. " * 20,
        "solid_garbage.stl": b"solid ground under our feet " * 20,
        "bad_number.stl": text.replace(b"vertex ", b"vertex x", 1),
    }
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    write_triangles(folder, not_a_number, "nan.stl")
    write_triangles(folder, infinite, "inf.stl")
    line = np.linspace(0.0, 90.0, 36).reshape(-1, 3)[:, :, None] * np.array([1.0, 2.0, 3.0]) / 4.0
    write_triangles(folder, line, "zero_area.stl")
    write_triangles(folder, np.concatenate([triangles, pinched(90.0), pinched(150.0)]), "crowded.stl")
    write_triangles(folder, moebius(), "moebius.stl")


def pinched(height):
    """Two hollows that touch along an edge: around it the solid goes on from one to the other."""
    top, foot = (0, 0, 30), (0, 0, 0)
    c, b, d, a = ((40 * np.cos(angle), 40 * np.sin(angle), 15) for angle in np.radians([0, 60, 180, 240]))
    facets = [[foot, top, a], [foot, a, c], [foot, c, top], [top, c, a]]
    facets += [[foot, top, b], [foot, b, d], [foot, d, top], [top, d, b]]
    return np.array(facets) + [0.0, 0.0, height]


def moebius():
    angle = np.linspace(0.0, 2.0 * np.pi, 25)

    def rim(side):
        ring = 40.0 + side * 10.0 * np.cos(angle / 2.0)
        return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), side * 10.0 * np.sin(angle / 2.0)])

    left, right = rim(-1.0), rim(1.0)
    left[-1], right[-1] = right[0], left[0]
    return np.concatenate(
        [np.stack([left[:-1], left[1:], right[1:]], 1), np.stack([left[:-1], right[1:], right[:-1]], 1)]
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing.stl", "no such file"),
        ("folder.stl", "is a folder"),
        ("empty.stl", "empty"),
        ("blank.stl", "empty"),
        ("header_only.stl", "no facets"),
        ("no_facets.stl", "no facets"),
        ("cut.stl", "cut short: its header announces 12 facets"),
        ("cut_in_header.stl", "not an STL file"),
        ("cut_text.stl", "cut short"),
        ("cut_text_after_facet.stl", "cut short after 1 whole facet "),
        ("garbage.stl", "not an STL file"),
        ("solid_garbage.stl", "not an STL file"),
        ("bad_number.stl", "is not a vertex"),
        ("nan.stl", "NaN or infinite, the first is facet 5"),
        ("inf.stl", "NaN or infinite, the first is facet 7"),
        ("zero_area.stl", "zero area"),
        ("crowded.stl", "2 edges are shared by more than two facets, the first at"),
        ("moebius.stl", "one-sided"),
    ],
)
def test_bad_files_are_refused_with_one_clear_message(tmp_path, name, words):
    bad_files(tmp_path)
    with pytest.raises(MeshError) as caught:
        load_part(tmp_path / name)
    message = str(caught.value)
    assert words in message
    assert name in message
    assert "\n" not in message
    assert message.endswith(".")


def test_a_wrong_unit_is_refused_and_the_fitting_ones_named(tmp_path):
    tiny = write(tmp_path, trimesh.creation.box((0.1, 0.06, 0.02)))
    with pytest.raises(MeshError, match=r"too small: 0.1 mm .*--units m"):
        load_part(tiny, unit="mm")
    huge = write(tmp_path, trimesh.creation.box((100.0, 60.0, 20.0)))
    with pytest.raises(MeshError, match=r"too large: 100 m .*--units mm, --units cm"):
        load_part(huge, unit="m")
    with pytest.raises(MeshError, match="No known unit fits"):
        load_part(write(tmp_path, trimesh.creation.box((1e-4, 1e-4, 1e-4))))


def test_a_part_of_just_the_smallest_size_is_taken_whatever_the_rounding(tmp_path):
    for size in (5.0, 5.0 * (1.0 - 1e-7)):
        load_part(write(tmp_path, trimesh.creation.box((size, 3.0, 2.0))))
    with pytest.raises(MeshError, match=r"too small: 4.99 mm at its largest \(wanted: 5 to 2000 mm\)"):
        load_part(write(tmp_path, trimesh.creation.box((4.99, 3.0, 2.0))))


def test_unknown_units_and_sides_list_the_known_ones(tmp_path):
    path = write(tmp_path, BLOCK)
    with pytest.raises(InputError, match=r"unknown unit 'ft'. Known: cm, inch, m, mm"):
        load_part(path, unit="ft")
    with pytest.raises(InputError, match=r"unknown side .*'up'. Known: -x, -y, -z, X,Y,Z, auto, x, y, z"):
        load_part(path, up="up")


@pytest.mark.parametrize("solid", [
    trimesh.creation.icosphere(subdivisions=3, radius=30.0), trimesh.creation.uv_sphere(radius=30.0),
    trimesh.creation.box((30.0, 30.0, 30.0)), trimesh.creation.torus(40.0, 10.0),
])  # fmt: skip
def test_where_a_symmetric_part_looks_the_same_from_its_own_z_that_is_up(solid):
    part = part_from_arrays(np.array(solid.vertices), np.array(solid.faces), unit="mm")
    assert part.up.tolist() == [0.0, 0.0, 1.0]


def test_a_lying_bar_has_a_side_of_the_file_up_not_one_of_its_facets():
    bar = trimesh.creation.cylinder(20.0, 80.0, sections=57)
    part = part_from_arrays(np.array(bar.vertices), np.array(bar.faces), unit="mm")
    assert sorted(np.abs(part.up)) == [0.0, 0.0, 1.0]
    assert part.up[2] == 0.0
