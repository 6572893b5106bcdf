"""Runs calibrations of two arms' tables for their command and writes their folders; imported only inside commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from polish_sim.analysis.run_record import METRICS, package_versions, write_json
from polish_sim.cli.frame_calibration import together
from polish_sim.cli.outcome import Outcome
from polish_sim.dual.calibrate_bases import ArmsFound, ArmTrial, calibrate_arm_from, run_arm_calibration
from polish_sim.dual.calibration.arm import fit_placement
from polish_sim.dual.calibration.arm_file import read_tracked, tracked_table, write_arm_calibration
from polish_sim.dual.experiment import CALIBRATIONS
from polish_sim.dual.plots import BaseScene, Residuals, plot_bases
from polish_sim.experiments.report import save_plots
from polish_sim.motion.kinematics import NOMINAL

ARM, ARM_DATA = CALIBRATIONS["arm"], CALIBRATIONS["arm-data"]


def arm_once(trial: ArmTrial, pair: str, draft: Path) -> Outcome:
    """Calibrate two simulated arms and write their folder."""
    done = run_arm_calibration(trial)
    _write(draft, done, pair)
    return Outcome(ARM, f"arms, seed {trial.seed}", {"this calibration": done.figures}, notes=_notes(done))


def arm_many(trial: ArmTrial, seeds: Sequence[int], draft: Path) -> Outcome:
    """Calibrate with each seed; what is checked is the worst of each figure."""

    def figures(seed: int) -> Mapping[str, Any]:
        return run_arm_calibration(replace(trial, seed=seed)).figures

    return together("calibrate-arm", ARM, "arms", seeds, figures, draft)


def arm_from_data(file: Path, pair: str, draft: Path) -> Outcome:
    """Calibrate from a file of tracked poses of real arms and write its folder."""
    done = calibrate_arm_from(read_tracked(file))
    _write(draft, done, pair)
    return Outcome(ARM_DATA, f"arms from {file.name}", {"this calibration": done.figures}, notes=_notes(done))


def _write(folder: Path, done: ArmsFound, pair: str) -> None:
    write_arm_calibration(folder / "calibration.toml", done.found, pair, done.true)
    (folder / "residuals.csv").write_text(tracked_table(done.tracked, done.found), encoding="utf-8")
    write_json(folder / METRICS, {**done.figures, "pair": pair, "versions": package_versions()})
    residuals = [
        Residuals(f"{robot}, {what}", np.linalg.norm(arm.residuals, axis=1), np.ones(len(arm.residuals), dtype=bool))
        for robot, one in done.tracked.items()
        for what, arm in (("nominal table", fit_placement(one)), ("table found", done.found.arms[robot]))
    ]
    scene = BaseScene(
        [(robot, one.seen) for robot, one in done.tracked.items()],
        [],
        [],
        [(robot, arm.T_tracker_base) for robot, arm in done.found.arms.items()],
        residuals,
        "tracker",
    )
    nominal, found = (1e3 * done.figures[name] for name in ("nominal_rms_m", "heldout_rms_m"))
    facts = [f"nominal: {nominal:.3f} mm rms", f"found, in poses left out: {found:.3f} mm rms"]
    save_plots(folder, {"arms.png": plot_bases(scene, "Calibration of the arms", facts)})


def _notes(done: ArmsFound) -> tuple[str, ...]:
    """How far each arm is off its table, at most."""
    notes = []
    for robot, table in done.found.tables.items():
        off = np.abs(table - NOMINAL)
        lengths, angles = 1e3 * off[1:3].max(), np.degrees(off[[0, 3]].max())
        notes.append(f"{robot}: off its table by up to {lengths:.2f} mm and {angles:.3f} deg")
    return tuple(notes)
