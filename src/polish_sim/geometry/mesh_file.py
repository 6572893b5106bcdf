"""Read the triangles of a mesh file of any known format, told by its content or its name (file -> triangles)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.errors import MeshError
from polish_sim.geometry.mesh_readers import is_obj, is_ply, is_stl, parse_obj, parse_ply, parse_stl
from polish_sim.geometry.polygon import FileTriangles

LARGEST_FILE = 600_000_000
"""Files larger than this are refused, so that memory does not run out [bytes]."""


class Format(NamedTuple):
    """How a kind of mesh file is known and read."""

    recognises: Callable[[bytes], bool]
    """Tells from the content alone; never wrong when it says yes."""
    parse: Callable[[bytes, Path], FileTriangles]
    """Content and name (for messages) to triangles."""


FORMATS: Mapping[str, Format] = {
    ".ply": Format(is_ply, parse_ply),
    ".stl": Format(is_stl, parse_stl),
    ".obj": Format(is_obj, parse_obj),
}
"""By the usual ending of the name. A new format: one file, one line."""

_COMPANIONS = {".mtl": "the materials of an OBJ file; name the .obj file itself"}


def read_mesh_file(path: Path) -> tuple[FileTriangles, bytes]:
    """Read the facets of an STL, PLY or OBJ file in the file's own unit.

    The content decides; the name's ending helps where the content is no proof (or broken).

    Args:
        path: The file.

    Returns:
        Triangles, and the file's bytes.

    Raises:
        MeshError: The file is missing, a folder, empty, cut short, too large or no mesh; says which.
    """
    content = _read_bytes(path)
    triangles = _format_of(content, path).parse(content, path)
    if len(triangles.corners) == 0:
        raise MeshError(f"{path}: the file holds no facets. Export the part again.")
    _check_finite(triangles, path)
    return triangles, content


def _format_of(content: bytes, path: Path) -> Format:
    for known in FORMATS.values():
        if known.recognises(content):
            return known
    ending = path.suffix.lower()
    if ending in FORMATS:
        return FORMATS[ending]
    what = _COMPANIONS.get(ending, f"a kind of file that cannot be read (ending '{path.suffix}')")
    raise MeshError(f"{path}: this is {what}. Export the part as one of: {', '.join(FORMATS)}.")


def _read_bytes(path: Path) -> bytes:
    if path.is_dir():
        raise MeshError(f"{path} is a folder, not a mesh file. Name the file itself.")
    if not path.exists():
        raise MeshError(f"{path}: no such file. Check the name and the folder.")
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise MeshError(
                f"{path}: the file is too large: {size / 1e6:.0f} MB, at most {LARGEST_FILE / 1e6:.0f} MB are read. "
                "Export the part with fewer facets or as a binary file."
            )
        content = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path} cannot be read ({error.strerror}). Check its permissions.") from None
    if not content.strip():
        raise MeshError(f"{path}: the file is empty. Export the part again.")
    return content


def _check_finite(triangles: FileTriangles, path: Path) -> None:
    bad = np.flatnonzero(~np.isfinite(triangles.corners).all(axis=(1, 2)))
    if len(bad):
        raise MeshError(
            f"{path}: {len(bad)} of {len(triangles.corners)} facets have coordinates that are NaN or infinite, "
            f"the first is facet {triangles.numbers[bad[0]]}. Repair or export the part again."
        )
