"""Read a STEP file: solids and surfaces of CAD, triangulated by Open CASCADE in a process of its own."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
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
_CHILD = Path(__file__).with_name("step_child.py")


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
    """Run the child for no more than ``longest`` [s]; what the CAD kernel prints is not kept."""
    settings = str(CHORD_MM), str(ANGLE_RAD), str(MEMORY)
    command = [sys.executable, "-P", str(_CHILD), str(source), str(target), *settings]
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
