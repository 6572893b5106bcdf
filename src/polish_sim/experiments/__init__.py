"""The experiments: one readable function each, from a scenario to figures (layer 9)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from polish_sim.cell.observer import Observer
from polish_sim.config.part import PartConfig
from polish_sim.config.scenario import Scenario
from polish_sim.config.smoothing import SmoothingConfig
from polish_sim.config.spindle import SpindleConfig
from polish_sim.errors import unknown_name
from polish_sim.experiments.arc import prepare_arc, run_arc
from polish_sim.experiments.force import prepare_force, run_force
from polish_sim.experiments.payload import PAYLOAD_SCENARIO, PayloadCalibration, calibrate_from, run_payload_calibration
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.result import RunResult
from polish_sim.experiments.stroke_motion import time_law
from polish_sim.experiments.surface import SurfaceTask, prepare_surface, run_surface
from polish_sim.planning.part_plan import PlanResult
from polish_sim.planning.toolpath import ToolPath
from polish_sim.smoothing.trial import AXIS_TOLERANCE, TOLERANCE

_DEFAULTS = {
    "arc": Scenario(experiment="arc", spindle=SpindleConfig(speed_rpm=0.0)),
    "force": Scenario(experiment="force", part=PartConfig(file="plate"), spindle=SpindleConfig(speed_rpm=0.0)),
    "surface": Scenario(experiment="surface"),
    "smooth": Scenario(
        experiment="smooth",
        spindle=SpindleConfig(speed_rpm=0.0),
        smoothing=SmoothingConfig(tolerance_m=TOLERANCE, axis_tolerance_rad=AXIS_TOLERANCE),
    ),
    "teach": Scenario(experiment="teach", spindle=SpindleConfig(speed_rpm=0.0)),
    "dual": Scenario(experiment="dual", part=PartConfig(file="wheel_hub_rim")),
}

EXPERIMENTS: Mapping[str, str] = MappingProxyType(
    {
        "arc": "the tool point on a circle in free space at constant feed (paper 1, fig. 12)",
        "force": "a step of the contact force from first contact, at one point (paper 1, fig. 13)",
        "surface": "polish a part along a planned path under force control (paper 1, fig. 14, 15)",
        "smooth": "one path played with every smoothing rule on the joint servos (paper 4, fig. 10)",
        "teach": "a hand guides the arm, whose torques make it light (paper 3, fig. 6)",
        "dual": "two robots: the master moves the part, the follower polishes its rim meanwhile (paper 2)",
    }
)


def default_scenario(experiment: str) -> Scenario:
    """The scenario an experiment starts from.

    Raises:
        InputError: If there is no such experiment; lists the known ones.
    """
    if experiment not in _DEFAULTS:
        raise unknown_name("experiment", experiment, EXPERIMENTS)
    return _DEFAULTS[experiment]


class CheckedPath(NamedTuple):
    """A path and the way the arm does all of it."""

    path: ToolPath
    reach: Reach
    held: str = ""
    """How a second robot holds the part, for the user."""


def check_experiment(
    scenario: Scenario, plan: PlanResult | None = None, observer: Observer | None = None
) -> CheckedPath:
    """Plan the path of an experiment and check that the arm can do it, without simulating anything.

    Args:
        scenario: The scenario.
        plan: A plan made before, for ``surface``; planned if not given.
        observer: Told of the progress.

    Returns:
        The path (of ``arc`` in the base frame, else in the work frame) and its reach.

    Raises:
        PolishSimError: If the scenario cannot be run.
    """
    if scenario.experiment == "arc":
        return CheckedPath(*prepare_arc())
    if scenario.experiment == "force":
        task = prepare_force(scenario, observer)
        return CheckedPath(task.path, task.reach)
    if scenario.experiment == "surface":
        prepared = prepare_surface(scenario, plan, observer)
        return CheckedPath(prepared.plan.path, prepared.reach)
    if scenario.experiment == "dual":
        from polish_sim.dual.placement import seat_text
        from polish_sim.dual.task import prepare_dual

        pair = prepare_dual(scenario, plan, observer)
        return CheckedPath(pair.place.path, pair.place.reach, seat_text(pair.seat.T_gripper_work))
    if scenario.experiment == "smooth":
        from polish_sim.smoothing.smooth import path_of_task, prepare_smooth

        return CheckedPath(*path_of_task(prepare_smooth(scenario)))
    raise unknown_name("experiment", scenario.experiment, EXPERIMENTS)


def run_experiment(scenario: Scenario, plan: PlanResult | None = None, observer: Observer | None = None) -> RunResult:
    """Run the experiment a scenario names.

    Args:
        scenario: The scenario.
        plan: A plan made before, for ``surface``; planned if not given.
        observer: Told of the progress.

    Returns:
        What the run left behind; a protective stop or an interrupt is noted there, not raised.

    Raises:
        PolishSimError: If the scenario cannot be run.
    """
    if scenario.experiment == "arc":
        return run_arc(scenario, observer)
    if scenario.experiment == "force":
        return run_force(scenario, observer)
    if scenario.experiment == "surface":
        return run_surface(scenario, plan, observer)
    if scenario.experiment == "smooth":
        from polish_sim.smoothing.smooth import run_smooth

        return run_smooth(scenario, observer)
    if scenario.experiment == "teach":
        from polish_sim.hand_guiding.drag import run_drag
        from polish_sim.hand_guiding.teach import run_teach

        return run_drag(scenario, observer) if scenario.drag.follow else run_teach(scenario, observer)
    if scenario.experiment == "dual":
        from polish_sim.dual.dual import run_dual

        return run_dual(scenario, plan, observer)
    raise unknown_name("experiment", scenario.experiment, EXPERIMENTS)


__all__ = [
    "EXPERIMENTS",
    "PAYLOAD_SCENARIO",
    "CheckedPath",
    "PayloadCalibration",
    "RunResult",
    "SurfaceTask",
    "calibrate_from",
    "check_experiment",
    "default_scenario",
    "prepare_surface",
    "run_arc",
    "run_experiment",
    "run_force",
    "run_payload_calibration",
    "run_surface",
    "time_law",
]
