"""`polish-sim identify`: a robot's dynamics from its own motion, simulated or from a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.cli import option_types as o
from polish_sim.cli.output_folder import claimed
from polish_sim.cli.rendering import prepare_headless
from polish_sim.errors import InputError

IDENTIFICATION = "Identification"
Method = Annotated[
    str | None,
    typer.Option(
        "--method", metavar="NAME", help="joint (default) or stepwise.", rich_help_panel=IDENTIFICATION
    ),
]  # fmt: skip
Objective = Annotated[
    str | None,
    typer.Option(
        "--objective",
        metavar="NAME",
        help="What the exciting motion makes small: i-optimal (default), d-optimal or condition.",
        rich_help_panel=IDENTIFICATION,
    ),
]
Periods = Annotated[
    int | None,
    typer.Option("--periods", metavar="N", help="Periods of 10 s to log; default 5.", rich_help_panel=IDENTIFICATION),
]
Starts = Annotated[
    int | None,
    typer.Option(
        "--starts",
        metavar="N",
        help="Random motions the search begins from; default 1.",
        min=1,
        rich_help_panel=IDENTIFICATION,
    ),
]
Data = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="FILE.csv",
        help="A UR5e's own log instead of a simulated one; columns: docs/identification.md.",
        rich_help_panel=IDENTIFICATION,
    ),
]
Period = Annotated[
    float | None,
    typer.Option(
        "--period",
        metavar="S",
        help="The motion of --data repeats after this time (s).",
        rich_help_panel=IDENTIFICATION,
    ),
]
Report = Annotated[
    bool,
    typer.Option(
        "--report", help="Only say which numbers torques can tell at all.", rich_help_panel=IDENTIFICATION
    ),
]  # fmt: skip


def identify(
    method: Method = None,
    objective: Objective = None,
    periods: Periods = None,
    starts: Starts = None,
    data: Data = None,
    period: Period = None,
    report: Report = False,
    seed: o.Seed = None,
    check: o.Check = False,
    out: o.Out = None,
    overwrite: o.Overwrite = False,
) -> int:
    """Identify inertia and friction of the arm from its own motion, with intervals, and write them as a model."""
    given = {"method": method, "objective": objective, "periods": periods, "starts": starts, "seed": seed}
    given = {name: value for name, value in given.items() if value is not None}
    if data is not None and given:
        names = ", ".join(f"--{name}" for name in given)
        raise InputError(f"{names} would change nothing with --data: leave it out.")
    if data is None and period is not None:
        raise InputError("--period belongs to --data: a simulated motion repeats after 10 s.")
    if period is not None and period <= 0.0:
        raise InputError(f"--period {period:g}: the time after which a motion repeats is more than 0 s.")
    prepare_headless()
    # Lazy: the simulator takes a second to load, --help must not wait for it.
    from polish_sim.cli.identification import from_log, identifiable_numbers, simulated
    from polish_sim.identification.settings import IdentifySettings

    settings = IdentifySettings(**given)  # type: ignore[arg-type]
    if report:
        identifiable_numbers(settings)
        return 0
    with claimed(out, "identify", overwrite) as folder:
        outcome = simulated(settings, folder.draft) if data is None else from_log(data, period, settings, folder.draft)
    outcome.show()
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(check)
