"""Read PLY files, ASCII or binary of either byte order, any layout of vertices and faces (bytes -> triangles)."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import MeshError
from polish_sim.geometry.files.file_triangles import FileTriangles, gather_triangles
from polish_sim.geometry.files.ply_rows import walk_bytes, walk_numbers

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDEX_NAMES = ("vertex_indices", "vertex_index")
_LONGEST_HEADER = 100_000
_Numbers = NDArray[np.float64]
_Whole = NDArray[np.int64]


class Property(NamedTuple):
    """One property of an element's rows."""

    name: str
    length: str
    """Type of a list's length, "" for a single value."""
    item: str
    """Type of the value or the list's items, as numpy names it without byte order."""


class Element(NamedTuple):
    """One table of a PLY file."""

    name: str
    rows: int
    properties: tuple[Property, ...]


class Header(NamedTuple):
    """What a PLY file says about itself."""

    order: str
    """Byte order as numpy writes it, "" for text."""
    elements: tuple[Element, ...]


def is_ply(content: bytes) -> bool:
    """A PLY file says so in its first line."""
    return content[:4] in (b"ply\n", b"ply\r")


def parse_ply(content: bytes, path: Path) -> FileTriangles:
    """Read the polygons of a PLY file; colours, normals, texture and other tables are passed over.

    Raises:
        MeshError: No PLY, cut short, or without vertices or faces.
    """
    header, body = _read_header(content, path)
    points: _Numbers | None = None
    sizes, indices = np.empty(0, np.int64), np.empty(0, np.int64)
    data = content[body:] if header.order else _text_numbers(content[body:], path)
    at, found = 0, False
    for element in header.elements:
        columns = {entry.name: i for i, entry in enumerate(element.properties)}
        wanted, listed = _wanted(element, columns, path)
        table = _read_rows(data, at, element, wanted, listed, header.order, path)
        at = table.end
        if element.name == "vertex":
            points = table.columns
        elif element.name == "face":
            sizes, indices, found = table.sizes, table.items, True
    if points is None or not found:
        missing = "vertices" if points is None else "faces (a point cloud?)"
        raise MeshError(f"{path}: the PLY file has no {missing}. Export the part as a mesh of triangles.")
    return gather_triangles(points, indices, sizes, path)


def _read_header(content: bytes, path: Path) -> tuple[Header, int]:
    if not is_ply(content):
        _broken(path, "not a PLY file (its first line is not 'ply')")
    end = content.find(b"end_header", 0, _LONGEST_HEADER)
    line_end = content.find(b"\n", end)
    if end < 0 or line_end < 0:
        _broken(path, "the PLY file is cut short: no 'end_header'")
    order, elements = None, []
    for line in content[:end].decode("latin-1").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = _ORDERS.get(words[1] if len(words) > 1 else "")
        elif words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isascii() or not words[2].isdigit() or len(words[2]) > 12:
                _broken(path, f"'{line.strip()[:80]}' is no element of a PLY file")
            elements.append(Element(words[1], int(words[2]), ()))
        elif words[:1] == ["property"]:
            if not elements:
                _broken(path, f"'{line.strip()[:80]}' belongs to no element")
            entry = _read_property(words, line, path)
            elements[-1] = elements[-1]._replace(properties=(*elements[-1].properties, entry))
    if order is None:
        _broken(path, "its format is none of " + ", ".join(_ORDERS))
    return Header(order, tuple(elements)), line_end + 1


def _read_property(words: list[str], line: str, path: Path) -> Property:
    types = [_TYPES.get(word) for word in words[1:-1] if word != "list"]
    is_list = len(words) == 5 and words[1] == "list"
    if None in types or len(types) != (2 if is_list else 1):
        _broken(path, f"'{line.strip()[:80]}' is no property of a PLY file")
    if is_list and types[0] in ("f4", "f8"):
        _broken(path, f"'{line.strip()[:80]}': a list's length must be a whole number")
    return Property(words[-1], str(types[0]) if is_list else "", str(types[-1]))


