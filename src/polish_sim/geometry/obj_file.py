"""Read Wavefront OBJ files: vertices and polygons, nothing else (text -> triangles).

trimesh's reader returns the faces grouped by material and the last group first, so that facet numbers were
lost; it counts negative vertex numbers from the end of the file instead of from the line, and splits hollow
polygons as fans.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import NoReturn

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.errors import MeshError
from polish_sim.geometry.polygon import FileTriangles, gather_triangles

_KEYWORDS = frozenset(
    b"v vt vn vp f l p o g s mtllib usemtl curv curv2 surf parm trim hole scrv sp end con mg bevel "
    b"c_interp d_interp lod cstype deg bmat step maplib usemap shadow_obj trace_obj ctech stech call csh "
    b"bsp bzp cdc cdp res".split()
)
_BEYOND_SLASH = re.compile(rb"/[^ \t\r\n]*")


def is_obj(content: bytes) -> bool:
    """Text whose first lines are comments and keywords of OBJ, the first vertex among them."""
    head = content[:4096]
    if b"\0" in head:
        return False
    for line in head.splitlines()[:-1] or head.splitlines():
        words = line.split(None, 1)
        if not words or words[0].startswith(b"#"):
            continue
        if words[0] not in _KEYWORDS:
            return False
        if words[0] == b"v":
            return True
    return False


def parse_obj(content: bytes, path: Path) -> FileTriangles:
    """Read the polygons of all objects and groups; materials, texture, normals, lines and curves are passed
    over.

    Raises:
        MeshError: No OBJ, or a line that makes no sense.
    """
    if b"\0" in content:
        broken(path, "not an OBJ file (it is not text)")
    if b"\\" in content:
        content = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    vertices: list[bytes] = []
    polygons: list[bytes] = []
    seen: list[int] = []
    for raw in content.splitlines():
        line = raw.lstrip()
        kind = line[:2]
        if kind in (b"v ", b"v\t"):
            vertices.append(line[2:])
        elif kind in (b"f ", b"f\t"):
            polygons.append(line[2:])
            seen.append(len(vertices))
    if not vertices:
        broken(path, "the OBJ file has no vertices (lines 'v x y z')")
    points = _read_vertices(vertices, path)
    indices, sizes = _read_polygons(polygons, np.array(seen, dtype=np.int64), path)
    return gather_triangles(points, indices, sizes, path)


def _read_vertices(lines: list[bytes], path: Path) -> Array:
    """Positions, shape (n, 3); a weight or a colour behind them is ignored."""
    lines = [line.partition(b"#")[0] for line in lines]
    counts = np.array([len(line.split()) for line in lines])
    if counts.min() < 3:
        broken(path, f"vertex {int(counts.argmin()) + 1} of the OBJ file has no three numbers")
    numbers = _numbers(b"\n".join(lines), int(counts.sum()), path, "a vertex")
    return numbers[(np.cumsum(counts) - counts)[:, None] + np.arange(3)]


def _read_polygons(lines: list[bytes], seen: Indices, path: Path) -> tuple[Indices, Indices]:
    """Vertex numbers from 0 of all polygons, and how many corners each has; negative ones count from
    behind."""
    text = _BEYOND_SLASH.sub(b"", b"\n".join(line.partition(b"#")[0] for line in lines))
    sizes = np.array([len(line.split()) for line in text.split(b"\n")], dtype=np.int64)[: len(lines)]
    numbers = _numbers(text, int(sizes.sum()), path, "a face")
    given = np.where(np.abs(numbers) < 2**40, numbers, 0.0).astype(np.int64)
    indices = np.where(given < 0, np.repeat(seen, sizes) + given, given - 1)
    return np.where(given == numbers, indices, -1), sizes


def _numbers(text: bytes, count: int, path: Path, what: str) -> Array:
    numbers = text_numbers(text)
    if numbers is None or len(numbers) != count:
        broken(path, f"{what} of the OBJ file holds something that is no number")
    return numbers


def text_numbers(text: bytes) -> Array | None:
    """Numbers that stand in a text, shape (n,); None if anything else does."""
    if not text.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text.decode("latin-1"), dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def broken(path: Path, what: str) -> NoReturn:
    """Refuse a file of which something is wrong with a MeshError."""
    raise MeshError(f"{path}: {printable(what)}. Export the part again.")


def printable(text: str) -> str:
    """A text of a file as a message shows it."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
