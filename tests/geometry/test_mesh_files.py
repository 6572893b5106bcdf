"""Parts from files and arrays: formats, units, the side that looks up, refusals."""

import struct

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from polish_sim.errors import InputError, MeshError
from polish_sim.geometry import load_part, part_from_arrays
from polish_sim.geometry.orientation import choose_up
from tests.geometry.shapes import BALL, BLOCK, grid_faces, part_of, prism, stl_bytes

COARSE_BALL = trimesh.creation.icosphere(subdivisions=2, radius=40.0)
POINTS = np.array(COARSE_BALL.vertices) + [1e-9, 0.0, 1.0 / 3.0]
FACES = np.array(COARSE_BALL.faces)


def write(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def ply(kind, rows):
    header = (
        f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex {len(POINTS)}\nproperty double x\n"
        "property uchar red\nproperty double y\nproperty double z\n"
        f"element face {len(FACES)}\nproperty float quality\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    return header.encode() + rows


def binary_ply(order="<"):
    rows = np.zeros(len(POINTS), dtype=[(name, f"{order}f8" if name != "r" else "u1") for name in "xryz"])
    rows["x"], rows["y"], rows["z"] = POINTS.T
    faces = np.zeros(len(FACES), dtype=[("q", order + "f4"), ("n", "u1"), ("i", order + "i4", 3)])
    faces["n"], faces["i"] = 3, FACES
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    return ply(kind, rows.tobytes() + faces.tobytes())


def text_ply():
    vertices = "".join(f"{float(x)!r} 7 {float(y)!r} {float(z)!r}\n" for x, y, z in POINTS)
    return ply("ascii", (vertices + "".join(f"0.5 3 {a} {b} {c}\n" for a, b, c in FACES)).encode())


def obj(face="{}", first=1):
    vertices = "".join(f"v {float(x)!r} {float(y)!r} {float(z)!r}\n" for x, y, z in POINTS)
    faces = "".join("f " + " ".join(face.format(i + first) for i in row) + "\n" for row in FACES)
    head, middle = "# by hand\nmtllib part.mtl\no ball\n", "vn 0 0 1\nvt 0 0\nusemtl steel\ns 1\n"
    return head + vertices + middle + faces + "l 1 2\n"


WAYS = {
    "binary.ply": binary_ply(),
    "big_endian.ply": binary_ply(">"),
    "text.ply": text_ply(),
    "plain.obj": obj(),
    "with_normals.obj": obj("{}//1"),
    "with_texture.obj": obj("{}/1/1"),
    "in_groups.obj": obj().replace("f ", "g ball\nf "),
    "from_behind.obj": obj(first=-len(POINTS)),
}


@pytest.mark.parametrize("name", WAYS)
def test_every_format_gives_the_same_part_at_full_precision(tmp_path, name):
    part = load_part(write(tmp_path, name, WAYS[name]))
    truth = part_from_arrays(POINTS, FACES, unit="mm")
    assert np.array_equal(part.vertices, truth.vertices)
    assert np.array_equal(part.faces, truth.faces)
    assert part.stl_facets.tolist() == list(range(len(FACES)))


@pytest.mark.parametrize(
    ("kind", "name"), [("ply", "a.stl"), ("stl", "b.ply"), ("obj", "c.stl"), ("stl_ascii", "no_ending")]
)
def test_the_content_decides_not_the_name_of_what_trimesh_writes(tmp_path, kind, name):
    COARSE_BALL.export(tmp_path / name, file_type=kind)
    part = load_part(tmp_path / name)
    assert (len(part.vertices), len(part.faces)) == (len(POINTS), len(FACES))
    middles = part.vertices[part.faces].mean(axis=1)
    assert middles == pytest.approx(1e-3 * COARSE_BALL.triangles_center, abs=1e-8)
    assert (part.name, len(part.sha256)) == (name.partition(".")[0], 64)
    assert any("mm" in note for note in part.notes)


def test_polygons_are_split_without_leaving_their_outline(tmp_path):
    """A prism over an L: its hollow end faces have six corners, its walls four."""
    outline = [(0, 0), (60, 0), (60, 20), (20, 20), (20, 50), (0, 50)]
    vertices = "".join(f"v {x} {y} {z}\n" for z in (0, 30) for x, y in outline)
    walls = "".join(f"f {i + 1} {(i + 1) % 6 + 1} {(i + 1) % 6 + 7} {i + 7}\n" for i in range(6))
    part = load_part(write(tmp_path, "l.obj", vertices + walls + "f 6 5 4 3 2 1\nf 7 8 9 10 11 12\n"))
    solid = trimesh.Trimesh(part.vertices, part.faces, process=False)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(1e-9 * 30.0 * (60 * 20 + 20 * 30))
    assert solid.area == pytest.approx(1e-6 * (2 * 1800 + 30 * 220))
    assert any("split 8 facets" in note for note in part.notes)
    assert np.bincount(part.stl_facets).tolist() == [2] * 6 + [4] * 2


STL, TEXT_STL = BLOCK.export(file_type="stl"), BLOCK.export(file_type="stl_ascii").encode()
TRIANGLES = np.array(BLOCK.triangles)
SPOILT = np.where(np.arange(12)[:, None, None] == 5, np.nan, TRIANGLES)
# Two hollows that touch along an edge: around it the solid continues from one to the other.
TOP, FOOT = (0, 0, 120), (0, 0, 90)
C, B, D, A = ((40 * np.cos(angle), 40 * np.sin(angle), 105) for angle in np.radians([0, 60, 180, 240]))
PINCHED = np.array([[FOOT, TOP, A], [FOOT, A, C], [FOOT, C, TOP], [TOP, C, A]])
PINCHED = np.concatenate([PINCHED, [[FOOT, TOP, B], [FOOT, B, D], [FOOT, D, TOP], [TOP, D, B]]])
MOEBIUS = 40.0 * np.random.default_rng(0).normal(size=(5, 3))[[[k, k - 4, k - 3] for k in range(5)]]
LINE = np.linspace(0.0, 90.0, 36).reshape(-1, 3)[:, :, None] * np.array([1.0, 2.0, 3.0]) / 4.0
HEADER = "ply\nformat ascii 1.0\n"
BINARY = HEADER.replace("ascii", "binary_little_endian")
ENDLESS = "element face 999999999999\nproperty list uint int vertex_indices\nend_header\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("missing.stl", None, "no such file"), (".", None, "is a directory"), ("empty.stl", b"", "empty"),
        ("header_only.stl", STL[:84].replace(b"\x0c\0\0\0", b"\0\0\0\0"), "two facets"),
        ("cut.stl", STL[:-120], "cut short: .* 12 facets"),
        ("cut_after_facet.stl", TEXT_STL[: TEXT_STL.index(b"endfacet") + 9], "after 1 whole facet "),
        ("lost_vertex.stl", TEXT_STL.replace(b"vertex", b"", 1), "no list of triangles .*35 vertices"),
        ("garbage.stl", b"This is a letter, not a part. " * 20, "not an STL file"),
        ("solid_garbage.stl", b"solid ground under our feet " * 20, "not an STL file"),
        ("bad_number.stl", TEXT_STL.replace(b"vertex ", b"vertex x", 1), "is not a vertex"),
        ("nan.stl", stl_bytes(SPOILT), "NaN or infinite, the first is facet 5"),
        ("zero_area.stl", stl_bytes(LINE), "zero area"), ("far.stl", stl_bytes(TRIANGLES + 1e7), " 1 apart"),
        ("crowded.stl", stl_bytes(np.concatenate([TRIANGLES, PINCHED])), "1 edges are shared by more than"),
        ("moebius.stl", stl_bytes(MOEBIUS), "one-sided"),
        ("part.mtl", "newmtl steel\n", "the .obj file itself"), ("part.igs", "S 1\n", r": \.ply, .*, \.stp"),
        ("cut.ply", binary_ply()[:-100], "cut short: .* 320 rows of 'face'"),
        ("huge.ply", BINARY + "element vertex 4000000000\n" + XYZ + "end_header\n", "4000000000 rows"),
        ("huge_faces.ply", BINARY + "element vertex 3\n" + XYZ + ENDLESS + 400 * "x", "999999999999 rows"),
        ("cloud.ply", HEADER + "element vertex 1\n" + XYZ + "end_header\n0 0 0\n", "no faces"),
        ("no_z.ply", HEADER + "element vertex 1\nproperty float x\nend_header\n0\n", "no x, y, z"),
        ("headless.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "no 'end_header'"),
        ("strange.ply", HEADER.replace("ascii", "morse") + "end_header\n", "its format is none of"),
        ("words.ply", text_ply().replace(b" 7 ", b" seven ", 1), "words where numbers"),
        ("far.obj", obj().replace("f ", "f 9999 ", 1), "refers to vertex 9998"),
        ("word.obj", obj().replace("v ", "v x", 1), "no number"), ("points.obj", "v 1 2 3\n", "two facets"),
        ("binary.obj", struct.pack("<30d", *range(30)), "not text"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_with_one_clear_message(tmp_path, name, content, words):
    with pytest.raises(MeshError, match=words) as caught:
        load_part(tmp_path / name if content is None else write(tmp_path, name, content))
    message = str(caught.value)
    assert name in message
    assert "\n" not in message
    assert message.endswith(".")


@pytest.mark.parametrize(
    ("size", "unit", "metres"),
    [
        (20.0, "cm", 0.2), (20.0, "inch", 0.508), (0.3, "m", 0.3), (0.786, "m", 0.786), (700.0, "mm", 0.7),
        (5.0 * (1.0 - 1e-7), "mm", 0.005),
    ],
)  # fmt: skip
def test_a_part_is_read_in_the_unit_named_or_the_only_one_that_makes_it_sensible(size, unit, metres):
    given = unit in ("cm", "inch")
    box = trimesh.creation.box((size, 0.6 * size, 0.3 * size))
    part = part_of(box, unit=unit if given else "auto")
    assert np.ptp(part.vertices, axis=0) == pytest.approx(np.array([1.0, 0.6, 0.3]) * metres)
    assert part.unit == unit
    assert any("the only unit" in note for note in part.notes) == (unit == "m")


@pytest.mark.parametrize(
    ("sides", "unit", "said"),
    [
        ((0.1, 0.06, 0.02), "mm", r"too small: 0.1 mm .*--units m"),
        ((100.0, 60.0, 20.0), "m", "100 m .*--units mm, --units cm"),
        ((1e-4, 1e-4, 1e-4), "mm", "No known unit fits"),
        ((4.99, 3.0, 2.0), "auto", "too small: 4.99 mm .*5 to 2000 mm"),
        # In inches a part of 0.8 is 20 mm long, in metres 0.8 m: two units, one has to be named.
        ((0.8, 0.5, 0.2), "auto", "units"),
        ((2500.0, 1500.0, 750.0), "auto", "No known unit"),
    ],
)
def test_a_wrong_unit_or_side_is_refused_and_the_fitting_ones_named(sides, unit, said):
    with pytest.raises(MeshError, match=said):
        part_of(trimesh.creation.box(sides), unit=unit)
    with pytest.raises(InputError, match=r"'ft'. Known: cm, inch, m, mm"):
        part_of(BLOCK, unit="ft")
    with pytest.raises(InputError, match=r"'up'. Known: -x, -y, -z, X,Y,Z, auto"):
        part_of(BLOCK, "up")


def test_vertices_keep_their_order_repeated_ones_are_merged_and_what_is_no_mesh_is_refused():
    points, faces = np.array(COARSE_BALL.vertices), np.array(COARSE_BALL.faces)
    part = part_from_arrays(points[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), unit="mm")
    assert len(part.vertices) == len(points)
    _, first = np.unique(faces.ravel(), return_index=True)
    assert np.array_equal(part.vertices, 1e-3 * points[faces.ravel()[np.sort(first)]])
    for vertices, triangles, said in (
        (points[:, :2], faces, r"got \(162, 2\) and \(320, 3\)"),
        (points[:50], faces, "vertices that do not exist"), (points, faces.astype(float), "whole numbers"),
        (np.where(points > 39.0, np.nan, points), faces, "NaN or infinite"),
    ):  # fmt: skip
        with pytest.raises(MeshError, match=said):
            part_from_arrays(vertices, triangles, unit="mm")


def sheet(points):
    """An open sheet of facets between the points [mm] of a grid, shape (n, m, 3)."""
    mesh = trimesh.Trimesh(points.reshape(-1, 3), grid_faces(*points.shape[:2]))
    mesh.merge_vertices(digits_vertex=6)
    return part_of(mesh, "auto")


def test_up_is_where_curved_parts_stand_or_look_as_the_file_has_it_but_for_rounding():
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
    # From anywhere within 29 deg of its axis a dome that ends at 75 deg shows the whole cone of 46 deg.
    polar = np.linspace(np.arcsin(15 / 80), np.radians(75), 40)[:, None]
    around = np.linspace(0, 2 * np.pi, 91)
    ring = [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar) + 0.0 * around]
    part = sheet(80.0 * np.stack(ring, axis=-1))
    assert part.up.tolist() == [0.0, 0.0, 1.0]
    R = Rotation.random(random_state=3).as_matrix()
    assert choose_up(part.vertices @ R.T, part.faces, "auto")[0] == pytest.approx(R[:, 2], abs=1e-9)
    x, y = np.meshgrid(np.linspace(-90, 90, 61), np.linspace(-90, 90, 61), indexing="ij")
    points = np.stack([x, y, 3.0 * np.sin(x / 30.0) * np.cos(y / 35.0)], axis=-1)
    # The waves do not end where they began: the mean normal leans by (z(90, y) - z(-90, y)) / 180, 1 mrad.
    assert sheet(points).up.tolist() == [0.0, 0.0, 1.0]
    tilt = Rotation.from_euler("y", 10.0, degrees=True).as_matrix()
    assert np.degrees(np.arccos(sheet(points @ tilt.T).up @ tilt[:, 2])) < 0.1


def test_up_is_where_the_largest_smooth_face_looks_and_the_file_s_z_where_all_sides_are_alike():
    for solid in (BLOCK, trimesh.creation.uv_sphere(radius=30.0), trimesh.creation.box((30.0, 30.0, 30.0))):
        assert part_of(solid, "auto").up.tolist() == [0.0, 0.0, 1.0]
    assert part_of(trimesh.creation.box((100.0, 6.0, 80.0)), "auto").up.tolist() == [0.0, 1.0, 0.0]


def test_up_may_be_a_side_or_a_vector_and_by_itself_the_largest_face_slopes_included():
    given = {"x": [1, 0, 0], "-y": [0, -1, 0], "1, 2, 2": [1 / 3, 2 / 3, 2 / 3], "-1e-200,0,0": [-1, 0, 0]}
    for text, expected in given.items():
        assert part_of(BLOCK, text).up == pytest.approx(expected, abs=1e-12)
    for text in ("0,0,0", "1,2", "a,b,c", "nan,0,1", "1e400,0,0"):
        with pytest.raises(InputError, match="is not a direction"):
            part_of(BLOCK, text)
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
