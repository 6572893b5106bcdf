"""Reading PLY and OBJ beside STL: the same part whatever the format, and one clear message for a broken file."""

import struct

import numpy as np
import pytest
import trimesh

from polish_sim.errors import MeshError
from polish_sim.geometry import load_part, part_from_arrays

BALL = trimesh.creation.icosphere(subdivisions=2, radius=40.0)
POINTS = np.array(BALL.vertices) + [1e-9, 0.0, 1.0 / 3.0]
FACES = np.array(BALL.faces)


def write(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def ply_header(kind, vertex="double", extra=""):
    return (
        f"ply\nformat {kind} 1.0\ncomment made by hand\n{extra}element vertex {len(POINTS)}\n"
        f"property {vertex} x\nproperty uchar red\nproperty {vertex} y\nproperty {vertex} z\n"
        f"element face {len(FACES)}\nproperty float quality\nproperty list uchar int vertex_indices\nend_header\n"
    )


def binary_ply(order="<", vertex="f8"):
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    rows = np.zeros(
        len(POINTS), dtype=[("x", order + vertex), ("r", "u1"), ("y", order + vertex), ("z", order + vertex)]
    )
    rows["x"], rows["y"], rows["z"] = POINTS.T
    faces = np.zeros(len(FACES), dtype=[("q", order + "f4"), ("n", "u1"), ("i", order + "i4", 3)])
    faces["n"], faces["i"] = 3, FACES
    name = {"f8": "double", "f4": "float"}[vertex]
    return ply_header(kind, name).encode() + rows.tobytes() + faces.tobytes()


def text_ply():
    vertices = "".join(f"{float(x)!r} 7 {float(y)!r} {float(z)!r}\n" for x, y, z in POINTS)
    return ply_header("ascii") + vertices + "".join(f"0.5 3 {a} {b} {c}\n" for a, b, c in FACES)


def obj(face="{}"):
    vertices = "".join(f"v {float(x)!r} {float(y)!r} {float(z)!r}\n" for x, y, z in POINTS)
    faces = "".join("f " + " ".join(face.format(i + 1) for i in row) + "\n" for row in FACES)
    return (
        "# by hand\nmtllib part.mtl\no ball\n" + vertices + "vn 0 0 1\nvt 0 0\nusemtl steel\ns 1\n" + faces + "l 1 2\n"
    )


WAYS = {
    "binary.ply": binary_ply(),
    "big_endian.ply": binary_ply(">"),
    "text.ply": text_ply(),
    "plain.obj": obj(),
    "with_normals.obj": obj("{}//1"),
    "with_texture.obj": obj("{}/1/1"),
    "from_behind.obj": obj().replace("f ", "g ball\nf "),
}


@pytest.mark.parametrize("name", WAYS)
def test_every_format_gives_the_same_part_at_full_precision(tmp_path, name):
    part = load_part(write(tmp_path, name, WAYS[name]))
    truth = part_from_arrays(POINTS, FACES, unit="mm")
    assert np.array_equal(part.vertices, truth.vertices)
    assert np.array_equal(part.faces, truth.faces)
    assert part.stl_facets.tolist() == list(range(len(FACES)))


def test_single_precision_ply_and_trimesh_s_own_files_are_read_too(tmp_path):
    single = load_part(write(tmp_path, "single.ply", binary_ply(vertex="f4")))
    assert single.vertices == pytest.approx(part_from_arrays(POINTS, FACES, unit="mm").vertices, abs=1e-8)
    for kind in ("ply", "obj", "stl"):
        path = tmp_path / f"trimesh.{kind}"
        BALL.export(path)
        assert len(load_part(path).faces) == len(FACES)


def test_vertices_keep_their_order_and_repeated_ones_are_merged():
    points, faces = np.array(BALL.vertices), np.array(BALL.faces)
    part = part_from_arrays(points[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), unit="mm")
    assert len(part.vertices) == len(points)
    _, first = np.unique(faces.ravel(), return_index=True)
    assert np.array_equal(part.vertices, 1e-3 * points[faces.ravel()[np.sort(first)]])


def test_negative_obj_numbers_count_from_behind_and_objects_are_joined(tmp_path):
    one = obj()
    count = len(POINTS)
    back = "".join("f " + " ".join(str(int(i) - count) for i in row) + "\n" for row in FACES)
    text = one[: one.index("f ")] + back
    assert len(load_part(write(tmp_path, "back.obj", text)).faces) == len(FACES)


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
    # Both halves of a wall carry the wall's number.
    assert np.bincount(part.stl_facets).tolist() == [2] * 6 + [4] * 2


def test_the_content_decides_not_the_name(tmp_path):
    for kind, name in (("ply", "a.stl"), ("stl", "b.ply"), ("obj", "c.stl"), ("ply", "no_ending")):
        path = tmp_path / name
        BALL.export(path, file_type=kind)
        assert len(load_part(path).faces) == len(FACES)


HEADER = "ply\nformat ascii 1.0\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("part.mtl", "newmtl steel\n", "name the .obj file itself"),
        ("part.igs", "S 1\n", r"Export the part as one of: \.ply, \.stl, \.obj, \.step, \.stp"),
        ("cut.ply", binary_ply()[:-100], "cut short: its header announces 320 rows of 'face'"),
        ("cut_text.ply", text_ply()[:-100], "cut short"),
        ("huge.ply", HEADER.replace("ascii", "binary_little_endian") + "element vertex 4000000000\nproperty float x\n"
         "property float y\nproperty float z\nend_header\n", "announces 4000000000 rows"),
        ("cloud.ply", HEADER + "element vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
         "0 0 0\n", "no faces"),
        ("no_z.ply", HEADER + "element vertex 1\nproperty float x\nproperty float y\nend_header\n0 0\n", "no x, y, z"),
        ("headless.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "no 'end_header'"),
        ("words.ply", text_ply().replace(" 7 ", " seven ", 1), "words where numbers"),
        ("strange.ply", HEADER.replace("ascii", "morse") + "end_header\n", "its format is none of"),
        ("far.obj", obj().replace("f ", "f 9999 ", 1), "refers to vertex 9998"),
        ("zero.obj", obj().replace("f ", "f 0 ", 1), "refers to vertex -1"),
        ("word.obj", obj().replace("v ", "v x", 1), "no number"),
        ("short.obj", obj().replace("# by hand", "v 1 2"), "no three numbers"),
        ("points.obj", "v 1 2 3\nv 1 2 4\nv 1 3 4\n", "no facets"),
        ("binary.obj", struct.pack("<30d", *range(30)), "not text"),
        ("nan.obj", obj().replace("v ", "v nan nan nan\nv ", 1).replace("f ", "f 1 2 3\nf ", 1), "NaN"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_with_one_clear_message(tmp_path, name, content, words):
    path = write(tmp_path, name, content)
    with pytest.raises(MeshError, match=words) as caught:
        load_part(path)
    message = str(caught.value)
    assert name in message
    assert "\n" not in message
    assert message.endswith(".")


def test_arrays_that_are_no_mesh_are_refused():
    with pytest.raises(MeshError, match=r"got \(162, 2\) and \(320, 3\)"):
        part_from_arrays(POINTS[:, :2], FACES)
    with pytest.raises(MeshError, match="vertices that do not exist"):
        part_from_arrays(POINTS[:50], FACES, unit="mm")
    with pytest.raises(MeshError, match="whole numbers"):
        part_from_arrays(POINTS, FACES.astype(float), unit="mm")
    with pytest.raises(MeshError, match="NaN or infinite"):
        part_from_arrays(np.where(POINTS > 39.0, np.nan, POINTS), FACES, unit="mm")
