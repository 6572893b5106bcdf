"""Experiment ``force``: a step of the contact force from first contact, at one point (paper 1, fig. 13)."""

from __future__ import annotations

import numpy as np

from polish_sim.analysis.metrics import measure_force
from polish_sim.arrays import Figures
from polish_sim.cell import SILENT, Cell, CellRun, Observer
from polish_sim.config import Checked
from polish_sim.experiments.assembly import Workplace, build_cell, build_part, kept_place
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.experiments.part_setup import real_shape
from polish_sim.experiments.result import RunResult, common_figures
from polish_sim.geometry import Region, fit_surface, select_region
from polish_sim.planning.part_plan import load_mesh
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


def place_force(scenario: Checked, observer: Observer = SILENT) -> Workplace:
    """Load the part, choose the point to press on and check the reach; the path is one point with the way
    down to it.

    The last few places are kept: the next run on the same point has it at once.

    Raises:
        PolishSimError: If the part cannot be used or the point not reached.
    """

    def make() -> Workplace:
        observer.stage("fit the surface")
        mesh = load_mesh(scenario.part)
        angle = scenario.plan.feature_angle_rad
        surface = fit_surface(mesh, angle)
        region = select_region(surface, mesh, scenario.plan.region, angle)
        path = touch_path(region)
        reach = PartPlacing(scenario, mesh, surface, path).reach()
        shape = real_shape(scenario.part, angle, mesh, surface, path)
        return Workplace(mesh, surface, region, path, reach, shape, holds=True)

    return kept_place(scenario, make)


def prepare_force(scenario: Checked, observer: Observer = SILENT) -> tuple[Workplace, Cell]:
    """Load the part, choose the point, check the reach and set the cell up, not yet run; raises as
    `place_force`."""
    place = place_force(scenario, observer)
    observer.stage("prepare the cell")
    return place, build_cell(scenario, place, build_part(scenario, place))


def check_force_point(scenario: Checked, observer: Observer = SILENT) -> Workplace:
    """The point to press on and how the arm reaches it, the cell set up but not run; raises as
    `place_force`."""
    return prepare_force(scenario, observer)[0]


def run_force(scenario: Checked, observer: Observer = SILENT) -> RunResult:
    """Press on one point, hold, and measure the step response from first contact; raises as `place_force`.

    The path's pattern and feed play no role. The default leaves the spindle off.
    """
    place, cell = prepare_force(scenario, observer)
    observer.stage("simulate")
    return measure_hold(scenario, place, cell.run(observer))


def measure_hold(scenario: Checked, place: Workplace, run: CellRun) -> RunResult:
    """How well a ``run`` has pressed on its point."""
    figures: Figures = dict(measure_force(run.trace, scenario.process.contact_force_n))
    figures |= common_figures(run, scenario, hold_done(scenario.process.hold_s, run), place.reach.T_base_work)
    return RunResult(
        scenario, run.log, run.trace, figures, run.stop_reason, run.interrupted, place.path, None,
        run.files,
    )  # fmt: skip


def hold_done(hold_s: float, run: CellRun) -> float:
    """Share of the time on the point that was held, 0 to 1."""
    return min(1.0, np.sum(run.trace.fed) / round(hold_s / run.dt))
