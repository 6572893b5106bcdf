"""Experiment ``surface``: polish a part along a planned path under force control (paper 1, fig. 14, 15; layer 9)."""

from __future__ import annotations

from typing import NamedTuple

from polish_sim.analysis.metrics import measure_surface
from polish_sim.cell import Cell, Observer, Silent, build_real_part, build_scene
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.experiments.part_setup import (
    PART_STREAM,
    SENSOR_STREAM,
    part_file,
    polishing_job,
    random_streams,
    reach_path,
)
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.result import RunResult, common_figures
from polish_sim.geometry import PartMesh, Region, Surface, fit_surface, load_part, select_region
from polish_sim.planning import ToolPath, plan_path


class SurfaceTask(NamedTuple):
    """A part, the path on it and the way the arm does it, all checked before anything moves."""

    mesh: PartMesh
    surface: Surface
    region: Region
    path: ToolPath
    reach: Reach


def prepare_surface(scenario: Scenario, path: ToolPath | None = None, observer: Observer | None = None) -> SurfaceTask:
    """Load the part, plan its path (unless one is given) and check that the arm can do all of it.

    Args:
        scenario: The scenario.
        path: A path made before, work frame.
        observer: Told of the progress.

    Returns:
        The task.

    Raises:
        PolishSimError: If the part cannot be used, planned or reached.
    """
    observer = observer or Silent()
    observer.stage("fit the surface")
    mesh = load_part(part_file(scenario.part.file), scenario.part.unit, scenario.part.up)
    surface = fit_surface(mesh)
    region = select_region(surface, mesh, scenario.plan.region)
    if path is None:
        observer.stage("plan the path")
        path = plan_path(region, scenario.plan, lambda share: observer.progress(share, 1.0))
    observer.stage("check the reach")
    return SurfaceTask(mesh, surface, region, path, reach_path(scenario, mesh, path))


def run_surface(scenario: Scenario, path: ToolPath | None = None, observer: Observer | None = None) -> RunResult:
    """Polish a part and measure how well the force was held.

    Args:
        scenario: The scenario.
        path: A path made before, work frame; planned if not given.
        observer: Told of the progress.

    Returns:
        Log, trace, path and figures.

    Raises:
        PolishSimError: If the part cannot be used, planned or reached.
    """
    observer = observer or Silent()
    streams = random_streams(scenario.seed)
    mesh, surface, region, path, reach = prepare_surface(scenario, path, observer)
    observer.stage("prepare the cell")
    part = build_real_part(surface, scenario.part, reach.T_base_work, region.surface, mesh.up, streams[PART_STREAM])
    job = polishing_job(scenario, path, reach, hold=0.0, lift=scenario.plan.clearance_m)
    cell = Cell(
        scenario, build_scene(scenario, mesh, part), part, job, reach.q_start,
        build_controller(scenario.controller), streams[SENSOR_STREAM],
    )  # fmt: skip
    observer.stage("simulate")
    run = cell.run(observer)
    fed = run.trace.path_s_m[run.trace.phase == 2]
    done = float((fed[-1] - job.start_s) / job.process.length) if len(fed) else 0.0
    figures = measure_surface(run.trace, path, scenario.process.contact_force_n)
    figures |= common_figures(run, scenario, min(done, 1.0), reach.T_base_work)
    return RunResult(scenario, run.log, run.trace, figures, run.stop_reason, run.interrupted, path)
