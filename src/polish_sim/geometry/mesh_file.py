"""Read the triangles of a part's file; its content or name says the format (STL, PLY, OBJ, STEP ->
triangles)."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from inspect import getsource
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, longest_side
from polish_sim.errors import MeshError, count_text, near_file, number_text, regular
from polish_sim.geometry.polygon import FileTriangles
from polish_sim.geometry.polygon_files import is_obj, is_ply, parse_obj, parse_ply, printable, text_numbers

LARGEST_FILE = 600_000_000  #: Files larger than this are refused, so that memory does not run out [bytes]
_COMPANIONS = {".mtl": "the materials of an OBJ file; name the .obj file itself"}
COARSEST = 1e-3  #: Steps of numbers of 32 bits that still show a shape, as a share of the part's size
_HEADER_BYTES = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_SOLID_NAME = re.compile(rb"^([ \t]*(?:end)?solid)\b.*$", re.IGNORECASE | re.MULTILINE)
_VERTEX = re.compile(rb"^[ \t]*vertex\b(.*)$", re.MULTILINE)


def read_mesh_file(path: Path) -> tuple[FileTriangles, bytes]:
    """Read the facets of an STL, PLY, OBJ or STEP file in the file's own unit, and the file's bytes.

    The content decides; the name's ending helps where the content is no proof (or broken).

    Raises:
        MeshError: The file is missing, a folder, empty, cut short, too large or no mesh; says which.
    """
    content = _read_bytes(path)
    triangles = _format_of(content, path).parse(content, path)
    if len(triangles.corners) < 2:
        raise MeshError(f"{path}: the file holds fewer than two facets. Export the part again.")
    bad = np.flatnonzero(~np.isfinite(triangles.corners).all(axis=(1, 2)))
    if len(bad):
        raise MeshError(
            f"{path}: {len(bad)} of {len(triangles.corners)} facets have coordinates that are NaN or "
            f"infinite, the first is facet {triangles.numbers[bad[0]]}. Repair or export the part again."
        )
    corners = triangles.corners.reshape(-1, 3)
    furthest = np.abs(corners).max()
    step = np.spacing(np.float32(furthest))
    if step > COARSEST * longest_side(corners) and (corners == corners.astype(np.float32)).all():
        raise MeshError(
            f"{path}: the part lies {number_text(furthest, 3)} from its origin, where the file's numbers are "
            f"{step:.2g} apart (in its unit): its shape is lost. Move it to the origin and export it again."
        )
    return triangles, content


def _read_bytes(path: Path) -> bytes:
    try:
        size = regular(path).stat().st_size
        if size > LARGEST_FILE:
            raise MeshError(
                f"{path}: the file is too large: {size / 1e6:.0f} MB, at most {LARGEST_FILE / 1e6:.0f} MB "
                "are read. Export the part with fewer facets or as a binary file."
            )
        content = path.read_bytes()
    except OSError as error:
        why = str(error.strerror).lower()
        raise MeshError(f"{path}: {why}.{near_file(path) or ' Name a mesh file that can be read.'}") from None
    if not content.strip():
        raise MeshError(f"{path}: the file is empty. Export the part again.")
    return content


def _format_of(content: bytes, path: Path) -> _Format:
    for known in FORMATS.values():
        if known.recognises(content):
            return known
    ending = path.suffix.lower()
    if ending in FORMATS:
        return FORMATS[ending]
    what = _COMPANIONS.get(ending, f"a kind of file that cannot be read (ending '{path.suffix}')")
    raise MeshError(f"{path}: this is {what}. Export the part as one of: {', '.join(FORMATS)}.")


def is_stl(content: bytes) -> bool:
    """An ASCII STL begins with "solid"; a binary one's length follows from the number of facets in its
    header."""
    if _is_text_stl(content):
        return b"facet" in content[:4096].lower()
    return len(content) >= _HEADER_BYTES and len(content) == _HEADER_BYTES + _FACET.itemsize * _announced(
        content
    )


def parse_stl(content: bytes, path: Path) -> FileTriangles:
    """Read the facets of an STL file; several solids of an ASCII file one after the other.

    Raises:
        MeshError: The file is cut short, or not an STL.
    """
    corners = _parse_text_stl(content, path) if _is_text_stl(content) else _parse_binary_stl(content, path)
    return FileTriangles(corners, np.arange(len(corners), dtype=np.int32))


def _is_text_stl(content: bytes) -> bool:
    """Whether it is text, not binary; binary files may start with "solid" too, but soon hold a zero byte."""
    head = content[:2048]
    return head.lstrip().lower().startswith(b"solid") and b"\0" not in head


def _announced(content: bytes) -> int:
    return int(np.frombuffer(content, dtype="<u4", count=1, offset=80)[0])


def _parse_binary_stl(content: bytes, path: Path) -> Array:
    head = content[:512]
    readable = sum(byte in b"\t\n\r" or 32 <= byte < 127 for byte in head)
    if len(content) < _HEADER_BYTES or (b"\0" not in head and readable > 0.95 * len(head)):
        raise MeshError(
            f"{path}: not an STL file (neither a binary header nor the word 'solid' of an ASCII STL). "
            "Export the part as STL."
        )
    count = _announced(content)
    expected = _HEADER_BYTES + _FACET.itemsize * count
    if len(content) < expected:
        whole = (len(content) - _HEADER_BYTES) // _FACET.itemsize
        raise MeshError(
            f"{path}: the file is cut short: its header announces {count} facets ({expected} bytes), "
            f"but it holds {whole} ({len(content)} bytes). Export or copy it again."
        )
    facets = np.frombuffer(content, dtype=_FACET, count=count, offset=_HEADER_BYTES)
    with np.errstate(invalid="ignore"):  # signalling NaNs of broken files
        return facets["corners"].astype(np.float64)


def _parse_text_stl(content: bytes, path: Path) -> Array:
    """The corners of all facets, whichever solid they belong to."""
    words = _SOLID_NAME.sub(rb"\1", content.replace(b"\r", b"\n")).lower()
    if b"vertex" not in words and b"facet" in words.split():
        raise MeshError(f"{path}: ASCII STL with facets but no vertices. Export the part again.")
    if b"vertex" not in words and b"endsolid" not in words:
        raise MeshError(f"{path}: begins with 'solid' but is not an STL file. Export the part as STL.")
    facets = [_VERTEX.findall(facet) for facet in words.split(b"endfacet")]
    rows = list(chain.from_iterable(facets))
    if words.rfind(b"endsolid") < words.rfind(b"vertex"):
        whole = sum(len(row.split()) == 3 for row in rows) // 3
        raise MeshError(
            f"{path}: the ASCII STL is cut short after {count_text(whole, 'whole facet')} "
            "(no 'endsolid' at its end). Export or copy it again."
        )
    numbers = text_numbers(b"\n".join(rows))
    lengths = {len(row.split()) for row in rows} | {len(facet) for facet in facets}
    if numbers is None or not lengths <= {0, 3}:
        raise _bad_vertex(rows, path)
    return numbers.reshape(-1, 3, 3)


def _bad_vertex(rows: list[bytes], path: Path) -> MeshError:
    for row in rows:
        numbers = text_numbers(row)
        if numbers is None or len(numbers) != 3:
            shown = printable(row.decode("latin-1").strip()[:73])
            return MeshError(
                f"{path}: 'vertex {shown}' is not a vertex (three numbers wanted). Export it again."
            )
    return MeshError(
        f"{path}: the ASCII STL is no list of triangles between 'solid' and 'endsolid' ({len(rows)} "
        "vertices). Export it again."
    )


#: Chords of a STEP file are this close to its solid [mm]; the surface through them is 100 times closer
CHORD_MM = 0.1
#: Neighbouring facets of a smooth face bend by no more: well below plan.feature_angle_rad
ANGLE_RAD = 0.2
SECONDS, SECONDS_PER_MB = 9.0, 6.0  #: A STEP file that takes longer is refused [s, s/MB]
MEMORY = 4_000_000_000  #: Of the process that reads it [bytes]
STEP_ENDINGS = (".step", ".stp")  #: Of files that state their own unit
_STEP_HEAD, _STEP_TAIL = b"ISO-10303-21;", b"END-ISO-10303-21;"


def is_step(content: bytes) -> bool:
    """A STEP file begins with the number of its standard."""
    return content[:256].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(_STEP_HEAD)


def parse_step(content: bytes, path: Path) -> FileTriangles:
    """The faces of a STEP file as triangles in mm, whichever unit the file states.

    Raises:
        MeshError: The reader is not installed, or the file is no STEP file, cut short, broken, without a face
            or too much for the limits of time and memory.
    """
    if not is_step(content):
        raise MeshError(
            f"{path}: not a STEP file (it does not begin with {_STEP_HEAD.decode()}). Export the part again."
        )
    if _STEP_TAIL not in content[-4096:]:
        raise MeshError(
            f"{path}: the STEP file is cut short (no {_STEP_TAIL.decode()} at its end). Export it again."
        )
    if importlib.util.find_spec("cascadio") is None:
        raise MeshError(
            f"{path}: STEP files are read by the package cascadio, which is not installed. Install it with: "
            "pip install 'polish-sim[cad]'. Or export the part as STL."
        )
    with tempfile.TemporaryDirectory(prefix="polish_sim_") as folder:
        source, target = Path(folder) / "part.step", Path(folder) / "triangles.npy"
        source.write_bytes(content)
        _triangulate(source, target, path, SECONDS + SECONDS_PER_MB * 1e-6 * len(content))
        corners = 1e3 * np.load(target)
    if not len(corners):
        raise MeshError(f"{path}: the STEP file holds no solid and no surface. Export the part as a solid.")
    note = f"STEP file: triangulated within {CHORD_MM:g} mm, in the unit it states"
    return FileTriangles(corners, np.arange(len(corners), dtype=np.int32), (note,), "mm")


def _triangulate(source: Path, target: Path, path: Path, longest: float) -> None:
    """Run `_write_triangles` for no more than ``longest`` [s] in a process of its own, which imports nothing
    of this package: a CAD kernel may hang or crash on a broken file. What it prints is not kept."""
    call = f"_write_triangles{(str(source), str(target), CHORD_MM, ANGLE_RAD, MEMORY)}"
    command = [sys.executable, "-P", "-c", f"{getsource(_write_triangles)}\n{call}"]
    few = {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}  # each thread would take of the memory
    quiet = subprocess.DEVNULL
    try:
        done = subprocess.run(
            command,
            env=os.environ | few,
            timeout=longest,
            stdin=quiet,
            stdout=quiet,
            stderr=quiet,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise MeshError(
            f"{path}: triangulating the STEP file takes longer than {longest:.0f} s: the file is broken, or "
            "far too large a part for the robot. Export the part alone, or as STL."
        ) from None
    if done.returncode != 0 or not target.exists():
        raise MeshError(
            f"{path}: the CAD kernel cannot read the STEP file (broken, or it needs more than "
            f"{MEMORY / 1e9:g} GB). Export the part alone, or as STL."
        )


def _write_triangles(source: str, target: str, chord_mm: float, angle_rad: float, memory: int) -> None:
    """Write the triangles of a STEP file [m], shape (m, 3, 3), as a npy file, in ``memory`` [bytes] at
    most."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    except (ImportError, ValueError, OSError):
        pass  # Windows and macOS have no such limit; that of time stays
    import numpy as np
    import trimesh

    with open(source, "rb") as file:
        scene = trimesh.load_scene(file, file_type="step", tol_linear=chord_mm, tol_angular=angle_rad)
    np.save(
        target,
        np.asarray(scene.to_mesh().triangles if scene.geometry else np.empty((0, 3, 3)), dtype=np.float64),
    )


class _Format(NamedTuple):
    recognises: Callable[[bytes], bool]  #: Decides from the content alone; never wrong when it says yes
    parse: Callable[[bytes, Path], FileTriangles]  #: Content and name (for messages) to triangles


FORMATS: Mapping[str, _Format] = {
    ".ply": _Format(is_ply, parse_ply),
    ".stl": _Format(is_stl, parse_stl),
    ".obj": _Format(is_obj, parse_obj),
    **dict.fromkeys(STEP_ENDINGS, _Format(is_step, parse_step)),
}
"""By the usual ending of the name."""
