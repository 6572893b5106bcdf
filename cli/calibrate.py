"""`polish-sim calibrate ...`: one command each; here the payload of the wrist sensor and the budget of two
robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from polish_sim.cli import console
from polish_sim.cli.boundary import Outcome
from polish_sim.cli.calibrate_pair import (
    CALIBRATION,
    DATA,
    PANEL,
    TRIAL_OPTIONS,
    arm,
    base,
    noise_option,
    tcp,
    write_found,
)
from polish_sim.cli.catalogue import PanelledCommand
from polish_sim.cli.many import Many, Means, carry_out, seed_rows
from polish_sim.cli.options import (
    CONFIG_OPTIONS,
    OUTPUT_OPTIONS,
    Given,
    Own,
    build_scenario,
    chosen,
    takes,
)
from polish_sim.config.key import SENSOR
from polish_sim.dual import CALIBRATIONS
from polish_sim.errors import InputError
from polish_sim.experiments.rows import PAYLOAD_CLAIMS, PAYLOAD_DATA_CLAIMS, PAYLOAD_SCENARIO
from polish_sim.page import Table
from polish_sim.row_file import Metrics, put_file, save_plots, write_metrics
from polish_sim.scenario_file import to_toml

if TYPE_CHECKING:
    from polish_sim.dual.budget import PairBudgetTrial, Share
    from polish_sim.experiments import PayloadCalibration

LEAST_DRAWS = 30
SETTINGS = {
    "--tracker-noise": "tracker_noise_m", "--touch-noise": "touch_noise_m", "--marks": "marks",
    "--closing": "closing_touches",
}  # fmt: skip
"""Options that set a key of section dual."""

calibrate = typer.Typer(add_completion=False, rich_markup_mode=None)


@calibrate.callback()
def _every_calibration() -> None:
    """Calibrate the cell: a calibration.toml that runs load; budget: the resulting error of two robots."""


@takes(
    DATA,
    Own("--drift", SENSOR, "", "Also estimate a linear drift of the bias."),
    *("--noise", "--poses", *CONFIG_OPTIONS, *TRIAL_OPTIONS),
    defaults=PAYLOAD_SCENARIO,
)
def payload(given: Given) -> int:
    """Estimate mass and centre of the tool and the bias of the wrist sensor from readings at rest in many
    poses."""
    from polish_sim.experiments import calibrate_from, run_payload_calibration

    drift, scenario = bool(given["--drift"]), build_scenario(PAYLOAD_SCENARIO, given)

    means = Means(
        "calibrate-payload", "payload",
        lambda seed, observer: run_payload_calibration(replace(scenario, seed=seed), drift, observer),
        _show_estimate, _write, PAYLOAD_CLAIMS, PAYLOAD_DATA_CLAIMS,
        lambda file: calibrate_from(file, drift), "mean", folders=True,
    )  # fmt: skip
    return carry_out(
        given if given["--data"] else {**given, "--seed": scenario.seed}, means, (scenario, drift)
    )


@takes(
    Own("--draws", PANEL, "N", "Calibrations to draw, 30 or more; default 300.", int, LEAST_DRAWS, 100_000),
    noise_option("--tracker-noise", "the tracker", "0.03"),
    noise_option("--touch-noise", "a touch", "0.05"),
    Own("--marks", PANEL, "N", "Marks on the part, touched to find it, 3 to 100; default 3.", int, 3, 100),
    Own("--closing", PANEL, "N", "Touches of the marks with the tool, to which all is adjusted; default 12, "
                                 "0 = none.",
        int, 0, 1000),
    *("--seed", "--workers", "--on", "--check", *OUTPUT_OPTIONS),
)  # fmt: skip
def budget(given: Given) -> int:
    """Calibrate bases, tool and part again and again: where the error of the tool on the part comes from."""
    if given["--tracker-noise"] == 0.0 and given["--touch-noise"] == 0.0:
        raise InputError(
            "--tracker-noise 0 with --touch-noise 0 leaves no error to share out: give one of them."
        )
    from polish_sim.dual.budget import PairBudgetTrial, draw_errors

    trial = PairBudgetTrial(**chosen(given, "draws", "seed"))
    settings = {key: given[name] for name, key in SETTINGS.items() if given[name] is not None}
    trial = replace(trial, dual=replace(trial.dual, **settings))
    depends, work = str(replace(trial, draws=0)), partial(draw_errors, trial)
    many = Many("calibrate-budget", "the calibration", depends, lambda _folder: work, CALIBRATIONS["budget"])
    with seed_rows(many, given, range(trial.draws), "draw") as (folder, drawn):
        if len(drawn) < LEAST_DRAWS:
            raise KeyboardInterrupt
        return budget_of(trial, list(drawn.values()), folder).finish(folder, given["--check"])


for _command, _text in (
    (payload, "Tool mass, its centre, sensor bias."),
    (tcp, "Tool tip and axes on the flange."),
    (base, "Where a second robot's base stands."),
    (arm, "Tables of two arms off the nominal one."),
    (budget, "Where the error of two robots comes from."),
):
    calibrate.command(_command.__name__, cls=PanelledCommand, short_help=_text)(_command)


def _write(found: PayloadCalibration, folder: Path) -> None:
    from polish_sim.analysis.payload_plot import plot_residuals
    from polish_sim.analysis.run_record import CONFIG
    from polish_sim.calibration import residual_table, write_calibration

    estimate, readings = found.estimate, found.readings
    write_calibration(folder / CALIBRATION, estimate)
    if found.scenario:
        put_file(folder, CONFIG, to_toml(found.scenario))
    left = estimate.residuals, estimate.noise, estimate.used
    write_found(
        folder,
        found.figures,
        residual_table(readings, estimate, found.q),
        {"residuals.png": plot_residuals(*left, _facts(found))},
    )


def _facts(found: PayloadCalibration) -> list[str]:
    estimate = found.estimate
    x, y, z = 1e3 * estimate.center
    std = 1e3 * estimate.center_std.max()
    return [
        f"mass {estimate.mass:.4f} ± {estimate.mass_std:.4f} kg",
        f"centre ({x:.2f}, {y:.2f}, {z:.2f}) ± {std:.2f} mm",
        f"noise {estimate.noise[0]:.2g} N, {1e3 * estimate.noise[3]:.2g} mN m",
    ]


def _show_estimate(found: PayloadCalibration) -> tuple[str, ...]:
    """Print what was found, each number with its standard deviation; notes name the readings that were left
    out."""
    estimate = found.estimate
    rows = [["mass", "kg", f"{estimate.mass:.5f}", f"{estimate.mass_std:.2g}"]]
    figures = {**found.figures, "drift_return_n_std": [found.figures.get("drift_return_n_std")] * 3}
    for name, unit, scale, key in (
        ("centre", "mm", 1e3, "center_m"),
        ("force bias", "N", 1.0, "bias_n"),
        ("torque bias", "mN m", 1e3, "bias_nm"),
        ("force drift", "mN/s", 1e3, "drift_n_s"),
        ("torque drift", "mN m/s", 1e3, "drift_nm_s"),
        ("force back in the first pose", "N", 1.0, "drift_return_n"),
    ):
        known = ("xyz", figures[key], figures[f"{key}_std"]) if key in figures else ()
        for axis, value, deviation in zip(*known, strict=True):
            rows.append([f"{name} {axis}", unit, f"{scale * value:.4f}", f"{scale * deviation:.2g}"])
    console.table(Table("tool and sensor, sensor axes", ["estimate", "unit", "value", "std"], rows))
    return tuple(
        f"reading {number} does not fit the others and was left out. Did something touch the tool?"
        for number in figures["outliers"]
    )


def budget_of(trial: PairBudgetTrial, drawn: Sequence[Metrics], folder: Path) -> Outcome:
    """Predict, compare with what was drawn, `LEAST_DRAWS` or more, and write."""
    import numpy as np

    from polish_sim.dual.budget import TOGETHER, budget_figures, compare_shares, predict
    from polish_sim.dual.plots import plot_budget

    with console.progress() as observer:
        observer.stage("predict by covariances")
        covariances = predict(trial).covariances
    errors = {name: np.array([one[name] for one in drawn]) for name in covariances}
    shares = compare_shares(trial, covariances, errors)
    limits = {claim.figure: claim.high for claim in CALIBRATIONS["budget"]}
    asked = limits["relative_error_rms_m"], limits["relative_error_p95_m"]
    predicted, figures = budget_figures(shares, errors[TOGETHER], asked[0])
    sources = {name: share._asdict() for name, share in shares.items()}
    settings = {name: getattr(trial.dual, name) for name in SETTINGS.values()}
    settings |= {name: value for name, value in asdict(trial).items() if name != "dual"}
    record = {"experiment": "calibrate-budget", "settings": settings, **figures, "sources": sources}
    write_metrics(folder, record)
    save_plots(folder, {"budget.png": plot_budget(trial, shares, errors[TOGETHER], asked)})
    _show_shares(shares)
    return Outcome(
        CALIBRATIONS["budget"],
        f"tool on the part, {len(drawn)} calibrations",
        {"analysis": predicted, "drawn": figures},
    )


def _show_shares(shares: Mapping[str, Share]) -> None:
    """Print the errors by source, predicted and drawn."""
    from polish_sim.dual.calibration.pair import INSTRUMENTS

    headings = [
        "source",
        "by",
        "rms, analysis",
        "rms, drawn",
        "±",
        "95%, drawn",
        "along tool axis",
    ]
    lengths = ("predicted_rms_m", "drawn_rms_m", "drawn_rms_std_m", "drawn_p95_m")
    rows = [
        [
            name,
            INSTRUMENTS.get(name, "all"),
            *(f"{1e3 * getattr(share, length):.4f}" for length in lengths),
            f"{100.0 * share.drawn_axial_share:.0f}%",
        ]
        for name, share in shares.items()
    ]
    console.table(Table("error of the tool on the part by source [mm], 3D", headings, rows, left=2))
