"""Draws an error budget for its command and writes its folder; imported only inside the command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.run_record import METRICS, package_versions, write_json
from polish_sim.cli import console
from polish_sim.cli.outcome import Outcome
from polish_sim.dual.budget import (
    TOGETHER,
    PairBudgetTrial,
    Share,
    budget_figures,
    compare_shares,
    draw_errors,
    predict,
)
from polish_sim.dual.calibration.error_length import length_probability
from polish_sim.dual.experiment import CALIBRATIONS
from polish_sim.dual.plots import Bar, Total, plot_budget
from polish_sim.experiments.report import save_plots

Array = NDArray[np.float64]

BUDGET = "calibrate-budget"
CURVE = 300
"""Steps of the predicted density."""
_INSTRUMENTS = {"bases": "tracker", "tool": "touches", "part": "touches", "closing": "touches", TOGETHER: "all"}


def chosen_trial(
    draws: int | None, noise: Mapping[str, float | None], counts: Mapping[str, int | None], seed: int | None
) -> PairBudgetTrial:
    """The trial with what was given on the command line: noise [mm] and counts by the names of section [dual]."""
    trial = PairBudgetTrial()
    chosen: dict[str, Any] = {name: 1e-3 * value for name, value in noise.items() if value is not None}
    chosen |= {name: value for name, value in counts.items() if value is not None}
    own = {name: value for name, value in (("draws", draws), ("seed", seed)) if value is not None}
    return replace(trial, dual=replace(trial.dual, **chosen), **own)


def budget_once(trial: PairBudgetTrial, least: int, draft: Path) -> Outcome:
    """Predict, draw, compare and write; broken off, what was drawn is kept if it is ``least`` draws or more."""
    with console.progress() as observer:
        observer.stage("predict by covariances")
        prediction = predict(trial)
        observer.stage(f"draw {trial.draws} calibrations")
        drawn: list[dict[str, Array]] = []
        interrupted = False
        try:
            for errors in draw_errors(trial):
                drawn.append(errors)
                observer.progress(len(drawn), trial.draws)
        except KeyboardInterrupt:
            if len(drawn) < least:
                raise
            interrupted = True
    covariances = prediction.covariances
    errors = {name: np.stack([one[name] for one in drawn]) for name in covariances}
    shares = compare_shares(trial, covariances, errors)
    total = _total(errors[TOGETHER], covariances[TOGETHER])
    predicted, figures = budget_figures(trial, prediction, shares, errors[TOGETHER], total.rms_asked)
    _write(draft, trial, shares, figures, total)
    _show_shares(shares)
    columns = {"analysis": predicted, "drawn": figures}
    return Outcome(
        CALIBRATIONS["budget"], f"tool on the part, {len(drawn)} calibrations", columns, interrupted=interrupted
    )


def _write(
    draft: Path, trial: PairBudgetTrial, shares: Mapping[str, Share], figures: Mapping[str, Any], total: Total
) -> None:
    sources = {name: share._asdict() for name, share in shares.items()}
    settings = {
        name: getattr(trial.dual, name) for name in ("tracker_noise_m", "touch_noise_m", "marks", "closing_touches")
    }
    settings |= {name: value for name, value in asdict(trial).items() if name != "dual"}
    record = {"experiment": BUDGET, "settings": settings, **figures, "sources": sources}
    write_json(draft / METRICS, record | {"versions": package_versions()})
    bars = {
        f"{name}\n({_INSTRUMENTS[name]})": Bar(
            s.predicted_rms_m, s.predicted_across_rms_m, s.drawn_rms_m, s.drawn_across_rms_m, s.drawn_rms_std_m
        )
        for name, s in shares.items()
    }
    facts = [
        f"tracker {1e3 * trial.dual.tracker_noise_m:g} mm, touches {1e3 * trial.dual.touch_noise_m:g} mm",
        f"{trial.dual.marks} marks, {trial.dual.closing_touches} closing touches, {figures['draws']} calibrations",
    ]
    save_plots(draft, {"budget.png": plot_budget(bars, total, "Error budget of the tool on the part", facts)})


def _show_shares(shares: Mapping[str, Share]) -> None:
    """Print source by source what analysis says and what was drawn."""
    headings = ["source", "by", "rms, analysis", "rms, drawn", "±", "95%, analysis", "95%, drawn", "along tool axis"]
    rows = [
        [
            name,
            _INSTRUMENTS[name],
            *(f"{1e3 * value:.4f}" for value in share[:5]),
            f"{100.0 * share.drawn_axial_share:.0f}%",
        ]
        for name, share in shares.items()
    ]
    console.table("error of the tool on the part by source [mm], 3D", headings, rows, left=2)


def _total(errors: Array, covariances: Array) -> Total:
    """The whole error beside what is asked of it; the curve ends where the draws do."""
    asked = {claim.figure: claim.high for claim in CALIBRATIONS["budget"]}
    rms, p95 = asked["relative_error_rms_m"], asked["relative_error_p95_m"]
    lengths = np.linalg.norm(errors, axis=2).ravel()
    edges = np.linspace(0.0, max(float(lengths.max()), p95), CURVE + 1)
    return Total(lengths, edges, length_probability(covariances, edges), rms, p95)
