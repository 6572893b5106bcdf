"""What many tests need and none changes: it is made once. Distance fields, plans of shipped parts and the run
on the freeform part are shared on disk, by their inputs, the package's source and the versions of libraries;
shipped parts and the surfaces fitted to them are kept in each process."""

import copy
import copyreg
import hashlib
import os
import pickle
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields
from functools import cache, wraps
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import trimesh
import typer

from polish_sim.geometry import distance_field, fit, mesh
from polish_sim.models import workpiece_path
from polish_sim.spatial import wxyz
from polish_sim.workers import versions_here

try:
    import fcntl
except ImportError:  # Windows: what two processes need at once is made twice
    fcntl = None  # type: ignore[assignment]

KEY = hashlib.sha256(repr((versions_here(), __file__)).encode()).hexdigest()[:16]
FOLDER = Path(__file__).parents[1] / ".pytest_cache" / "kept" / KEY
KEPT_S = 24.0 * 3600.0  #: What another source made is removed after this time


def share_fields() -> None:
    """Let every distance field of this process come from disk where one of the processes has made it."""
    if os.environ.get("PYTEST_XDIST_WORKER", "gw0") == "gw0":
        for old in set(FOLDER.parent.glob("*")) - {FOLDER}:
            if time.time() - old.stat().st_mtime > KEPT_S:  # of another source; its tests may be under way
                shutil.rmtree(old, ignore_errors=True)
    made = distance_field.build_distance_field

    def kept(surface: Any, spacing: float, band: float, bounds: Any = None) -> Any:
        arrays = [getattr(surface, field.name) for field in fields(surface)]
        return keep(("field", arrays, spacing, band, bounds), lambda: made(surface, spacing, band, bounds))

    distance_field.build_distance_field = kept


def share_parts() -> None:
    """Read, repair and fit each shipped part once in this process; its arrays are read-only."""
    read, fitted, shipped = mesh.load_part, fit.fit_surface, workpiece_path("plate").parent
    known, surfaces = cache(read), dict[tuple[int, tuple[Any, ...]], tuple[Any, Any]]()

    @wraps(read)
    def load_part(path: str | Path, *words: str, **named: str) -> Any:
        return (known if Path(path).parent == shipped else read)(Path(path), *words, **named)

    @wraps(fitted)
    def fit_surface(part: Any, *angle: float, **named: float) -> Any:
        if part.path.parent != shipped:
            return fitted(part, *angle, **named)
        key = id(part), (*angle, *named.values())
        if key not in surfaces:  # with the part, so that no other one gets its id
            surfaces[key] = part, fitted(part, *angle, **named)
        return surfaces[key][1]

    mesh.load_part, fit.fit_surface = load_part, fit_surface


def share_scenes() -> None:
    """Compile the scene in which motions of two robots are checked once for each part; its hulls take long.
    To be called last: with the scene come modules that take the other functions by name."""
    from polish_sim.dual import scene

    made, known = scene.build_pair_scene, dict[Any, Any]()

    def build_pair_scene(scenario: Any, T_follower_master: Any, held: Any, tables: Any = None) -> Any:
        if held.clearances is None or tables is not None:
            return made(scenario, T_follower_master, held, tables)
        robot, mesh = scenario.robot, held.mesh
        things = robot.arm, robot.payload_error, scenario.head, scenario.pad, scenario.simulation
        key = *things, mesh.sha256, mesh.vertices.tobytes(), *held._replace(mesh=None, T_flange_part=None)
        if key not in known:
            known[key] = made(scenario, T_follower_master, held)
        model = copy.copy(known[key])
        for name, T in (("base", T_follower_master), ("part", held.T_flange_part)):
            body = model.body(f"{scene.MASTER}{name}")
            body.pos, body.quat = T[:3, 3], wxyz(T[:3, :3])
        return model

    scene.build_pair_scene = build_pair_scene


def share_commands() -> None:
    """Build each command line once in this process: it takes longer than to refuse a wrong word."""
    typer.main.get_command = cache(typer.main.get_command)


def plate_file(side_mm: float = 200.0) -> Path:
    """The shipped plate, or a smaller one, in twelve facets: to sample its distances takes little time."""
    file = FOLDER / f"plate_{side_mm:g}.stl"
    if not file.exists():
        FOLDER.mkdir(parents=True, exist_ok=True)
        draft = file.with_suffix(f".{os.getpid()}.stl")
        trimesh.creation.box((side_mm, side_mm, 20.0)).apply_translation([0.0, 0.0, 10.0]).export(draft)
        draft.replace(file)
    return file


def keep(inputs: Any, make: Callable[[], Any]) -> Any:
    """What was made of the same inputs, which begin with its kind, by the same source before, or made now."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / hashlib.sha256(pickle.dumps(inputs)).hexdigest()[:24]
    with file.with_suffix(".lock").open("ab") as lock:
        if fcntl is not None:
            fcntl.flock(lock.fileno(), fcntl.LOCK_EX)
        with suppress(FileNotFoundError, EOFError, pickle.UnpicklingError):  # not there yet, or damaged
            return pickle.loads(file.read_bytes())
        result = make()
        draft = file.with_suffix(f".{os.getpid()}")
        with draft.open("wb") as stream:
            _KeepsFrozen(stream).dump(result)
        draft.replace(file)
        return result


class _KeepsFrozen(pickle.Pickler):
    """Read-only arrays are read-only when they come back: kernels would be compiled again for others."""

    def reducer_override(self, thing: Any) -> Any:
        if isinstance(thing, np.ndarray) and not thing.flags.writeable:
            return _frozen, (thing.copy("K"),)
        return NotImplemented


def _frozen(array: Any) -> Any:
    array.flags.writeable = False
    return array


def _columns(named: dict[str, Any]) -> MappingProxyType[str, Any]:
    return MappingProxyType(named)


copyreg.pickle(MappingProxyType, lambda columns: (_columns, (dict(columns),)))
