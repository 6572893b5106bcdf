"""`polish-sim calibrate ...`: what a robot must know about itself before it polishes; one command each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.cli import option_types as o
from polish_sim.cli.calibrate_arm import arm
from polish_sim.cli.calibrate_budget import budget
from polish_sim.cli.calibrate_frames import base, tcp
from polish_sim.cli.output_folder import claimed
from polish_sim.cli.panels import PanelledCommand
from polish_sim.cli.scenario_options import build_scenario, given_options
from polish_sim.errors import InputError

MODEL = "Sensor and poses"
Data = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="FILE.csv",
        help="Poses and readings of a real robot instead of a simulated one; columns: docs/calibration.md.",
        rich_help_panel=MODEL,
    ),
]
Noise = Annotated[
    float | None,
    typer.Option("--noise", metavar="N", help="Force noise per sample, rms (N); default 0.5.", rich_help_panel=MODEL),
]
Poses = Annotated[
    int | None,
    typer.Option("--poses", metavar="N", help="Poses to visit, 4 or more; default 12.", rich_help_panel=MODEL),
]
Drift = Annotated[
    bool, typer.Option("--drift", help="Also estimate a linear drift of the bias.", rich_help_panel=MODEL)
]

calibrate = typer.Typer(
    name="calibrate", help="Calibrate the cell: payload, tcp, base, arm, budget.", rich_markup_mode=None
)


@calibrate.callback()
def _every_calibration() -> None:
    """Calibrate the cell: a calibration.toml that runs load; budget: what the errors of two robots come to."""


@calibrate.command("payload", cls=PanelledCommand, short_help="Tool mass, its centre, sensor bias.")
def payload(
    data: Data = None,
    noise: Noise = None,
    poses: Poses = None,
    drift: Drift = False,
    seed: o.Seed = None,
    seeds: o.Seeds = None,
    check: o.Check = False,
    config: o.Config = None,
    set_: o.Set = None,
    out: o.Out = None,
    overwrite: o.Overwrite = False,
) -> int:
    """Estimate mass and centre of the tool and the bias of the wrist sensor from readings at rest in many poses."""
    given = given_options(locals())
    if data is not None:
        idle = [name for name, value in given.items() if value is not None]
        idle += [name for name, value in (("--seeds", seeds), ("--config", config), ("--set", set_)) if value]
        if idle:
            raise InputError(f"{', '.join(idle)} would change nothing with --data: leave it out.")
    # Lazy: the simulator takes a second to load, --help must not wait for it.
    from polish_sim.cli.calibration import from_data, many_seeds, one_seed
    from polish_sim.experiments.rows import PAYLOAD_SCENARIO

    scenario = build_scenario(PAYLOAD_SCENARIO, given, config, set_ or [])
    with claimed(out, "calibrate-payload", overwrite) as folder:
        if data is not None:
            outcome = from_data(data, drift, folder.draft)
        elif seeds is None:
            outcome = one_seed(scenario, drift, folder.draft)
        else:
            outcome = many_seeds(scenario, drift, range(scenario.seed, scenario.seed + seeds), folder.draft)
    outcome.show()
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(check)


calibrate.command("tcp", cls=PanelledCommand, short_help="Tool tip and axes on the flange.")(tcp)
calibrate.command("base", cls=PanelledCommand, short_help="Where a second robot's base stands.")(base)
calibrate.command("arm", cls=PanelledCommand, short_help="Tables of two arms off the nominal one.")(arm)
calibrate.command("budget", cls=PanelledCommand, short_help="Where the error of two robots comes from.")(budget)
