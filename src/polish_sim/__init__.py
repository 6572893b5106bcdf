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

from typing import TYPE_CHECKING

from polish_sim.lazy import names_on_use

__version__ = "0.1.0"

if TYPE_CHECKING:
    from polish_sim.config import PartConfig, PlanConfig, Scenario
    from polish_sim.exchange import ExportSetup, RobotTool, export_plan, read_path, write_plan
    from polish_sim.experiments import (
        RunResult,
        default_scenario,
        run_arc,
        run_experiment,
        run_force,
        run_surface,
    )
    from polish_sim.geometry import fit_surface, load_part, part_from_arrays, select_region
    from polish_sim.log import read_log
    from polish_sim.models import workpiece_path
    from polish_sim.planning import (
        ToolPath,
        inspect_path,
        measure_given_path,
        measure_path,
        plan_part,
        plan_path,
    )
    from polish_sim.scenario_file import load_scenario, override, to_toml
else:
    __getattr__ = names_on_use(__name__)
