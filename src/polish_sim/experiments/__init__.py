"""The experiments: a registry of them, and one readable function each, from a scenario to figures.

Each name loads its module at first use: a command that only lists experiments does not wait for the
simulator.
"""

from typing import TYPE_CHECKING

from polish_sim.lazy import names_on_use

if TYPE_CHECKING:
    from polish_sim.experiments.free_space import run_arc
    from polish_sim.experiments.payload import PayloadCalibration, calibrate_from, run_payload_calibration
    from polish_sim.experiments.registry import check_experiment, default_scenario, run_experiment
    from polish_sim.experiments.result import RunResult
    from polish_sim.experiments.rows import PAYLOAD_SCENARIO
    from polish_sim.experiments.surface import prepare_force, prepare_surface, run_force, run_surface
else:
    __getattr__ = names_on_use(__name__)
