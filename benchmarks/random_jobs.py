"""A polishing job of chance, the same for the same seed: a part, settings and a region (seed -> the words of
`plan`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from trimesh.transformations import random_rotation_matrix

from benchmarks.random_bodies import draw_mesh, log_uniform
from polish_sim.arrays import Array

Generator = np.random.Generator
SIZES_MM = (60.0, 280.0)  #: Largest dimension of a part
UNITS_MM = {"mm": 1.0, "inch": 25.4, "m": 1000.0}
TURNED = 0.3  #: Share of the parts whose file stands askew


class Job(NamedTuple):
    """What is planned."""

    name: str  #: Of the part's kind or file
    mesh: trimesh.Trimesh  #: As its file holds it
    region: tuple[str, ...]  #: Words of units, region and the side that is up
    planned: tuple[str, ...]  #: Other words only `plan` takes
    cell: tuple[str, ...]  #: Words of the cell, which a run repeats


class Option(NamedTuple):
    """An option a job may have."""

    share: float  #: Of the jobs that have it
    name: str  #: As on the command line; with ``=`` behind it, a key of `--set`
    value: Callable[[Generator], str]


def _number(low: float, high: float, even: bool = True) -> Callable[[Generator], str]:
    """Draws a number, ``even`` or its logarithm is."""
    return lambda rng: f"{rng.uniform(low, high) if even else log_uniform(rng, low, high):.3g}"


def _one_of(*words: str) -> Callable[[Generator], str]:
    return lambda rng: str(rng.choice(words))


def _pose(rng: Generator) -> str:
    """A pose before the robot [m, rad], turned about z, or leaning by up to 30 degrees."""
    turn = np.array([0.0, 0.0, rng.uniform(-3.0, 3.0)])
    if rng.random() < 0.6:
        turn = rng.normal(size=3) * math.radians(rng.uniform(2.0, 30.0))
    place = rng.uniform((-0.3, -0.75, 0.05), (0.3, -0.35, 0.35))
    return "[" + ", ".join(f"{value:.3f}" for value in (*place, *turn)) + "]"


PLANNED = (
    Option(0.6, "--pattern", _one_of("spiral", "raster", "contour", "fermat")),
    Option(0.75, "--contact-force", _number(3.0, 60.0, even=False)),
    Option(
        0.95, "--feed", lambda rng: "auto" if rng.random() < 0.1 else _number(10.0, 80.0, even=False)(rng)
    ),
    Option(0.55, "--pad-diameter", _number(10.0, 60.0, even=False)),
    Option(0.5, "--overlap", _number(20.0, 80.0)),
    Option(0.25, "--lead-angle", _number(-12.0, 12.0)),
    Option(0.35, "--tilt-angle", _number(-12.0, 12.0)),
    Option(0.2, "--edge-margin", _number(0.0, 15.0)),
    Option(0.1, "--hole-margin", _number(0.0, 8.0)),
    Option(0.35, "--lead-in", _one_of("tangent", "arc")),
    Option(0.2, "--avoid", _one_of("tilt")),
    Option(0.15, "--overrun", _number(1.0, 15.0)),
    Option(0.15, "--axis-smoothing", _number(5.0, 60.0)),
    Option(0.25, "--even-removal", _one_of("")),
    Option(0.3, "part.pose=", _pose),
)
CELL = (
    Option(0.6, "--controller",
           _one_of("hybrid-pi", *2 * ["hybrid-adaptive"], "force-mode", "hybrid-pi-position")),
    Option(0.3, "robot.arm=", _one_of("ur10e", "ur10e", "ideal")),
    Option(0.3, "sensor.model=", _one_of("axia80", "hex-125hz", "ur5e-built-in")),
    Option(0.3, "spindle.speed_rpm=", _number(500.0, 12000.0)),
    Option(0.1, "head.stiffness_n_m=", _number(2000.0, 12000.0)),
    Option(0.06, "process.tare=", _one_of("strokes")),
    Option(0.1, "smoothing.rule=", _one_of("joint-jerk", "joint-acceleration")),
)  # fmt: skip


def draw_job(seed: int, files: Sequence[Path], folder: Path) -> Job:
    """Draw a job on a part drawn too, or one of the ``files``.

    A region of listed facets is written into the ``folder``.
    """
    rng = np.random.default_rng([seed, 21])
    name, mesh = draw_mesh(seed, files, rng)
    mesh.apply_scale(log_uniform(rng, *SIZES_MM) / mesh.extents.max())
    if rng.random() < TURNED:
        mesh.apply_transform(random_rotation_matrix(rng.random(3)))
    region = _draw_region(mesh, folder, rng)
    unit = str(rng.choice(list(UNITS_MM), p=[0.9, 0.05, 0.05]))
    mesh.apply_scale(1.0 / UNITS_MM[unit])
    units = () if unit == "mm" and rng.random() < 0.8 else ("--units", unit)
    return Job(name, mesh, (*units, *region), _draw_words(PLANNED, rng), _draw_words(CELL, rng))


def _draw_region(mesh: trimesh.Trimesh, folder: Path, rng: Generator) -> tuple[str, ...]:
    """A region [mm] and the side that is up; neither for two parts of five."""
    low, high = mesh.bounds
    seen = int(rng.choice(len(mesh.faces), p=mesh.area_faces / mesh.area_faces.sum()))
    middle = mesh.triangles_center[seen]
    kinds = {"": 0.4, "top": 0.15, "point": 0.15, "box": 0.1, "faces": 0.1, "polygon": 0.1}
    kind = str(rng.choice(list(kinds), p=list(kinds.values())))
    words = kind
    if kind == "point":
        words = f"point:{_joined(middle)}"
    if kind == "box":
        cut = rng.uniform(0.0, 0.45, (2, 3)) * (high - low) * (1.0, 1.0, 0.0)
        words = f"box:{_joined([*(low + cut[0] - 0.5), *(high - cut[1] + 0.5)])}"
    if kind == "faces":
        near = np.linalg.norm(mesh.triangles_center - middle, axis=1)
        near = near < rng.uniform(0.2, 0.6) * np.linalg.norm(high - low)
        faces = np.flatnonzero(near & (mesh.face_normals @ mesh.face_normals[seen] > 0.7))
        file = folder / "faces.txt"
        file.write_text("\n".join(map(str, faces)) + "\n")
        words = f"faces:{file}"
    if kind == "polygon":
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(3, 9)))
        flat = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.2, 0.6, (len(angle), 1))
        corners = 0.5 * (low + high)[:2] + flat * (high - low)[:2]
        words = "polygon:" + ";".join(_joined([*corner, high[2]]) for corner in corners)
    side = ("--up", str(rng.choice(["x", "y", "z", "-x", "-y", "-z"]))) if rng.random() < 0.12 else ()
    return (*(("--region", words) if words else ()), *side)


def _joined(values: Sequence[float] | Array) -> str:
    return ",".join(f"{value:.2f}" for value in values)


def _draw_words(options: Sequence[Option], rng: Generator) -> tuple[str, ...]:
    """The words of those options that a job has."""
    words: list[str] = []
    for option in options:
        value = option.value(rng)
        if rng.random() < option.share:
            words += ["--set", option.name + value] if option.name.endswith("=") else [option.name, value]
    return tuple(word for word in words if word)
