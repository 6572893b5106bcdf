"""polish-sim: a MuJoCo testbed for force-controlled robotic polishing.

From a part to a path, numpy in and out, lengths in metres in the frame of the part's file::

    mesh = load_part("part.stl")
    surface = fit_surface(mesh)
    region = select_region(surface, mesh)
    path = plan_path(region, PlanConfig(stepover_m=0.008))  # positions_work and axes_work, (n, 3) each
    figures = measure_path(path, region, stepover=0.008)

`plan_part` does all of it with notes for the user, `export_plan` writes it for robots, CAM systems and
browsers; `read_path` and `inspect_path` take any path; ``run_experiment(default_scenario("surface"))``
polishes in the cell.

Each name loads its module at first use, so that ``polish-sim --help`` does not wait for the simulator.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
_HOME = {
    "Scenario": "config",
    "load_scenario": "scenario_file",
    "override": "scenario_file",
    "to_toml": "scenario_file",
    "load_part": "geometry",
    "part_from_arrays": "geometry",
    "workpiece_path": "models",
    "fit_surface": "geometry",
    "select_region": "geometry",
    "PartConfig": "config",
    "PlanConfig": "config",
    "plan_path": "planning",
    "plan_part": "planning",
    "measure_path": "planning",
    "inspect_path": "planning",
    "ToolPath": "planning",
    "measure_given_path": "planning",
    "read_path": "exchange",
    "write_plan": "exchange",
    "export_plan": "exchange",
    "ExportSetup": "exchange",
    "RobotTool": "exchange",
    "default_scenario": "experiments",
    "run_arc": "experiments",
    "run_force": "experiments",
    "run_surface": "experiments",
    "run_experiment": "experiments",
    "RunResult": "experiments",
    "read_log": "log",
}

__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> Any:
    """Load a public name's module at first use."""
    if name not in _HOME:
        raise AttributeError(
            f"module 'polish_sim' has no attribute '{name}'; it offers {', '.join(sorted(_HOME))}"
        )
    return getattr(import_module(f"polish_sim.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
