"""What of a scenario is wrong whatever the part: told before anything is loaded, planned or simulated (layer 9)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from polish_sim.calibration import read_calibrated_tool
from polish_sim.cell import parse_events
from polish_sim.cell.faults import check_events
from polish_sim.cell.limits import check_contact_settings, check_rates
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.errors import InputError
from polish_sim.experiments.part_setup import strongest
from polish_sim.models import part_path
from polish_sim.planning import ToolPath
from polish_sim.planning.asked import check_asked, check_part_words

CONTROLLED: Final = ("arc", "force", "surface", "dual")
"""Experiments in which a controller drives the cell."""
ON_PART: Final = ("force", "surface", "dual")
"""Those with a part to press on."""


def check_settings(scenario: Scenario, plans: bool) -> None:
    """Refuse a scenario that could not be run on any part.

    Args:
        scenario: What is to be run.
        plans: Whether a path is planned over the part's region.

    Raises:
        PolishSimError: Naming what is wrong and what to do.
    """
    if scenario.payload.file:
        read_calibrated_tool(Path(scenario.payload.file))
    events = parse_events(scenario.faults.events)
    if scenario.experiment not in CONTROLLED:
        return
    if scenario.experiment in ON_PART:
        if plans:
            check_asked(scenario.part, scenario.plan, scenario.pad)
        else:
            check_part_words(scenario.part, scenario.plan)
        _check_real_part(scenario.part.real_file)
    check_rates(scenario)
    check_events(events, scenario.experiment in ON_PART, two_robots=scenario.experiment == "dual")
    build_controller(scenario.controller)


def check_force(scenario: Scenario, path: ToolPath | None) -> None:
    """Refuse a force that pad, head and guards cannot bear.

    Args:
        scenario: What is to be run.
        path: A path made before, which may say its own forces; None if it is planned.

    Raises:
        ConfigError: Naming the limit that is broken.
    """
    if scenario.experiment in CONTROLLED:
        check_contact_settings(scenario if path is None else strongest(scenario, path))


def _check_real_part(name: str) -> None:
    if name and not part_path(name).is_file():
        raise InputError(f"the real part '{name}' is no file. Check the name and the folder (--real-part).")
