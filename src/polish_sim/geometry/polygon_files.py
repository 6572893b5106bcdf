"""Read the polygons of PLY files, ASCII or binary of either byte order, whatever their layout, and of
Wavefront OBJ files: vertices and polygons, nothing else (bytes -> triangles).

trimesh's reader refuses binary PLY files whose faces differ in their number of corners. That of OBJ returns
the faces grouped by material and the last group first, so that facet numbers were lost; it counts negative
vertex numbers from the end of the file instead of from the line, and splits hollow polygons as fans.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Indices
from polish_sim.errors import InputError, MeshError
from polish_sim.geometry.polygon import FileTriangles, gather_triangles

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
#: By the format's name; text has none
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDEX_NAMES = ("vertex_indices", "vertex_index")
_LONGEST_HEADER = 100_000


_Rows = tuple[dict[str, Array], Indices, int]
"""Columns, all items of a list in a row; how many items ``listed`` has in each row; the place behind the
table."""


class Property(NamedTuple):
    """One property of an element's rows."""

    name: str
    length: np.dtype[Any] | None  #: Type of a list's length, None for a single value
    item: np.dtype[Any]  #: Type of the value or of the list's items


class Element(NamedTuple):
    """One table of a PLY file."""

    name: str
    rows: int
    properties: list[Property]


def is_ply(content: bytes) -> bool:
    """A PLY file says so in its first line."""
    return content[:4] in (b"ply\n", b"ply\r")


def parse_ply(content: bytes, path: Path) -> FileTriangles:
    """Read the polygons of a PLY file; colours, normals, texture and other tables are passed over.

    Raises:
        MeshError: No PLY, cut short, or without vertices or faces.
    """
    elements, data, at = _read_header(content, path)
    points = sizes = indices = None
    for element in elements:
        lists = {entry.name: entry.length is not None for entry in element.properties}
        if element.name == "vertex" and any(lists.get(name, True) for name in "xyz"):
            broken(path, "the vertices of the PLY file have no x, y, z")
        listed = (
            next((name for name in _INDEX_NAMES if lists.get(name)), "") if element.name == "face" else ""
        )
        if element.name == "face" and not listed:
            broken(path, "the faces of the PLY file have no list vertex_indices")
        columns, lengths, at = _read_rows(data, at, element, listed, path)
        if element.name == "vertex":
            if not columns.keys() >= {"x", "y", "z"}:
                broken(path, "the vertices of the PLY file hold lists of different lengths")
            points = np.stack([columns[name] for name in "xyz"], axis=1)
        elif element.name == "face":
            sizes = lengths
            indices = columns[listed]
    if points is None or indices is None or sizes is None:
        missing = "vertices" if points is None else "faces (a point cloud?)"
        raise MeshError(f"{path}: the PLY file has no {missing}. Export the part as a mesh of triangles.")
    return gather_triangles(
        points, np.where(np.abs(indices) < 2**40, indices, -1).astype(np.int64), sizes, path
    )


def read_vertex_column(path: Path, names: Sequence[str]) -> tuple[Array, Array]:
    """Vertices of a PLY file in mm [m], (n, 3), and the first of these properties that they have, (n,).

    Raises:
        InputError: The file is missing, or its vertices have none of them.
        MeshError: It is no PLY file.
    """
    if not path.is_file():
        raise InputError(f"the map '{path}' is no file. Check the name and the folder.")
    elements, data, at = _read_header(path.read_bytes(), path)
    for element in elements:
        columns, _, at = _read_rows(data, at, element, "", path)
        found = [columns[name] for name in names if name in columns]
        if element.name == "vertex" and found and columns.keys() >= {"x", "y", "z"}:
            return np.stack([1e-3 * columns[name] for name in "xyz"], axis=1), found[0]
        if element.name == "vertex":
            break
    raise InputError(f"{path}: its vertices have none of the properties {', '.join(names)}.")


