"""The figures of a plan, as the contract names them (path on a region -> metrics)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import PadConfig, PlanConfig, ProcessConfig
from polish_sim.geometry import PartMesh, Surface
from polish_sim.planning.coverage import pad_covered, share_of_area, strictly_covered
from polish_sim.planning.curve import Curve
from polish_sim.planning.planner import Ground
from polish_sim.planning.quality import count_self_crossings, measure_stepover
from polish_sim.planning.toolpath import ToolPath

Array = NDArray[np.float64]

PAD_STEPS = 0.1
"""The pad is set down at this spacing in pad radii to see what it covers."""


class PathOnSurface(NamedTuple):
    """Points in contact beside the surface they belong to."""

    positions: Array
    """Tool points [m], shape (n, 3)."""
    axes: Array
    normals: Array
    """Surface normals at the closest points, shape (n, 3)."""
    curvatures: Array
    """Principal curvatures there [1/m], shape (n, 2)."""
    distances: Array
    """Distance to the part's surface [m], 0 over closed holes, shape (n,)."""
    runs: tuple[Curve, ...]
    """The stretches between lifts, with surface normals."""


def measure_plan(
    mesh: PartMesh,
    surface: Surface,
    ground: Ground,
    path: ToolPath,
    plan: PlanConfig,
    process: ProcessConfig,
    pad: PadConfig,
) -> dict[str, float | int]:
    """Measure how well a path covers its region.

    Args:
        mesh: The part.
        surface: Its whole surface.
        ground: The region as it was planned on.
        path: The path.
        plan: What was asked for.
        process: Force and feed.
        pad: The pad.

    Returns:
        Figures by their names in the contract; lengths in m. path_length_m is the length in contact;
        fit_rms_m is how far the smooth surface stands off the middles of the STL's facets, rms.
    """
    on = locate(ground, path)
    runs = on.runs
    stepover = measure_stepover(runs, plan.stepover_m)
    length = sum(run.length for run in runs)
    covered = cover(ground, on, plan.stepover_m, pad, process.contact_force_n)
    return {
        "facets": len(mesh.faces),
        "fit_rms_m": fit_rms(mesh, surface),
        "path_length_m": length,
        "cycle_time_s": length / process.feed_m_s + (path.length_m - length) / process.approach_speed_m_s,
        "stepover_mean_m": stepover.mean_m,
        "stepover_p5_m": stepover.p5_m,
        "stepover_p95_m": stepover.p95_m,
        "stepover_excluded": stepover.excluded,
        "coverage": covered.pad,
        "coverage_stepover": covered.strict,
        "self_crossings": count_self_crossings(runs),
        "retracts": len(runs),
        "max_distance_to_surface_m": float(on.distances.max()),
        "area_m2": ground.region.area_m2,
        "bridged_holes": ground.holes,
    }


class Coverage(NamedTuple):
    """Shares of the region's area, holes left out."""

    pad: float
    strict: float


def cover(ground: Ground, on: PathOnSurface, stepover: float, pad: PadConfig, force: float) -> Coverage:
    """Measure what the pad reaches at a force, and what lies within 0.55 step-overs of the path."""
    areas = ground.mesh.part_areas(ground.part_facets)
    dense = [run.at(np.linspace(0.0, run.length, int(run.length / (0.05 * stepover)) + 2)) for run in on.runs]
    points, normals = (np.concatenate([pair[k] for pair in dense]) for k in (0, 1))
    strict = strictly_covered(ground.mesh, points, normals, stepover)
    every = _every(on, PAD_STEPS * pad.radius_m)
    some, weights = _thinned(ground.mesh.vertices, areas, PAD_STEPS * pad.radius_m)
    points, normals = ground.mesh.vertices[some], ground.mesh.normals[some]
    pressed = pad_covered(points, normals, on.positions[every], on.axes[every], on.curvatures[every], pad, force)
    return Coverage(share_of_area(weights, pressed), share_of_area(areas, strict))


def _thinned(points: Array, areas: Array, cell: float) -> tuple[NDArray[np.int64], Array]:
    """One point of each cell of a grid [m], and the area of all points in the cell."""
    keys = np.floor(points / cell).astype(np.int64)
    keys -= keys.min(axis=0)
    size = keys.max(axis=0) + 1
    flat = (keys[:, 0] * size[1] + keys[:, 1]) * size[2] + keys[:, 2]
    _, first, which = np.unique(flat, return_index=True, return_inverse=True)
    return np.asarray(first, dtype=np.int64), np.asarray(np.bincount(which, weights=areas), dtype=np.float64)


def _every(on: PathOnSurface, spacing: float) -> NDArray[np.int64]:
    """Points about a spacing apart along the path."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(on.positions, axis=0), axis=1))])
    return np.unique(np.searchsorted(s, np.arange(0.0, s[-1], spacing)))


def locate(ground: Ground, path: ToolPath) -> PathOnSurface:
    """Find the surface under the points in contact."""
    surface = ground.region.surface
    index = np.flatnonzero(path.process)
    foot = surface.closest(path.positions_work[index])
    bend = surface.curvature(foot.facets, foot.barycentric)
    distance = np.linalg.norm(foot.positions - path.positions_work[index], axis=1)
    stretches = np.split(np.arange(len(index)), np.flatnonzero(np.diff(index) > 1) + 1)
    positions = path.positions_work[index]
    return PathOnSurface(
        positions=positions,
        axes=path.axes_work[index],
        normals=foot.normals,
        curvatures=np.stack([bend.k1, bend.k2], axis=1),
        distances=np.where(foot.facets < ground.part_facets, distance, 0.0),
        runs=tuple(Curve(positions[rows], foot.normals[rows], False) for rows in stretches if len(rows) > 1),
    )


def fit_rms(mesh: PartMesh, surface: Surface) -> float:
    """How far the smooth surface stands off the middles of the STL's facets, weighted by area, rms [m]."""
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    facets = np.arange(len(mesh.faces), dtype=np.int32)
    middles = np.full((len(facets), 3), 1.0 / 3.0)
    gap = np.linalg.norm(surface.evaluate(facets, middles).positions - corners.mean(axis=1), axis=1)
    return float(np.sqrt((areas * gap**2).sum() / areas.sum()))
