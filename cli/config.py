"""`polish-sim config`: the full default TOML of an experiment, with units in its comments."""

from __future__ import annotations

from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.scenario_file import to_toml


def config(
    experiment: Annotated[str, typer.Argument(help="arc, force, surface or calibrate-payload.", show_default=False)],
) -> None:
    """Print the full default config of an experiment as TOML; `plan` and `inspect` take the keys of surface."""
    # Lazy: --help must not wait for the numerical libraries.
    from polish_sim.experiments import PAYLOAD_SCENARIO, default_scenario

    calibrates = experiment == PAYLOAD_SCENARIO.experiment
    console.say(to_toml(PAYLOAD_SCENARIO if calibrates else default_scenario(experiment)).rstrip())
