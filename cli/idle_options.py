"""Options that would change nothing are refused rather than ignored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from polish_sim.config import PlanConfig
from polish_sim.errors import InputError

REGION_OPTIONS: Final = ("--region", "--feature-angle", "--edge-margin")
PATTERN_KEYS: Final = {
    "--order": "order",
    "--direction": "direction",
    "--start": "start",
    "--raster-direction": "raster_direction",
}
PATH_OPTIONS: Final = (
    *REGION_OPTIONS,
    "--pattern",
    "--stepover",
    "--overlap",
    *PATTERN_KEYS,
    "--lead-in",
    "--lead-angle",
    "--tilt-angle",
    "--axis-smoothing",
    "--axis-deviation",
)
"""What decides where a planned path runs."""

HAND_OPTIONS: Final = ("--mode", "--duration", "--follow")
"""What only a hand that guides the arm has."""
PAIR_OPTIONS: Final = ("--master-speed", "--master-turn", "--master-path", "--standoff")
"""What only two robots have."""
TOLD_BY_PATH: Final = ("--master-speed", "--master-turn", "--part-pose")
"""What a file of the master's motion says already."""

IDLE: Final[Mapping[str, frozenset[str]]] = {
    "arc": frozenset(
        ("--part", "--real-part", "--part-pose", "--units", "--up")
        + ("--contact-force", "--pad-diameter", "--spindle-rpm")
        + PATH_OPTIONS
        + HAND_OPTIONS
        + PAIR_OPTIONS
    ),
    "smooth": frozenset(
        ("--part", "--real-part", "--units", "--up", "--region", "--contact-force", "--feed", "--pad-diameter")
        + ("--spindle-rpm",)
        + ("--controller", "--calibration", "--seed", "--seeds", "--fault", "--view", "--video")
        + PATH_OPTIONS
        + HAND_OPTIONS
        + PAIR_OPTIONS
    ),
    "teach": frozenset(
        ("--part", "--real-part", "--part-pose", "--units", "--up", "--contact-force", "--feed", "--pad-diameter")
        + ("--spindle-rpm", "--controller", "--calibration", "--seed", "--seeds", "--fault", "--dry-run")
        + tuple(option for option in PATH_OPTIONS if option != "--direction")
        + PAIR_OPTIONS
    ),
    "teach --follow": frozenset(
        ("--real-part", "--contact-force", "--feed", "--spindle-rpm", "--controller", "--calibration", "--fault")
        + ("--dry-run", "--duration")
        + tuple(option for option in PATH_OPTIONS if option not in REGION_OPTIONS)
        + PAIR_OPTIONS
    ),
    "dual": frozenset(set(PATH_OPTIONS) - set(REGION_OPTIONS)) | frozenset(HAND_OPTIONS),
    "surface": frozenset(HAND_OPTIONS + PAIR_OPTIONS),
    "force": frozenset({"--feed", *PATH_OPTIONS, *HAND_OPTIONS, *PAIR_OPTIONS} - {"--region", "--feature-angle"}),
}
"""What changes nothing in an experiment."""


def refuse_idle_in(experiment: str, given: Mapping[str, Any]) -> None:
    """Refuse options an experiment takes no notice of.

    Args:
        experiment: Its name.
        given: Options by name; None = not given.

    Raises:
        InputError: Naming them.
    """
    told = [option for option in TOLD_BY_PATH if given.get(option) is not None]
    if told and given.get("--master-path") is not None:
        raise InputError(f"--master-path says where the part goes: leave {', '.join(told)} out.")
    experiment = f"{experiment} --follow" if given.get("--follow") is not None and experiment == "teach" else experiment
    idle = sorted(option for option in IDLE.get(experiment, ()) if given.get(option) is not None)
    if idle:
        raise InputError(f"{', '.join(idle)} would change nothing in 'run {experiment}': leave it out.")


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
