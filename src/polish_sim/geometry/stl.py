"""Read the triangles of an STL file, binary or ASCII, and say clearly why a file cannot be read (file -> triangles)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import MeshError

_HEADER_BYTES = 84
_FACET_BYTES = 50
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(path: Path) -> tuple[NDArray[np.float64], bytes]:
    """Read the facets of an STL file in the file's own unit.

    Args:
        path: An STL file, binary or ASCII.

    Returns:
        Corners of the facets, shape (m, 3, 3), in the file's unit, and the file's bytes.

    Raises:
        MeshError: The file is missing, a folder, empty, cut short, or not an STL.
    """
    content = _read_bytes(path)
    triangles = _parse_ascii(content, path) if _is_ascii(content) else _parse_binary(content, path)
    if len(triangles) == 0:
        raise MeshError(f"{path}: the STL file holds no facets. Export the part again.")
    _check_finite(triangles, path)
    return triangles, content


def _read_bytes(path: Path) -> bytes:
    if path.is_dir():
        raise MeshError(f"{path} is a folder, not an STL file. Name the file itself.")
    if not path.exists():
        raise MeshError(f"{path}: no such file. Check the name and the folder.")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path} cannot be read ({error.strerror}). Check its permissions.") from None
    if not content.strip():
        raise MeshError(f"{path}: the file is empty. Export the part again as STL.")
    return content


def _is_ascii(content: bytes) -> bool:
    """Tell text from binary; binary files may start with "solid" too, but soon hold a zero byte."""
    head = content[:2048]
    return head.lstrip().lower().startswith(b"solid") and b"\0" not in head


def _parse_binary(content: bytes, path: Path) -> NDArray[np.float64]:
    if len(content) < _HEADER_BYTES or _looks_like_text(content):
        raise MeshError(
            f"{path}: not an STL file (neither a binary header nor the word 'solid' of an ASCII STL). "
            "Export the part as STL."
        )
    count = int(np.frombuffer(content, dtype="<u4", count=1, offset=80)[0])
    expected = _HEADER_BYTES + _FACET_BYTES * count
    if len(content) < expected:
        whole = (len(content) - _HEADER_BYTES) // _FACET_BYTES
        raise MeshError(
            f"{path}: the file is cut short: its header announces {count} facets ({expected} bytes), "
            f"but it holds {whole} ({len(content)} bytes). Export or copy it again."
        )
    facets = np.frombuffer(content, dtype=_FACET, count=count, offset=_HEADER_BYTES)
    return facets["corners"].astype(np.float64)


def _looks_like_text(content: bytes) -> bool:
    head = content[:512]
    printable = sum(byte in b"\t\n\r" or 32 <= byte < 127 for byte in head)
    return b"\0" not in head and printable > 0.95 * len(head)


def _parse_ascii(content: bytes, path: Path) -> NDArray[np.float64]:
    words = content.lower().split()
    at = [index for index, word in enumerate(words) if word == b"vertex"]
    if not at and b"facet" in words:
        raise MeshError(f"{path}: ASCII STL with facets but no vertices. Export the part again.")
    if not at and b"endsolid" not in words:
        raise MeshError(f"{path}: begins with 'solid' but is not an STL file. Export the part as STL.")
    if len(at) % 3 or (at and at[-1] + 3 >= len(words)) or (at and b"endsolid" not in words[at[-1] :]):
        raise MeshError(
            f"{path}: the ASCII STL is cut short after {len(at) // 3} whole facets "
            "(no 'endsolid' at its end). Export or copy it again."
        )
    return np.array([_vertex(words, index, path) for index in at], dtype=np.float64).reshape(-1, 3, 3)


def _vertex(words: list[bytes], index: int, path: Path) -> tuple[float, float, float]:
    try:
        return float(words[index + 1]), float(words[index + 2]), float(words[index + 3])
    except ValueError:
        text = b" ".join(words[index : index + 4]).decode("ascii", "replace")
        raise MeshError(f"{path}: '{text}' is not a vertex (three numbers wanted). Export it again.") from None


def _check_finite(triangles: NDArray[np.float64], path: Path) -> None:
    bad = np.flatnonzero(~np.isfinite(triangles).all(axis=(1, 2)))
    if len(bad):
        raise MeshError(
            f"{path}: {len(bad)} of {len(triangles)} facets have coordinates that are NaN or infinite, "
            f"the first is facet {bad[0]}. Repair or export the part again."
        )
