"""Read STL files, binary or ASCII, and say clearly why one cannot be read (bytes -> triangles)."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import MeshError
from polish_sim.geometry.polygon import FileTriangles, gather_triangles
from polish_sim.kernel_cache import njit

_HEADER_BYTES = 84
_FACET_BYTES = 50
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_BLOCK_BYTES = 8_000_000


def is_stl(content: bytes) -> bool:
    """An ASCII STL begins with "solid"; a binary one's length follows from the number of facets in its header."""
    if _is_ascii(content):
        return b"facet" in content[:4096].lower()
    return len(content) >= _HEADER_BYTES and len(content) == _HEADER_BYTES + _FACET_BYTES * _announced(content)


def parse_stl(content: bytes, path: Path) -> FileTriangles:
    """Read the facets of an STL file in the file's own unit.

    Args:
        content: The file's bytes.
        path: Its name, for messages.

    Returns:
        The triangles; several solids of an ASCII file one after the other.

    Raises:
        MeshError: The file is cut short, or not an STL.
    """
    corners = _parse_ascii(content, path) if _is_ascii(content) else _parse_binary(content, path)
    return FileTriangles(corners, np.arange(len(corners), dtype=np.int32))


def _is_ascii(content: bytes) -> bool:
    """Tell text from binary; binary files may start with "solid" too, but soon hold a zero byte."""
    head = content[:2048]
    return head.lstrip().lower().startswith(b"solid") and b"\0" not in head


def _announced(content: bytes) -> int:
    return int(np.frombuffer(content, dtype="<u4", count=1, offset=80)[0])


def _parse_binary(content: bytes, path: Path) -> NDArray[np.float64]:
    if len(content) < _HEADER_BYTES or _looks_like_text(content):
        raise MeshError(
            f"{path}: not an STL file (neither a binary header nor the word 'solid' of an ASCII STL). "
            "Export the part as STL."
        )
    count = _announced(content)
    expected = _HEADER_BYTES + _FACET_BYTES * count
    if len(content) < expected:
        whole = (len(content) - _HEADER_BYTES) // _FACET_BYTES
        raise MeshError(
            f"{path}: the file is cut short: its header announces {count} facets ({expected} bytes), "
            f"but it holds {whole} ({len(content)} bytes). Export or copy it again."
        )
    facets = np.frombuffer(content, dtype=_FACET, count=count, offset=_HEADER_BYTES)
    with np.errstate(invalid="ignore"):  # signalling NaNs of broken files
        return facets["corners"].astype(np.float64)


def _looks_like_text(content: bytes) -> bool:
    head = content[:512]
    printable = sum(byte in b"\t\n\r" or 32 <= byte < 127 for byte in head)
    return b"\0" not in head and printable > 0.95 * len(head)


def _parse_ascii(content: bytes, path: Path) -> NDArray[np.float64]:
    text = content.lower()
    if b"vertex" not in text and b"facet" in text.split():
        raise MeshError(f"{path}: ASCII STL with facets but no vertices. Export the part again.")
    if b"vertex" not in text and b"endsolid" not in text:
        raise MeshError(f"{path}: begins with 'solid' but is not an STL file. Export the part as STL.")
    blocks = [_read_block(block, path) for block in _blocks(text)]
    vertices = np.concatenate([block for block, _ in blocks])
    if len(vertices) % 3 or not any(closed for _, closed in blocks[-2:]):
        raise MeshError(
            f"{path}: the ASCII STL is cut short after {len(vertices) // 3} whole facets "
            "(no 'endsolid' at its end). Export or copy it again."
        )
    return vertices.reshape(-1, 3, 3)


def _blocks(text: bytes) -> Iterator[bytes]:
    """Pieces of the text that end behind a facet, so that the words of few facets are held at a time."""
    ends = [0]
    while ends[-1] < len(text):
        at = text.find(b"endfacet", ends[-1] + _BLOCK_BYTES)
        ends.append(at + len(b"endfacet") if at >= 0 else len(text))
    for begin, end in pairwise(ends):
        yield text[begin:end]


def _read_block(text: bytes, path: Path) -> tuple[NDArray[np.float64], bool]:
    """Vertices of a piece, shape (n, 3), and whether a solid ends behind them."""
    words = text.split()
    at = [index for index, word in enumerate(words) if word == b"vertex"]
    whole = [index for index in at if index + 3 < len(words)]
    numbers = [words[index + k] for index in whole for k in (1, 2, 3)]
    closed = b"endsolid" in words[at[-1] if at else 0 :]
    try:
        return np.array([float(number) for number in numbers]).reshape(-1, 3), closed
    except ValueError:
        index = next(index for index in whole if not all(map(_is_number, words[index + 1 : index + 4])))
        shown = b" ".join(words[index : index + 4]).decode("latin-1")[:80]
        shown = "".join(letter if letter.isprintable() else "?" for letter in shown)
        raise MeshError(f"{path}: '{shown}' is not a vertex (three numbers wanted). Export it again.") from None


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# Read Wavefront OBJ files: vertices and polygons, nothing else (text -> triangles).

