"""Valid mesh files in every format, and seeded ways to break their bytes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh

NASTY = (
    b"4294967295",
    b"-1",
    b"0",
    b"1e999",
    b"nan",
    b"1e-320",
    b"999999999999",
    b"2147483648",
    b"inf",
    b"x",
    b"\x00",
    b"end_header\n",
    b"endsolid",
    b"vertex",
    b"f 1 2 3 4 5 6 7 8\n",
    b"f -1 -1 -1\n",
    b"v 1\n",
    b"element face 4000000000\n",
    b"property list uchar int vertex_indices\n",
    b"\\\n",
    b"\xff\xff\xff\xff",
)
"""Pieces of text and bytes readers stumble over."""


def valid_files() -> dict[str, bytes]:
    """A small ball in every format, by file name."""
    ball = trimesh.creation.icosphere(subdivisions=1, radius=40.0)
    files = {
        "binary.stl": ball.export(file_type="stl"),
        "text.stl": ball.export(file_type="stl_ascii").encode(),
        "binary.ply": ball.export(file_type="ply"),
        "text.ply": ball.export(file_type="ply", encoding="ascii"),
        "part.obj": ball.export(file_type="obj").encode(),
    }
    files["big_endian.ply"] = _big_endian(ball)
    files["polygons.obj"] = _polygons()
    return {name: bytes(content) for name, content in files.items()}


def _big_endian(mesh: trimesh.Trimesh) -> bytes:
    header = (
        f"ply\nformat binary_big_endian 1.0\nelement vertex {len(mesh.vertices)}\nproperty double x\n"
        f"property double y\nproperty double z\nelement face {len(mesh.faces)}\n"
        "property list int int vertex_index\nelement edge 1\nproperty list uchar char unused\nend_header\n"
    )
    faces = np.column_stack([np.full(len(mesh.faces), 3), mesh.faces]).astype(">i4")
    return header.encode() + np.asarray(mesh.vertices, dtype=">f8").tobytes() + faces.tobytes() + b"\x01\x07"


def _polygons() -> bytes:
    """A prism over a star: quads and hollow polygons."""
    angle = np.arange(14) * np.pi / 7.0
    reach = np.where(np.arange(14) % 2, 20.0, 45.0)
    lines = [
        f"v {r * np.cos(a):.6f} {r * np.sin(a):.6f} {z}"
        for z in (0, 30)
        for a, r in zip(angle, reach, strict=True)
    ]
    lines += [f"f {i + 1} {(i + 1) % 14 + 1}/2 {(i + 1) % 14 + 15}//1 {i + 15}/1/1" for i in range(14)]
    ring = [str(i) for i in range(1, 15)]
    lines += ["f " + " ".join(ring[::-1]), "f " + " ".join(str(i - 15) for i in range(1, 15))]
    return ("\n".join(lines) + "\n").encode()


def file_names() -> list[str]:
    """Names of all files that are broken; "soup.stl" is a whole file of broken facets, half of the cases."""
    names = sorted(valid_files())
    return [name for pair in zip(names, ["soup.stl"] * len(names), strict=True) for name in pair]


def broken_file(name: str, files: dict[str, bytes], rng: np.random.Generator) -> bytes:
    """The bytes of a broken file: a valid one with its bytes changed, or facets that do not fit together."""
    return scrambled_soup(rng) if name == "soup.stl" else mutate(files[name], rng)


def scrambled_soup(rng: np.random.Generator) -> bytes:
    """A binary STL of two bodies whose facets are doubled, turned, left out, moved, joined wrongly,
    flattened."""
    ball = trimesh.creation.icosphere(subdivisions=int(rng.integers(0, 4)), radius=40.0)
    box = trimesh.creation.box((90.0, 60.0, float(rng.choice([0.0, 30.0])))).subdivide()
    mesh = trimesh.util.concatenate([ball, box.apply_translation(rng.choice([0.0, 30.0, 60.0], 3))])
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    share = 0.3 * rng.random() ** 3
    for break_it in rng.permutation(6)[: int(rng.integers(1, 7))]:
        hit = rng.random(len(faces)) < share
        if break_it == 0:
            faces = np.concatenate([faces, faces[hit]])
        elif break_it == 1:
            faces[hit] = faces[hit][:, ::-1]
        elif break_it == 2:
            faces = faces[~hit] if not hit.all() else faces
        elif break_it == 3:
            faces[hit, rng.integers(3)] = rng.integers(len(vertices), size=int(hit.sum()))
        elif break_it == 4:
            faces = np.concatenate([faces, rng.integers(len(vertices), size=(int(hit.sum()), 3))])
        else:
            moved = rng.random(len(vertices)) < share
            vertices[moved] += rng.normal(scale=10.0 ** rng.uniform(-6, 1), size=(int(moved.sum()), 3))
    return bytes(trimesh.Trimesh(vertices, faces, process=False).export(file_type="stl"))


def mutate(content: bytes, rng: np.random.Generator) -> bytes:
    """Break a file in one to five places."""
    for _ in range(int(rng.integers(1, 6))):
        if not content:
            break
        content = _WAYS[int(rng.integers(len(_WAYS)))](content, rng)
    return content


def _place(content: bytes, rng: np.random.Generator) -> int:
    """Somewhere in the file, its beginning half of the time."""
    return int(rng.integers(min(len(content), 400) if rng.random() < 0.5 else len(content)))


def _change_byte(content: bytes, rng: np.random.Generator) -> bytes:
    at = _place(content, rng)
    return content[:at] + bytes([int(rng.integers(256))]) + content[at + 1 :]


def _flip_bit(content: bytes, rng: np.random.Generator) -> bytes:
    at = _place(content, rng)
    return content[:at] + bytes([content[at] ^ (1 << int(rng.integers(8)))]) + content[at + 1 :]


def _cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _leave_out(content: bytes, rng: np.random.Generator) -> bytes:
    at = _place(content, rng)
    return content[:at] + content[at + int(rng.integers(1, 200)) :]


def _repeat(content: bytes, rng: np.random.Generator) -> bytes:
    at, size = _place(content, rng), int(rng.integers(1, 400))
    return content[: at + size] + content[at : at + size] * int(rng.integers(1, 4)) + content[at + size :]


def _insert_nasty(content: bytes, rng: np.random.Generator) -> bytes:
    at = _place(content, rng)
    return content[:at] + NASTY[int(rng.integers(len(NASTY)))] + content[at:]


def _replace_word(content: bytes, rng: np.random.Generator) -> bytes:
    words = content.split(b" ")
    words[int(rng.integers(len(words)))] = NASTY[int(rng.integers(len(NASTY)))]
    return b" ".join(words)


def _overwrite(content: bytes, rng: np.random.Generator) -> bytes:
    at = _place(content, rng)
    piece = (b"\xff\xff\xff\xff", b"\x00\x00\x00\x00", b"\x00\x00\x80\x7f", rng.bytes(8))[
        int(rng.integers(4))
    ]
    return content[:at] + piece + content[at + len(piece) :]


def _swap_lines(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    a, b = (int(i) for i in rng.integers(len(lines), size=2))
    lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


_WAYS: tuple[Callable[[bytes, np.random.Generator], bytes], ...] = (
    _change_byte,
    _flip_bit,
    _cut,
    _leave_out,
    _repeat,
    _insert_nasty,
    _replace_word,
    _overwrite,
    _swap_lines,
)
