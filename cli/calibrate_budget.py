"""`polish-sim calibrate budget`: from the noise of the instruments to the tool on the part of two robots."""

from __future__ import annotations

from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.cli import option_types as o
from polish_sim.cli.calibrate_frames import LARGEST_NOISE_MM, PANEL, within
from polish_sim.cli.output_folder import claimed
from polish_sim.errors import InputError

LEAST_DRAWS, MOST_DRAWS = 30, 100_000
LEAST_MARKS, MOST_MARKS = 3, 100
MOST_CLOSING = 1000

Draws = Annotated[
    int | None,
    typer.Option("--draws", metavar="N", help="Calibrations to draw, 30 or more; default 300.", rich_help_panel=PANEL),
]
TrackerNoise = Annotated[
    float | None,
    typer.Option(
        "--tracker-noise",
        metavar="MM",
        help="Noise of the tracker per coordinate, rms (mm); default 0.03.",
        rich_help_panel=PANEL,
    ),
]
TouchNoise = Annotated[
    float | None,
    typer.Option(
        "--touch-noise",
        metavar="MM",
        help="Noise of a touch per coordinate, rms (mm); default 0.05.",
        rich_help_panel=PANEL,
    ),
]
Marks = Annotated[
    int | None,
    typer.Option(
        "--marks",
        metavar="N",
        help="Marks on the part, touched to find it, 3 to 100; default 3.",
        rich_help_panel=PANEL,
    ),
]
Closing = Annotated[
    int | None,
    typer.Option(
        "--closing",
        metavar="N",
        help="Touches of the marks with the tool, to which all is adjusted; default 12, 0 = none.",
        rich_help_panel=PANEL,
    ),
]


def budget(
    draws: Draws = None,
    tracker_noise: TrackerNoise = None,
    touch_noise: TouchNoise = None,
    marks: Marks = None,
    closing: Closing = None,
    seed: o.Seed = None,
    check: o.Check = False,
    out: o.Out = None,
    overwrite: o.Overwrite = False,
) -> int:
    """Calibrate bases, tool and part again and again: where the error of the tool on the part comes from."""
    within("--draws", draws, LEAST_DRAWS, MOST_DRAWS, "")
    within("--tracker-noise", tracker_noise, 0.0, LARGEST_NOISE_MM, "mm")
    within("--touch-noise", touch_noise, 0.0, LARGEST_NOISE_MM, "mm")
    within("--marks", marks, LEAST_MARKS, MOST_MARKS, "")
    within("--closing", closing, 0, MOST_CLOSING, "")
    within("--seed", seed, 0, 2**63 - 1, "")
    if tracker_noise == 0.0 and touch_noise == 0.0:
        raise InputError("--tracker-noise 0 with --touch-noise 0 leaves no error to share out: give one of them.")
    # Lazy: --help must not wait for the libraries.
    from polish_sim.cli.budget import budget_once, chosen_trial

    trial = chosen_trial(
        draws,
        {"tracker_noise_m": tracker_noise, "touch_noise_m": touch_noise},
        {"marks": marks, "closing_touches": closing},
        seed,
    )
    with claimed(out, "calibrate-budget", overwrite) as folder:
        outcome = budget_once(trial, LEAST_DRAWS, folder.draft)
    outcome.show()
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(check)
