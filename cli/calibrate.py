"""`polish-sim calibrate ...`: one command each; here the payload of the wrist sensor and the budget of two robots."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer

from polish_sim.cli import console
from polish_sim.cli.calibrate_pair import (
    CALIBRATION,
    PANEL,
    arm,
    base,
    chosen,
    each_seed,
    noise_option,
    refuse_beside_data,
    tcp,
    write_found,
    write_seeds,
)
from polish_sim.cli.help import PanelledCommand
from polish_sim.cli.options import CONFIG_OPTIONS, OUTPUT_OPTIONS, Given, Own, build_scenario, takes
from polish_sim.cli.outcome import Outcome
from polish_sim.cli.output_folder import claimed
from polish_sim.config import Scenario
from polish_sim.config.key import SENSOR
from polish_sim.dual.experiment import CALIBRATIONS
from polish_sim.errors import InputError, count_text
from polish_sim.experiments.rows import PAYLOAD_CLAIMS, PAYLOAD_DATA_CLAIMS, PAYLOAD_SCENARIO

if TYPE_CHECKING:
    from polish_sim.dual.budget import PairBudgetTrial, Share
    from polish_sim.experiments import PayloadCalibration

UNFINISHED: Final = ".seed"
OWN_OPTIONS: Final = (
    Own("--data", SENSOR, "FILE.csv", "Poses and readings of a real robot instead of a simulated one; columns: "
        "docs/calibration.md.", Path),
    Own("--drift", SENSOR, "", "Also estimate a linear drift of the bias.", bool),
)  # fmt: skip
LEAST_DRAWS: Final = 30
SETTINGS: Final = {
    "--tracker-noise": "tracker_noise_m", "--touch-noise": "touch_noise_m", "--marks": "marks",
    "--closing": "closing_touches",
}  # fmt: skip
"""Options that set a key of section dual."""

calibrate = typer.Typer(
    name="calibrate", help="Calibrate the cell: payload, tcp, base, arm, budget.", rich_markup_mode=None
)


@calibrate.callback()
def _every_calibration() -> None:
    """Calibrate the cell: a calibration.toml that runs load; budget: the resulting error of two robots."""


@takes(
    *(*OWN_OPTIONS, "--noise", "--poses", "--seed", "--seeds", "--check", *CONFIG_OPTIONS, *OUTPUT_OPTIONS),
    defaults=PAYLOAD_SCENARIO,
)
def payload(given: Given) -> int:
    """Estimate mass and centre of the tool and the bias of the wrist sensor from readings at rest in many poses."""
    data, drift, seeds = given["--data"], bool(given["--drift"]), given["--seeds"]
    refuse_beside_data(given, "--noise", "--poses", "--seed", "--seeds", "--config", "--set")
    scenario = build_scenario(PAYLOAD_SCENARIO, given)
    with claimed(given["--out"], "calibrate-payload", given["--overwrite"]) as folder:
        if data is not None:
            outcome = from_data(data, drift, folder.draft)
        elif seeds is None:
            outcome = one_seed(scenario, drift, folder.draft)
        else:
            outcome = many_seeds(scenario, drift, range(scenario.seed, scenario.seed + seeds), folder.draft)
    return outcome.finish(folder.final, check=bool(given["--check"]))


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


calibrate.command("payload", cls=PanelledCommand, short_help="Tool mass, its centre, sensor bias.")(payload)
calibrate.command("tcp", cls=PanelledCommand, short_help="Tool tip and axes on the flange.")(tcp)
calibrate.command("base", cls=PanelledCommand, short_help="Where a second robot's base stands.")(base)
calibrate.command("arm", cls=PanelledCommand, short_help="Tables of two arms off the nominal one.")(arm)
calibrate.command("budget", cls=PanelledCommand, short_help="Where the error of two robots comes from.")(budget)


def one_seed(scenario: Scenario, drift: bool, draft: Path) -> Outcome:
    """Calibrate one simulated robot and write its folder."""
    from polish_sim.experiments import run_payload_calibration

    with console.progress() as observer:
        found = run_payload_calibration(scenario, drift, observer)
        observer.stage("draw")
        _write(draft, found)
    _show_estimate(found)
    return Outcome(PAYLOAD_CLAIMS, f"payload, seed {scenario.seed}", {"this calibration": found.figures})


def many_seeds(scenario: Scenario, drift: bool, seeds: Sequence[int], draft: Path) -> Outcome:
    """Calibrate with each seed, a folder each; what is checked is the worst seed of each figure."""
    from polish_sim.cli.seeds import aggregate
    from polish_sim.experiments import run_payload_calibration

    unfinished = draft / UNFINISHED

    def calibrated(seed: int) -> Mapping[str, Any]:
        found = run_payload_calibration(replace(scenario, seed=seed), drift)
        # Renamed when whole, so that breaking off leaves no folder with half of its files.
        unfinished.mkdir()
        _write(unfinished, found)
        unfinished.rename(draft / f"seed-{seed:04d}")
        return found.figures

    runs, interrupted = each_seed(seeds, calibrated)
    shutil.rmtree(unfinished, ignore_errors=True)
    mean, worst = aggregate(PAYLOAD_CLAIMS, list(runs.values()))
    write_seeds(draft, "calibrate-payload", runs, {"mean": mean, "worst": worst})
    columns = {"mean": mean, "worst seed": worst}
    return Outcome(PAYLOAD_CLAIMS, f"payload, {count_text(len(runs), 'seed')}", columns, interrupted=interrupted)


def from_data(file: Path, drift: bool, draft: Path) -> Outcome:
    """Calibrate from a file of a real robot's poses and readings and write its folder."""
    from polish_sim.calibration import read_readings
    from polish_sim.experiments import calibrate_from

    found = calibrate_from(read_readings(file), drift)
    _write(draft, found)
    _show_estimate(found)
    return Outcome(PAYLOAD_DATA_CLAIMS, f"payload from {file.name}", {"this calibration": found.figures})