def _read_header(content: bytes, path: Path) -> tuple[list[Element], bytes, int]:
    """The tables, and the bytes they stand in from a place on; the numbers of a text become doubles."""
    if not is_ply(content):
        broken(path, "not a PLY file (its first line is not 'ply')")
    end = content.find(b"end_header", 0, _LONGEST_HEADER)
    line_end = content.find(b"\n", end)
    if end < 0 or line_end < 0:
        broken(path, "the PLY file is cut short: no 'end_header'")
    order = None
    elements = []
    for line in content[:end].decode("latin-1").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = _ORDERS.get(words[1] if len(words) > 1 else "")
        elif words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isascii() or not words[2].isdigit() or len(words[2]) > 12:
                broken(path, f"'{line.strip()[:80]}' is no element of a PLY file")
            elements.append(Element(words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            if not elements:
                broken(path, f"'{line.strip()[:80]}' belongs to no element")
            elements[-1].properties.append(_read_property(words, line, order, path))
    if order is None:
        broken(path, "its format is none of " + ", ".join(_ORDERS))
    return elements, *(
        (content, line_end + 1) if order else (_text_numbers(content[line_end + 1 :], path), 0)
    )


def _read_property(words: list[str], line: str, order: str | None, path: Path) -> Property:
    codes = [_TYPES.get(word, "") for word in words[1:-1] if word != "list"]
    is_list = len(words) == 5 and words[1] == "list"
    if "" in codes or len(codes) != (2 if is_list else 1):
        broken(path, f"'{line.strip()[:80]}' is no property of a PLY file")
    if is_list and codes[0] in ("f4", "f8"):
        broken(path, f"'{line.strip()[:80]}': a list's length must be a whole number")
    types = [np.dtype(order + code if order else "<f8") for code in codes]
    return Property(words[-1], types[0] if is_list else None, types[-1])


def _read_rows(data: bytes, at: int, element: Element, listed: str, path: Path) -> _Rows:
    """Read the table that begins at a byte; where lists differ in length ``listed`` is the only column
    read."""
    entries = element.properties
    smallest = sum((entry.length or entry.item).itemsize for entry in entries)
    if element.rows * smallest > len(data) - at or (smallest == 0 and element.rows > 0):
        _cut_short(path, element)
    if element.rows == 0:
        return {entry.name: np.empty(0) for entry in entries}, np.empty(0, dtype=np.int64), at
    try:
        return _read_even_rows(data, at, element, listed) or _read_uneven_rows(data, at, element, listed)
    except (ValueError, OverflowError):
        _cut_short(path, element)


def _read_even_rows(data: bytes, at: int, element: Element, listed: str) -> _Rows | None:
    """All columns, if the lists are as long in every row as in the first one."""
    fields: list[Any] = []
    sizes: dict[str, int] = {}
    for k, (entry, _, size) in enumerate(_walk_row(data, at, element)):
        fields += [(f"length {k}", entry.length)] if entry.length else []
        fields += [(f"items {k}", entry.item, (size,))]
        sizes[entry.name] = size
    row = np.dtype(fields)
    if element.rows * row.itemsize > len(data) - at:
        return None
    table = np.frombuffer(data, row, element.rows, at)
    if any((table[name] != table[name][0]).any() for name in row.names or () if name.startswith("length")):
        return None
    columns = {name: _as_numbers(table[f"items {k}"].ravel()) for k, name in enumerate(sizes)}
    return columns, np.full(element.rows, sizes.get(listed, 0)), at + table.nbytes


def _read_uneven_rows(data: bytes, at: int, element: Element, listed: str) -> _Rows:
    """The listed column alone, row by row."""
    found, sizes = [np.empty(0)], []
    for _ in range(element.rows):
        for entry, begin, size in _walk_row(data, at, element):
            at = begin + size * entry.item.itemsize
            if entry.name == listed:
                found.append(np.frombuffer(data, entry.item, size, begin))
                sizes.append(size)
    return {listed: _as_numbers(np.concatenate(found))}, np.array(sizes, dtype=np.int64), at


def _walk_row(data: bytes, at: int, element: Element) -> Iterator[tuple[Property, int, int]]:
    """Each property of a row, where its items begin, and how many they are.

    Raises:
        ValueError: The file ends within the row, or a length is negative.
    """
    for entry in element.properties:
        size = 1
        if entry.length:
            size = int(np.frombuffer(data, entry.length, 1, at)[0])
            at += entry.length.itemsize
        if not 0 <= size * entry.item.itemsize <= len(data) - at:
            raise ValueError
        yield entry, at, size
        at += size * entry.item.itemsize


def _as_numbers(values: NDArray[Any]) -> Array:
    with np.errstate(invalid="ignore"):  # signalling NaNs of broken files
        return values.astype(np.float64)


def _text_numbers(body: bytes, path: Path) -> bytes:
    """All numbers of a text as doubles, lines ignored."""
    if b"\0" in body:
        broken(path, "the text of the PLY file holds zero bytes")
    numbers = text_numbers(body)
    if numbers is None:
        broken(path, "the PLY file holds words where numbers should be")
    return numbers.tobytes()


def _cut_short(path: Path, element: Element) -> NoReturn:
    raise MeshError(
        f"{path}: the PLY file is cut short: its header announces {element.rows} rows of '{element.name}', "
        "more than the file holds. Export or copy it again."
    )


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
        broken(path, f"vertex {counts.argmin() + 1} of the OBJ file has no three numbers")
    numbers = _numbers(b"\n".join(lines), counts.sum(), path, "a vertex")
    return numbers[(np.cumsum(counts) - counts)[:, None] + np.arange(3)]


def _read_polygons(lines: list[bytes], seen: Indices, path: Path) -> tuple[Indices, Indices]:
    """Vertex numbers from 0 of all polygons, and how many corners each has; negative ones count from
    behind."""
    text = _BEYOND_SLASH.sub(b"", b"\n".join(line.partition(b"#")[0] for line in lines))
    sizes = np.array([len(line.split()) for line in text.split(b"\n")], dtype=np.int64)[: len(lines)]
    numbers = _numbers(text, sizes.sum(), path, "a face")
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