def _wanted(element: Element, columns: dict[str, int], path: Path) -> tuple[tuple[int, ...], int]:
    """Columns of single values and the column of the list that are needed (-1: none)."""
    if element.name == "vertex":
        if not {"x", "y", "z"} <= columns.keys() or any(element.properties[columns[k]].length for k in "xyz"):
            _broken(path, "the vertices of the PLY file have no x, y, z")
        return tuple(columns[k] for k in "xyz"), -1
    if element.name == "face":
        listed = [columns[name] for name in _INDEX_NAMES if name in columns]
        if not listed or not element.properties[listed[0]].length:
            _broken(path, "the faces of the PLY file have no list vertex_indices")
        return (), listed[0]
    return (), -1


class _Table(NamedTuple):
    columns: _Numbers
    sizes: _Whole
    items: _Whole
    end: int


def _read_rows(
    data: bytes | _Numbers, at: int, element: Element, wanted: tuple[int, ...], listed: int, order: str, path: Path
) -> _Table:
    """Walk one element's rows and take the wanted columns along."""
    entries = element.properties
    count_sizes = np.array([np.dtype(e.length).itemsize if e.length else 0 for e in entries], dtype=np.int64)
    item_sizes = np.array([np.dtype(e.item).itemsize for e in entries], dtype=np.int64)
    signed = np.array([e.length.startswith("i") for e in entries], dtype=np.bool_)
    raw = np.frombuffer(data, dtype=np.uint8) if isinstance(data, bytes) else data
    smallest = int(np.where(count_sizes > 0, count_sizes, item_sizes).sum()) if order else len(entries)
    if element.rows * smallest > len(raw) - at or (smallest == 0 and element.rows > 0):
        _cut_short(path, element)
    columns = np.array(wanted, dtype=np.int64)
    if order:
        starts, sizes, end = walk_bytes(raw, at, element.rows, count_sizes, item_sizes, signed, order == ">", listed)
    else:
        starts, sizes, end = walk_numbers(raw, at, element.rows, count_sizes > 0, listed)
    if end < 0:
        _cut_short(path, element)
    offsets = _column_offsets(count_sizes, item_sizes if order else np.ones_like(item_sizes), columns, path)
    width = (end - at) // max(element.rows, 1)
    values = np.empty((element.rows, len(columns)))
    for k, column in enumerate(columns):
        values[:, k] = _gather(raw, at + offsets[k] + width * np.arange(element.rows), entries[column].item, order)
    items = np.empty(0, dtype=np.int64)
    if listed >= 0:
        step = int(item_sizes[listed]) if order else 1
        within = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        numbers = _gather(raw, np.repeat(starts, sizes) + step * within, entries[listed].item, order)
        items = np.where(np.abs(numbers) < 2**40, numbers, -1).astype(np.int64)
    return _Table(values, sizes, items, int(end))


def _column_offsets(count_sizes: _Whole, sizes: _Whole, columns: _Whole, path: Path) -> _Whole:
    if len(columns) and count_sizes.any():
        _broken(path, "the vertices of the PLY file hold lists")
    return np.asarray((np.cumsum(sizes) - sizes)[columns])


def _gather(raw: NDArray[np.uint8] | _Numbers, places: _Whole, item: str, order: str) -> _Numbers:
    """Values at these places, as numbers."""
    if not order:
        return np.asarray(raw[places], dtype=np.float64)
    size = np.dtype(item).itemsize
    spread = np.empty((len(places), size), dtype=np.uint8)
    for k in range(size):
        spread[:, k] = raw[places + k]
    with np.errstate(invalid="ignore"):
        return spread.view(order + item)[:, 0].astype(np.float64)


def _text_numbers(body: bytes, path: Path) -> _Numbers:
    """All numbers of a text, whatever its lines."""
    if b"\0" in body:
        _broken(path, "the text of the PLY file holds zero bytes")
    if not body.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(body.decode("latin-1"), dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            _broken(path, "the PLY file holds words where numbers should be")


def _cut_short(path: Path, element: Element) -> NoReturn:
    raise MeshError(
        f"{path}: the PLY file is cut short: its header announces {element.rows} rows of '{element.name}', "
        "more than the file holds. Export or copy it again."
    )


def _broken(path: Path, what: str) -> NoReturn:
    printable = "".join(letter if letter.isprintable() else "?" for letter in what)
    raise MeshError(f"{path}: {printable}. Export the part again.")
