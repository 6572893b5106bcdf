"""`polish-sim calibrate budget`: from the noise of the instruments to the tool on the part of two robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from polish_sim.cli import console
from polish_sim.cli.calibrate_pair import PANEL, chosen, noise_option
from polish_sim.cli.options import OUTPUT_OPTIONS, Given, Own, takes
from polish_sim.cli.outcome import Outcome
from polish_sim.cli.output_folder import claimed
from polish_sim.dual.experiment import CALIBRATIONS
from polish_sim.errors import InputError

if TYPE_CHECKING:
    from polish_sim.dual.budget import PairBudgetTrial, Share

LEAST_DRAWS: Final = 30
SETTINGS: Final = {
    "--tracker-noise": "tracker_noise_m", "--touch-noise": "touch_noise_m", "--marks": "marks",
    "--closing": "closing_touches",
}  # fmt: skip
"""Options that set a key of section dual."""


@takes(
    Own("--draws", PANEL, "N", "Calibrations to draw, 30 or more; default 300.", int, LEAST_DRAWS, 100_000),
    noise_option("--tracker-noise", "the tracker", "0.03"),
    noise_option("--touch-noise", "a touch", "0.05"),
    Own("--marks", PANEL, "N", "Marks on the part, touched to find it, 3 to 100; default 3.", int, 3, 100),
    Own("--closing", PANEL, "N", "Touches of the marks with the tool, to which all is adjusted; default 12, 0 = none.",
        int, 0, 1000),
    *("--seed", "--check", *OUTPUT_OPTIONS),
)  # fmt: skip
def budget(given: Given) -> int:
    """Calibrate bases, tool and part again and again: where the error of the tool on the part comes from."""
    if given["--tracker-noise"] == 0.0 and given["--touch-noise"] == 0.0:
        raise InputError("--tracker-noise 0 with --touch-noise 0 leaves no error to share out: give one of them.")
    # Lazy: --help must not wait for the libraries.
    from polish_sim.dual.budget import PairBudgetTrial

    trial = PairBudgetTrial(**chosen(given, "draws", "seed"))
    settings = {key: given[name] for name, key in SETTINGS.items() if given[name] is not None}
    trial = replace(trial, dual=replace(trial.dual, **settings))
    with claimed(given["--out"], "calibrate-budget", given["--overwrite"]) as folder:
        outcome = budget_once(trial, folder.draft)
    return outcome.finish(folder.final, check=bool(given["--check"]))


def budget_once(trial: PairBudgetTrial, draft: Path) -> Outcome:
    """Predict, draw, compare and write; broken off, what was drawn is kept if it is `LEAST_DRAWS` or more."""
    import numpy as np

    from polish_sim.dual.budget import TOGETHER, budget_figures, compare_shares, draw_errors, predict
    from polish_sim.dual.plots import plot_budget
    from polish_sim.experiments.report import save_plots

    with console.progress() as observer:
        observer.stage("predict by covariances")
        prediction = predict(trial)
        observer.stage(f"draw {trial.draws} calibrations")
        drawn: list[dict[str, Any]] = []
        interrupted = False
        try:
            for errors in draw_errors(trial):
                drawn.append(errors)
                observer.progress(len(drawn), trial.draws)
        except KeyboardInterrupt:
            if len(drawn) < LEAST_DRAWS:
                raise
            interrupted = True
    covariances = prediction.covariances
    errors = {name: np.stack([one[name] for one in drawn]) for name in covariances}
    shares = compare_shares(trial, covariances, errors)
    limits = {claim.figure: claim.high for claim in CALIBRATIONS["budget"]}
    asked = limits["relative_error_rms_m"], limits["relative_error_p95_m"]
    predicted, figures = budget_figures(trial, prediction, shares, errors[TOGETHER], asked[0])
    _write(draft, trial, shares, figures)
    figure = plot_budget(trial, shares, errors[TOGETHER], covariances[TOGETHER], asked)
    save_plots(draft, {"budget.png": figure})
    _show_shares(shares)
    columns = {"analysis": predicted, "drawn": figures}
    return Outcome(
        CALIBRATIONS["budget"], f"tool on the part, {len(drawn)} calibrations", columns, interrupted=interrupted
    )


def _write(draft: Path, trial: PairBudgetTrial, shares: Mapping[str, Share], figures: Mapping[str, Any]) -> None:
    from polish_sim.analysis.run_record import METRICS, package_versions, write_json

    sources = {name: share._asdict() for name, share in shares.items()}
    settings = {name: getattr(trial.dual, name) for name in SETTINGS.values()}
    settings |= {name: value for name, value in asdict(trial).items() if name != "dual"}
    record = {"experiment": "calibrate-budget", "settings": settings, **figures, "sources": sources}
    write_json(draft / METRICS, record | {"versions": package_versions()})


def _show_shares(shares: Mapping[str, Share]) -> None:
    """Print the errors by source, predicted and drawn."""
    from polish_sim.dual.calibration.pair import INSTRUMENTS

    headings = ["source", "by", "rms, analysis", "rms, drawn", "±", "95%, analysis", "95%, drawn", "along tool axis"]
    rows = [
        [
            name,
            INSTRUMENTS.get(name, "all"),
            *(f"{1e3 * value:.4f}" for value in share[:5]),
            f"{100.0 * share.drawn_axial_share:.0f}%",
        ]
        for name, share in shares.items()
    ]
    console.table("error of the tool on the part by source [mm], 3D", headings, rows, left=2)