def _write(folder: Path, found: PayloadCalibration) -> None:
    from polish_sim.analysis.payload_plot import plot_drift, plot_residuals
    from polish_sim.analysis.run_record import CONFIG
    from polish_sim.calibration import residual_table, write_calibration
    from polish_sim.scenario_file import to_toml

    estimate, readings = found.estimate, found.readings
    write_calibration(folder / CALIBRATION, estimate)
    if found.scenario is not None:
        (folder / CONFIG).write_text(to_toml(found.scenario), encoding="utf-8")
    left = readings.time, estimate.residuals, estimate.noise, estimate.used
    plots = {"residuals.png": plot_residuals(*left, found.scenario is not None, _facts(found))}
    if found.long_run is not None:
        plots["drift.png"] = plot_drift(*found.long_run)
    write_found(folder, found.figures, residual_table(readings, estimate, found.q), plots)


def _facts(found: PayloadCalibration) -> list[str]:
    estimate = found.estimate
    x, y, z = 1e3 * estimate.center
    std = 1e3 * float(estimate.center_std.max())
    return [
        f"mass {estimate.mass:.4f} ± {estimate.mass_std:.4f} kg",
        f"centre ({x:.2f}, {y:.2f}, {z:.2f}) ± {std:.2f} mm",
        f"noise {estimate.noise[0]:.2g} N, {1e3 * estimate.noise[3]:.2g} mN m",
    ]


def _show_estimate(found: PayloadCalibration) -> None:
    """Print what was found, each number with its standard deviation, and which readings were left out."""
    estimate = found.estimate
    for number in (k for k, used in enumerate(estimate.used, 1) if not used):
        console.note(f"note: reading {number} does not fit the others and was left out. Did something touch the tool?")
    rows = [["mass", "kg", f"{estimate.mass:.5f}", f"{estimate.mass_std:.2g}"]]
    groups: list[tuple[str, str, float, Any, Any]] = [
        ("centre", "mm", 1e3, estimate.center, estimate.center_std),
        ("force bias", "N", 1.0, estimate.bias[:3], estimate.bias_std[:3]),
        ("torque bias", "mN m", 1e3, estimate.bias[3:], estimate.bias_std[3:]),
    ]
    if len(estimate.theta) > 10:
        groups.append(("force drift", "mN/s", 1e3, estimate.drift[:3], estimate.drift_std[:3]))
        groups.append(("torque drift", "mN m/s", 1e3, estimate.drift[3:], estimate.drift_std[3:]))
    if "drift_return_n" in found.figures:
        std = [found.figures["drift_return_n_std"]] * 3
        groups.append(("force back in the first pose", "N", 1.0, found.figures["drift_return_n"], std))
    for name, unit, scale, values, deviations in groups:
        for axis, value, deviation in zip("xyz", values, deviations, strict=True):
            rows.append([f"{name} {axis}", unit, f"{scale * value:.4f}", f"{scale * deviation:.2g}"])
    console.table("tool and sensor, sensor axes", ["estimate", "unit", "value", "std"], rows)


def budget_once(trial: PairBudgetTrial, draft: Path) -> Outcome:
    """Predict, draw, compare and write; an interrupt keeps what was drawn if it is `LEAST_DRAWS` or more."""
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
    _write_budget(draft, trial, shares, figures)
    figure = plot_budget(trial, shares, errors[TOGETHER], covariances[TOGETHER], asked)
    save_plots(draft, {"budget.png": figure})
    _show_shares(shares)
    columns = {"analysis": predicted, "drawn": figures}
    return Outcome(
        CALIBRATIONS["budget"], f"tool on the part, {len(drawn)} calibrations", columns, interrupted=interrupted
    )


def _write_budget(draft: Path, trial: PairBudgetTrial, shares: Mapping[str, Share], figures: Mapping[str, Any]) -> None:
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
