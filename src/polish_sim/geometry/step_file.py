"""Read a STEP file: solids and surfaces of CAD, triangulated by Open CASCADE in a process of its own."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from inspect import getsource
from pathlib import Path

import numpy as np

from polish_sim.errors import MeshError
from polish_sim.geometry.polygon import FileTriangles

#: Chords are this close to the solid [mm]; the surface through them is 100 times closer
CHORD_MM = 0.1
#: Neighbouring facets of a smooth face bend by no more: well below plan.feature_angle_rad
ANGLE_RAD = 0.2
SECONDS, SECONDS_PER_MB = 9.0, 6.0  #: A file that takes longer is refused [s, s/MB]
MEMORY = 4_000_000_000  #: Of the process that reads it [bytes]
ENDINGS = (".step", ".stp")  #: Of files that state their own unit
_FIRST, _LAST = b"ISO-10303-21;", b"END-ISO-10303-21;"


def is_step(content: bytes) -> bool:
    """A STEP file begins with the number of its standard."""
    return content[:256].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(_FIRST)


def parse_step(content: bytes, path: Path) -> FileTriangles:
    """The faces of a STEP file as triangles in mm, whichever unit the file states.

    Raises:
        MeshError: The reader is not installed, or the file is no STEP file, cut short, broken, without a face
            or too much for the limits of time and memory.
    """
    if not is_step(content):
        raise MeshError(
            f"{path}: not a STEP file (it does not begin with {_FIRST.decode()}). Export the part again."
        )
    if _LAST not in content[-4096:]:
        raise MeshError(
            f"{path}: the STEP file is cut short (no {_LAST.decode()} at its end). Export it again."
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
