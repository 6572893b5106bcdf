"""Runs calibrations of tool and bases for their commands and writes their folders; imported only inside commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from polish_sim.analysis.claim import Claim
from polish_sim.analysis.run_record import METRICS, package_versions, write_json
from polish_sim.cli import console
from polish_sim.cli.outcome import Outcome
from polish_sim.dual.calibrate_bases import BasesFound, BaseTrial, calibrate_base_from, run_base_calibration
from polish_sim.dual.calibrate_tcp import TcpCalibration, TcpTrial, calibrate_tcp_from, run_tcp_calibration
from polish_sim.dual.calibration.base_file import method_named, read_base_measurements, write_base_calibration
from polish_sim.dual.calibration.circle import GOOD_ARC, Circle
from polish_sim.dual.calibration.tool import tip_positions_flange
from polish_sim.dual.calibration.tool_file import read_tool_measurements, tool_table, write_tool_calibration
from polish_sim.dual.experiment import CALIBRATIONS
from polish_sim.dual.plots import BaseScene, Residuals, ToolScene, plot_bases, plot_tool
from polish_sim.experiments.report import save_plots

_METHOD_CLAIMS = {"circles": "base", "poses": "base-poses", "handshake": "base-poses"}


def check_method(name: str) -> None:
    """Refuse an unknown way to measure bases before anything is claimed.

    Raises:
        InputError: There is none of that name.
    """
    method_named(name)


def of_the_cell(trial: TcpTrial) -> TcpTrial:
    """The same trial of the tool the cell has."""
    # Lazy: other calibrations of frames need no simulator.
    from polish_sim.cell import tool_on_flange

    return replace(trial, T_flange_tool=tool_on_flange())


def tcp_once(trial: TcpTrial, draft: Path) -> Outcome:
    """Calibrate one simulated tool and write its folder."""
    found = run_tcp_calibration(trial)
    _write_tcp(draft, found)
    return Outcome(
        CALIBRATIONS["tcp"],
        f"tool frame, seed {trial.seed}",
        {"this calibration": found.figures},
        notes=_tcp_notes(found),
    )


def tcp_many(trial: TcpTrial, seeds: Sequence[int], draft: Path) -> Outcome:
    """Calibrate with each seed; what is checked is the worst of each figure."""
    return together(
        "calibrate-tcp",
        CALIBRATIONS["tcp"],
        "tool frame",
        seeds,
        lambda seed: run_tcp_calibration(replace(trial, seed=seed)).figures,
        draft,
    )


def tcp_from_data(file: Path, draft: Path) -> Outcome:
    """Calibrate from a file of a real robot's touches and write its folder."""
    found = calibrate_tcp_from(read_tool_measurements(file))
    _write_tcp(draft, found)
    columns = {"this calibration": found.figures}
    return Outcome(CALIBRATIONS["tcp-data"], f"tool frame from {file.name}", columns, notes=_tcp_notes(found))


def base_once(trial: BaseTrial, pair: str, draft: Path) -> Outcome:
    """Calibrate two simulated bases and write their folder."""
    found = run_base_calibration(trial)
    _write_base(draft, found, trial.method, pair)
    title = f"bases by {trial.method}, seed {trial.seed}"
    return Outcome(
        CALIBRATIONS[_METHOD_CLAIMS[trial.method]], title, {"this calibration": found.figures}, notes=_base_notes(found)
    )


def base_many(trial: BaseTrial, seeds: Sequence[int], draft: Path) -> Outcome:
    """Calibrate with each seed; what is checked is the worst of each figure."""

    def figures(seed: int) -> Mapping[str, Any]:
        return run_base_calibration(replace(trial, seed=seed)).figures

    kind = _METHOD_CLAIMS[trial.method]
    return together(f"calibrate-{kind}", CALIBRATIONS[kind], f"bases by {trial.method}", seeds, figures, draft)


def base_from_data(file: Path, method: str, pair: str, draft: Path) -> Outcome:
    """Calibrate from a file of measurements of real robots and write its folder."""
    found = calibrate_base_from(read_base_measurements(file, method))
    _write_base(draft, found, method, pair)
    columns = {"this calibration": found.figures}
    return Outcome(
        CALIBRATIONS[f"{_METHOD_CLAIMS[method]}-data"], f"bases from {file.name}", columns, notes=_base_notes(found)
    )


def together(
    experiment: str,
    claims: Sequence[Claim],
    what: str,
    seeds: Sequence[int],
    figures: Callable[[int], Mapping[str, Any]],
    draft: Path,
) -> Outcome:
    """Calibrate with each seed: rms and worst value of each figure over them; broken off, over those that were done."""
    runs, interrupted = _each_seed(seeds, figures)

    def over(summary: Callable[[list[float]], float]) -> dict[str, float]:
        known = {c.figure: [run[c.figure] for run in runs.values() if c.figure in run] for c in claims}
        return {figure: summary(values) for figure, values in known.items() if values}

    rms, worst = over(lambda values: float(np.sqrt(np.mean(np.square(values))))), over(max)
    table = {"experiment": experiment, "seeds": list(runs), "rms": rms, "worst": worst, "runs": runs}
    write_json(draft / METRICS, table | {"versions": package_versions()})
    columns = {"rms": rms, "worst seed": worst}
    return Outcome(claims, f"{what}, {len(runs)} seeds", columns, interrupted=interrupted)


