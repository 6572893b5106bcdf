"""`polish-sim config`: the full default TOML of an experiment, with units in its comments."""

from __future__ import annotations

from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.errors import unknown_name
from polish_sim.scenario_file import to_toml

LIMITS = "limits"
"""Not an experiment, but a file of defaults as well."""


def config(
    experiment: Annotated[
        str,
        typer.Argument(
            metavar="EXPERIMENT",
            help="arc, force, surface, smooth, teach, dual, calibrate-payload, or limits.",
            show_default=False,
        ),
    ],
) -> None:
    """Print the full default config of an experiment as TOML; `plan` and `inspect` take the keys of surface.

    `limits` prints the default limits of tool and joints, for the command `smooth`.
    """
    # Lazy: --help must not wait for the numerical libraries.
    from polish_sim.experiments.registry import ROWS, default_scenario
    from polish_sim.experiments.rows import PAYLOAD_SCENARIO
    from polish_sim.motion.rules.limits import SmoothingLimits, limits_toml

    if experiment == LIMITS:
        console.say(limits_toml(SmoothingLimits()).rstrip())
        return
    calibrates = experiment == PAYLOAD_SCENARIO.experiment
    if not calibrates and experiment not in ROWS:
        raise unknown_name("experiment", experiment, (*ROWS, PAYLOAD_SCENARIO.experiment, LIMITS))
    console.say(to_toml(PAYLOAD_SCENARIO if calibrates else default_scenario(experiment)).rstrip())
