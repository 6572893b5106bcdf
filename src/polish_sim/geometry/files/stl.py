"""Read STL files, binary or ASCII, and say clearly why one cannot be read (bytes -> triangles)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import MeshError
from polish_sim.geometry.files.file_triangles import FileTriangles

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
