"""Options that would change nothing are refused rather than ignored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from polish_sim.config import PlanConfig
from polish_sim.errors import InputError
from polish_sim.experiments.registry import experiment, refuse_idle_options

PATTERN_KEYS: Final = {
    "--order": "order",
    "--direction": "direction",
    "--start": "start",
    "--raster-direction": "raster_direction",
}
PAIR_OPTIONS: Final = ("--master-speed", "--master-turn", "--master-path", "--standoff")
"""What only two robots have."""


def refuse_idle_in(name: str, given: Mapping[str, Any]) -> None:
    """Refuse options that change nothing in an experiment.

    Args:
        name: The experiment.
        given: Options by name; None = not given.

    Raises:
        InputError: Naming them.
    """
    refuse_idle_options(experiment(name), [option for option, value in given.items() if value is not None])


def refuse_one_robot(given: Mapping[str, Any]) -> None:
    """Refuse options of two robots where a plan is for one.

    Raises:
        InputError: Naming them.
    """
    idle = [option for option in PAIR_OPTIONS if given.get(option) is not None]
    if idle:
        raise InputError(f"{', '.join(idle)} is for two robots: give --dual as well, or leave it out.")


def refuse_idle_on_path(plan: PlanConfig, listens: Mapping[str, tuple[str, ...]], given: Mapping[str, Any]) -> None:
    """Refuse options the chosen pattern, or axis smoothing that is off, takes no notice of.

    Args:
        plan: What is to be planned.
        listens: The keys every pattern obeys, by the pattern's name.
        given: Options by name; None = not given.

    Raises:
        InputError: Naming the first one and where it would count.
    """
    obeyed = listens.get(plan.pattern)
    for option, key in PATTERN_KEYS.items():
        if given.get(option) is not None and obeyed is not None and key not in obeyed:
            where = ", ".join(sorted(name for name, keys in listens.items() if key in keys))
            raise InputError(
                f"{option} would change nothing with the pattern '{plan.pattern}': leave it out. "
                f"It counts for: {where}."
            )
    if given.get("--axis-deviation") is not None and plan.axis_smoothing_m == 0.0:
        raise InputError("--axis-deviation bounds --axis-smoothing, which is off: give --axis-smoothing MM as well.")