_KEYWORDS = frozenset(
    b"v vt vn vp f l p o g s mtllib usemtl curv curv2 surf parm trim hole scrv sp end con mg bevel c_interp "
    b"d_interp lod cstype deg bmat step maplib usemap shadow_obj trace_obj ctech stech call csh bsp bzp cdc cdp "
    b"res".split()
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
    """Read the polygons of all objects and groups; materials, texture, normals, lines and curves are passed over.

    Raises:
        MeshError: No OBJ, or a line that makes no sense.
    """
    if b"\0" in content:
        _broken(path, "not an OBJ file (it is not text)")
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
        _broken(path, "the OBJ file has no vertices (lines 'v x y z')")
    points = _read_vertices(vertices, path)
    indices, sizes = _read_polygons(polygons, np.array(seen, dtype=np.int64), path)
    return gather_triangles(points, indices, sizes, path)


def _read_vertices(lines: list[bytes], path: Path) -> NDArray[np.float64]:
    """Positions, shape (n, 3); a weight or a colour behind them is passed over."""
    lines = [line.partition(b"#")[0] for line in lines]
    counts = np.array([len(line.split()) for line in lines])
    if counts.min() < 3:
        _broken(path, f"vertex {int(counts.argmin()) + 1} of the OBJ file has no three numbers")
    numbers = _numbers(b"\n".join(lines), int(counts.sum()), path, "a vertex")
    return numbers[(np.cumsum(counts) - counts)[:, None] + np.arange(3)]


def _read_polygons(
    lines: list[bytes], seen: NDArray[np.int64], path: Path
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertex numbers from 0 of all polygons, and how many corners each has; negative ones count from behind."""
    text = _BEYOND_SLASH.sub(b"", b"\n".join(line.partition(b"#")[0] for line in lines))
    sizes = np.array([len(line.split()) for line in text.split(b"\n")], dtype=np.int64)[: len(lines)]
    numbers = _numbers(text, int(sizes.sum()), path, "a face")
    numbers = np.where(np.abs(numbers) < 2**40, numbers, 0.0)
    given = numbers.astype(np.int64)
    indices = np.where(given < 0, np.repeat(seen, sizes) + given, given - 1)
    return np.where(given == numbers, indices, -1), sizes


def _numbers(text: bytes, count: int, path: Path, what: str) -> NDArray[np.float64]:
    if count == 0:
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            numbers = np.fromstring(text.decode("latin-1"), dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            numbers = np.empty(0)
    if len(numbers) != count:
        _broken(path, f"{what} of the OBJ file holds something that is no number")
    return numbers


def _broken(path: Path, what: str) -> NoReturn:
    raise MeshError(f"{path}: {what}. Export the part again.")


# Walk the rows of a PLY table, whose lists make them differ in length (bytes or numbers -> places of list items).


@njit(cache=True, error_model="numpy")
def walk_bytes(raw, at, rows, count_sizes, item_sizes, signed, big_endian, listed):  # type: ignore[no-untyped-def]
    """Find the items of one list in every row of a binary table.

    Args:
        raw: The file's body, uint8 (n,).
        at: Where the table begins.
        rows: Number of rows.
        count_sizes: Bytes of each property's list length, 0 for a single value, shape (p,).
        item_sizes: Bytes of each property's items, shape (p,).
        signed: Properties whose list length has a sign, shape (p,).
        big_endian: Byte order.
        listed: The property whose items are wanted, or -1.

    Returns:
        Place of each row's first item, their number, both (rows,) or (0,), and the end of the table; end is -1
        where the file is too short or a length is negative.
    """
    kept = rows if listed >= 0 else 0
    starts, sizes = np.empty(kept, np.int64), np.empty(kept, np.int64)
    if not count_sizes.any():
        end = at + rows * item_sizes.sum()
        return starts, sizes, end if end <= len(raw) else -1
    for row in range(rows):
        for p in range(len(count_sizes)):
            count = np.int64(1)
            if count_sizes[p] > 0:
                if at + count_sizes[p] > len(raw):
                    return starts, sizes, -1
                count = np.int64(0)
                for k in range(count_sizes[p]):
                    byte = raw[at + k] if big_endian else raw[at + count_sizes[p] - 1 - k]
                    count = 256 * count + np.int64(byte)
                if signed[p] and count >= 1 << (8 * count_sizes[p] - 1):
                    return starts, sizes, -1
                at += count_sizes[p]
            if p == listed:
                starts[row], sizes[row] = at, count
            at += count * item_sizes[p]
            if at > len(raw):
                return starts, sizes, -1
    return starts, sizes, at


@njit(cache=True, error_model="numpy")
def walk_numbers(numbers, at, rows, is_list, listed):  # type: ignore[no-untyped-def]
    """As `walk_bytes` for a table written as numbers, float64 (n,)."""
    kept = rows if listed >= 0 else 0
    starts, sizes = np.empty(kept, np.int64), np.empty(kept, np.int64)
    if not is_list.any():
        end = at + rows * len(is_list)
        return starts, sizes, end if end <= len(numbers) else -1
    for row in range(rows):
        for p in range(len(is_list)):
            count = np.int64(1)
            if is_list[p]:
                if at >= len(numbers) or not 0.0 <= numbers[at] <= len(numbers):
                    return starts, sizes, -1
                count = np.int64(numbers[at])
                at += 1
            if p == listed:
                starts[row], sizes[row] = at, count
            at += count
            if at > len(numbers):
                return starts, sizes, -1
    return starts, sizes, at


# Read PLY files, ASCII or binary of either byte order, any layout of vertices and faces (bytes -> triangles).

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
        _broken_ply(path, "not a PLY file (its first line is not 'ply')")
    end = content.find(b"end_header", 0, _LONGEST_HEADER)
    line_end = content.find(b"\n", end)
    if end < 0 or line_end < 0:
        _broken_ply(path, "the PLY file is cut short: no 'end_header'")
    order, elements = None, []
    for line in content[:end].decode("latin-1").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = _ORDERS.get(words[1] if len(words) > 1 else "")
        elif words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isascii() or not words[2].isdigit() or len(words[2]) > 12:
                _broken_ply(path, f"'{line.strip()[:80]}' is no element of a PLY file")
            elements.append(Element(words[1], int(words[2]), ()))
        elif words[:1] == ["property"]:
            if not elements:
                _broken_ply(path, f"'{line.strip()[:80]}' belongs to no element")
            entry = _read_property(words, line, path)
            elements[-1] = elements[-1]._replace(properties=(*elements[-1].properties, entry))
    if order is None:
        _broken_ply(path, "its format is none of " + ", ".join(_ORDERS))
    return Header(order, tuple(elements)), line_end + 1


def _read_property(words: list[str], line: str, path: Path) -> Property:
    types = [_TYPES.get(word) for word in words[1:-1] if word != "list"]
    is_list = len(words) == 5 and words[1] == "list"
    if None in types or len(types) != (2 if is_list else 1):
        _broken_ply(path, f"'{line.strip()[:80]}' is no property of a PLY file")
    if is_list and types[0] in ("f4", "f8"):
        _broken_ply(path, f"'{line.strip()[:80]}': a list's length must be a whole number")
    return Property(words[-1], str(types[0]) if is_list else "", str(types[-1]))


def _wanted(element: Element, columns: dict[str, int], path: Path) -> tuple[tuple[int, ...], int]:
    """Columns of single values and the column of the list that are needed (-1: none)."""
    if element.name == "vertex":
        if not {"x", "y", "z"} <= columns.keys() or any(element.properties[columns[k]].length for k in "xyz"):
            _broken_ply(path, "the vertices of the PLY file have no x, y, z")
        return tuple(columns[k] for k in "xyz"), -1
    if element.name == "face":
        listed = [columns[name] for name in _INDEX_NAMES if name in columns]
        if not listed or not element.properties[listed[0]].length:
            _broken_ply(path, "the faces of the PLY file have no list vertex_indices")
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
        _broken_ply(path, "the vertices of the PLY file hold lists")
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
        _broken_ply(path, "the text of the PLY file holds zero bytes")
    if not body.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(body.decode("latin-1"), dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            _broken_ply(path, "the PLY file holds words where numbers should be")


def _cut_short(path: Path, element: Element) -> NoReturn:
    raise MeshError(
        f"{path}: the PLY file is cut short: its header announces {element.rows} rows of '{element.name}', "
        "more than the file holds. Export or copy it again."
    )


def _broken_ply(path: Path, what: str) -> NoReturn:
    printable = "".join(letter if letter.isprintable() else "?" for letter in what)
    raise MeshError(f"{path}: {printable}. Export the part again.")
