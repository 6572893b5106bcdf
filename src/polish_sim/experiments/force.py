"""Experiment ``force``: a step of the contact force from first contact, at one point (paper 1, fig. 13; layer 9)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from polish_sim.analysis.metrics import measure_force
from polish_sim.cell import Cell, Observer, Silent, Touch, build_real_part, build_scene
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.experiments.part_setup import (
    PART_STREAM,
    SENSOR_STREAM,
    part_file,
    polishing_strokes,
    random_streams,
    reach_path,
)
from polish_sim.experiments.result import RunResult, common_figures
from polish_sim.geometry import Region, fit_surface, load_part, select_region
from polish_sim.planning.toolpath import APPROACH, PROCESS, ToolPath

START_HEIGHT = 0.01  # of the tool above the part [m]


def touch_path(region: Region) -> ToolPath:
    """Straight down onto the middle of a region: one point to press on."""
    areas = region.surface.facet_areas
    centroids = region.surface.vertices[region.surface.faces].mean(axis=1)
    middle = (areas @ centroids) / areas.sum()
    touch = region.surface.closest(middle[None])
    point, axis = touch.positions[0], touch.normals[0]
    return ToolPath(
        np.stack([point + START_HEIGHT * axis, point]),
        np.stack([axis, axis]),
        np.array([0.0, START_HEIGHT]),
        np.zeros(2, np.int64),
        np.array([APPROACH, PROCESS], np.int8),
        np.zeros(2),
    )


def run_force(scenario: Scenario, observer: Observer | None = None) -> RunResult:
    """Press on one point, hold, and measure the step response from first contact.

    Args:
        scenario: The scenario; the path's pattern and feed play no role, and the spindle stands still.
        observer: Told of the progress.

    Returns:
        Log, trace and figures.

    Raises:
        PolishSimError: If the part cannot be used or the point not reached.
    """
    observer = observer or Silent()
    scenario = replace(scenario, spindle=replace(scenario.spindle, speed_rpm=0.0))
    streams = random_streams(scenario.seed)
    observer.stage("fit the surface")
    mesh = load_part(part_file(scenario.part.file), scenario.part.unit, scenario.part.up)
    surface = fit_surface(mesh)
    region = select_region(surface, mesh, scenario.plan.region)
    path = touch_path(region)
    reach = reach_path(scenario, mesh, path)
    observer.stage("prepare the cell")
    touch = Touch(path.positions_work[path.process], path.axes_work[path.process], scenario.pad.radius_m)
    part = build_real_part(
        surface, scenario.part, reach.T_base_work, region.surface, mesh.up, touch, streams[PART_STREAM]
    )
    hold = scenario.process.hold_s
    cell = Cell(
        scenario, build_scene(scenario, mesh, part), part, polishing_strokes(scenario, path, reach, hold, 0.0),
        reach.q_start, build_controller(scenario.controller), streams[SENSOR_STREAM],
    )  # fmt: skip
    observer.stage("simulate")
    run = cell.run(observer)
    held = float(np.sum(run.trace.phase == 2)) * scenario.simulation.timestep_s
    figures = measure_force(run.trace, scenario.process.contact_force_n)
    common = common_figures(run, scenario, min(1.0, (held + 1e-9) / hold), reach.T_base_work)
    return RunResult(scenario, run.log, run.trace, figures | common, run.stop_reason, run.interrupted, path)
