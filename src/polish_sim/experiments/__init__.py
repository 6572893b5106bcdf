"""The experiments: a registry of them, and one readable function each, from a scenario to figures.

Each name loads its module at first use: a command that only lists experiments does not wait for the simulator.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "CheckedPath": "registry",
    "Experiment": "registry",
    "PAYLOAD_SCENARIO": "rows",
    "PayloadCalibration": "payload",
    "RunResult": "result",
    "SurfaceTask": "surface",
    "calibrate_from": "payload",
    "check_experiment": "registry",
    "default_scenario": "registry",
    "experiment": "registry",
    "experiments": "registry",
    "prepare_force": "force",
    "prepare_surface": "surface",
    "run_arc": "arc",
    "run_experiment": "registry",
    "run_force": "force",
    "run_payload_calibration": "payload",
    "run_surface": "surface",
    "time_law": "cycle",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Load a public name's module at first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'polish_sim.experiments' has no attribute '{name}'")
    return getattr(import_module(f"polish_sim.experiments.{_HOME[name]}"), name)