def _each_seed(
    seeds: Sequence[int], figures: Callable[[int], Mapping[str, Any]]
) -> tuple[dict[int, Mapping[str, Any]], bool]:
    """Figures by seed, and whether the user broke off after the first."""
    runs: dict[int, Mapping[str, Any]] = {}
    with console.progress() as observer:
        observer.stage(f"calibrate {len(seeds)} seeds")
        try:
            for seed in seeds:
                runs[seed] = figures(seed)
                observer.progress(len(runs), len(seeds))
        except KeyboardInterrupt:
            if not runs:
                raise
            return runs, True
    return runs, False


def _write_tcp(folder: Path, done: TcpCalibration) -> None:
    found, measured = done.found, done.measured
    write_tool_calibration(folder / "calibration.toml", done.figures, found)
    (folder / "residuals.csv").write_text(tool_table(measured, found), encoding="utf-8")
    write_json(folder / METRICS, {**done.figures, "versions": package_versions()})
    tip = found.tip
    moved = np.empty((0, 3))
    if len(measured.T_base_flange_moves):
        first = measured.T_base_flange_moves[0]
        start = first[:3, :3] @ tip.point + first[:3, 3]
        moved = start + tip_positions_flange(measured.T_base_flange_moves, tip.point) @ first[:3, :3].T
    distances = Residuals("touches", np.linalg.norm(tip.residuals, axis=1), tip.used)
    scene = ToolScene(measured.touches.T_base_flange, found.T_flange_tool, tip.touched, moved, distances)
    x, y, z = 1e3 * tip.point
    facts = [f"tip ({x:.3f}, {y:.3f}, {z:.3f}) ± {1e3 * done.figures['position_std_m']:.3f} mm"]
    save_plots(folder, {"tool.png": plot_tool(scene, "Calibration of the tool frame", facts)})


def _tcp_notes(done: TcpCalibration) -> tuple[str, ...]:
    tip, outliers = done.found.tip, done.figures["outliers"]
    notes = [f"note: touch {number} does not fit the others and was left out." for number in outliers]
    if done.found.orientation is None:
        notes.append("note: no moves were measured: the tool's axes are taken to be the flange's.")
    x, y, z = 1e3 * tip.point
    return (*notes, f"tip on the flange: {x:.3f}, {y:.3f}, {z:.3f} mm; std {_mm(tip.std)} mm")


def _write_base(folder: Path, done: BasesFound, method: str, pair: str) -> None:
    found = done.found
    write_base_calibration(folder / "calibration.toml", found, pair, done.figures.get("true_transform"))
    table = method_named(method).table(done.measured, found)
    (folder / "residuals.csv").write_text(table, encoding="utf-8")
    write_json(folder / METRICS, {**done.figures, "pair": pair, "versions": package_versions()})
    frames = [(robot, T) for robot, (T, _) in found.bases.items()]
    circles = [circle for pair_ in found.circles.values() for circle in pair_]
    scene = BaseScene(
        [(group.name, group.points) for group in found.groups],
        [_line(circle) for circle in circles],
        [circle.center + 0.4 * np.outer([-1.0, 1.0], circle.axis) for circle in circles],
        frames or [("master", np.eye(4)), ("follower", found.T_master_follower)],
        [Residuals(group.name, group.residuals, group.used) for group in found.groups],
        "tracker" if found.bases else "master's base",
    )
    facts = [f"{len(done.figures['outliers'])} left out", f"residual {1e3 * done.figures['residual_rms_m']:.3f} mm rms"]
    save_plots(folder, {"bases.png": plot_bases(scene, "Calibration of the bases", facts)})


def _line(circle: Circle) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A circle as a closed line, shape (91, 3)."""
    turn = np.linspace(0.0, 2.0 * np.pi, 91)
    around = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    return circle.center + circle.radius * around @ circle.frame.T


def _base_notes(done: BasesFound) -> tuple[str, ...]:
    notes = [f"note: {name} does not fit the others and was left out." for name in done.figures["outliers"]]
    for robot, circles in done.found.circles.items():
        notes += [
            f"note: the arc of axis {axis} of the {robot} is {np.degrees(circle.arc):.0f} deg; 120 deg or more is good."
            for axis, circle in enumerate(circles, 1)
            if circle.arc < GOOD_ARC
        ]
    notes += [
        f"note: axes 1 and 2 of the {robot} miss each other by {1e3 * axes.gap:.3f} mm, more than noise explains: that "
        "they meet on a UR5e was not used. Is the arm as its table says?"
        for robot, axes in done.found.frames.items()
        if not axes.meets
    ]
    position = done.found.T_master_follower[:3, 3]
    std = np.sqrt(np.diag(done.found.covariance)[:3])
    return (*notes, f"follower's base in the master's: {_mm(position)} mm; std {_mm(std)} mm")


def _mm(values: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    return ", ".join(f"{1e3 * value:.3f}" for value in values)
