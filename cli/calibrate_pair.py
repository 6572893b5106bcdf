"""`polish-sim calibrate tcp`, `base` and `arm`: where the tool is, where the second robot stands, the arms'
tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polish_sim.cli.many import Means, carry_out
from polish_sim.cli.options import OUTPUT_OPTIONS, Given, Own, chosen, takes
from polish_sim.config.key import DEG, MM
from polish_sim.dual import CALIBRATIONS
from polish_sim.errors import check_name
from polish_sim.experiments.registry import SEED_OPTIONS
from polish_sim.row_file import Metrics, put_file, save_plots, write_metrics

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

    from polish_sim.cell import Observer
    from polish_sim.dual.arms import PairArms
    from polish_sim.dual.calibrate import ArmsFound, BasesFound, TcpCalibration

CALIBRATION = "calibration.toml"
PANEL = "Instrument and measurements"
LARGEST_NOISE = 0.01  #: [m]
TRIAL_OPTIONS = (*SEED_OPTIONS, "--check", *OUTPUT_OPTIONS)
DATA = Own(
    "--data",
    PANEL,
    "FILE.csv",
    "Measurements of real robots instead of simulated ones: docs/calibration.md.",
    Path,
)
PAIR = Own(
    "--pair",
    PANEL,
    "NAME",
    "Name of the two robots; a run refuses the calibration of another pair; default simulated.",
)

ARM = Own(
    "--arm",
    PANEL,
    "NAME",
    "ideal (default): the instruments' errors alone; ur5e: those of the arms as well, docs/how_real.md.",
)


def noise_option(name: str, of: str, default: str) -> Own:
    """The option of an instrument's noise."""
    text = f"Noise of {of} per coordinate, rms (mm); default {default}."
    return Own(name, PANEL, "MM", text, float, 0.0, LARGEST_NOISE, MM)


@takes(
    DATA,
    noise_option("--noise", "a touch", "0.05"),
    Own("--poses", PANEL, "N", "Touches, 4 or more; default 10.", int, 4, 100_000),
    Own(
        "--cone",
        PANEL,
        "DEG",
        "Tilt of the tool in the touches, 3 to 90 (deg); default 45.",
        float,
        3.0 * DEG.si,
        90.0 * DEG.si,
        DEG,
    ),
    Own(
        "--cell-tool",
        PANEL,
        "",
        "Simulate the cell's own tool, which `run dual --calibration` takes, not one planted by the seed.",
    ),
    *(ARM, *TRIAL_OPTIONS),
)
def tcp(given: Given) -> int:
    """Find the tool's tip from touches of one fixed point, and its axes from moves along them."""
    from polish_sim.dual.calibrate import TcpTrial, calibrate_tcp_from, run_tcp_calibration

    trial = TcpTrial(**chosen(given, "noise", "poses", "cone"))
    if given["--cell-tool"]:
        from polish_sim.cell import tool_on_flange

        trial = replace(trial, T_flange_tool=tool_on_flange())

    def run(seed: int, _: Observer) -> TcpCalibration:
        gears = _gears(given, seed)
        return run_tcp_calibration(
            replace(trial, seed=seed, read=gears and gears[0].reading("follower", gears[1]))
        )

    claims = CALIBRATIONS["tcp-gears" if _elastic(given) else "tcp"], CALIBRATIONS["tcp-data"]
    means = Means(
        "calibrate-tcp", "tool frame", run, _tcp_notes, _write_tcp, *claims,
        calibrate_tcp_from,
    )  # fmt: skip
    return carry_out(given, means, trial)


@takes(
    DATA,
    noise_option("--noise", "a measured point", "0.03"),
    *(ARM, PAIR, *TRIAL_OPTIONS),
)  # fmt: skip
def base(given: Given) -> int:
    """Find where the second robot's base stands in the first one's, from axes turned before a laser
    tracker."""
    from polish_sim.dual.calibrate import BaseTrial, calibrate_base_from, run_base_calibration

    trial = BaseTrial(**chosen(given, "noise"))

    def run(seed: int, _: Observer) -> BasesFound:
        gears = _gears(given, seed)
        return run_base_calibration(replace(trial, seed=seed, flanges=gears and gears[0].standing(gears[1])))

    claims = CALIBRATIONS["base-gears" if _elastic(given) else "base"], CALIBRATIONS["base-data"]
    means = Means(
        "calibrate-base", "bases", run, _base_notes, partial(_write_base, given["--pair"] or "simulated"),
        *claims, calibrate_base_from,
    )  # fmt: skip
    return carry_out(given, means, trial)


@takes(
    DATA,
    noise_option("--noise", "a measured point", "0.03"),
    Own("--poses", PANEL, "N", "Poses of each arm, 20 or more; default 60.", int, 20, 10_000),
    *(ARM, PAIR, *TRIAL_OPTIONS),
)
def arm(given: Given) -> int:
    """Find two arms' true Denavit-Hartenberg tables from poses a laser tracker measured."""
    from polish_sim.dual.calibrate import ArmTrial, calibrate_arm_from, run_arm_calibration

    trial = ArmTrial(**chosen(given, "noise", "poses"))

    def run(seed: int, _: Observer) -> ArmsFound:
        gears = _gears(given, seed)
        return run_arm_calibration(replace(trial, seed=seed, gears=gears and gears[0].gears))

    means = Means(
        "calibrate-arm", "arms", run, _arm_notes, partial(_write_arm, given["--pair"] or "simulated"),
        CALIBRATIONS["arm"], CALIBRATIONS["arm-data"], calibrate_arm_from,
    )  # fmt: skip
    return carry_out(given, means, trial)


def _elastic(given: Given) -> bool:
    from polish_sim.config.cell import ARM_PRESETS

    name = given["--arm"] or "ideal"
    check_name("--arm", name, ARM_PRESETS)
    return name != "ideal"


def _gears(given: Given, seed: int) -> tuple[PairArms, np.random.Generator] | None:
    """Both arms of a seed with their gears, if they are asked for, and what draws how far those have
    slipped."""
    if not _elastic(given):
        return None
    import numpy as np

    from polish_sim.dual.arms import lone_arms
    from polish_sim.dual.calibrate import Q_NEAR

    return lone_arms(seed, Q_NEAR), np.random.default_rng([seed, 18])


def write_found(folder: Path, figures: Metrics, residuals: str, plots: Mapping[str, Figure]) -> None:
    """Write what stands beside every calibration.toml: figures, the table of residuals, and plots."""

    put_file(folder, "residuals.csv", residuals)
    write_metrics(folder, figures)
    save_plots(folder, plots)


def _write_tcp(done: TcpCalibration, folder: Path) -> None:
    from polish_sim.dual.calibration.tool import tool_table, write_tool_calibration
    from polish_sim.dual.plots import plot_tool

    write_tool_calibration(folder / CALIBRATION, done.figures, done.found)
    write_found(folder, done.figures, tool_table(done.measured, done.found), {"tool.png": plot_tool(done)})


def _tcp_notes(done: TcpCalibration) -> tuple[str, ...]:
    tip = done.found.tip
    notes = [
        f"touch {number} does not fit the others and was left out." for number in done.figures["outliers"]
    ]
    if done.found.orientation is None:
        notes.append("no moves were measured: the tool's axes are taken to be the flange's.")
    x, y, z = 1e3 * tip.point
    return (*notes, f"tip on the flange: {x:.3f}, {y:.3f}, {z:.3f} mm; std {_mm(tip.std)} mm")


def _write_base(pair: str, done: BasesFound, folder: Path) -> None:
    from polish_sim.dual.calibration.bases import arcs_table, write_base_calibration
    from polish_sim.dual.plots import plot_bases

    write_base_calibration(folder / CALIBRATION, done.found, pair, done.figures)
    write_found(
        folder, {**done.figures, "pair": pair}, arcs_table(done.found), {"bases.png": plot_bases(done)}
    )


def _base_notes(done: BasesFound) -> tuple[str, ...]:
    import numpy as np

    from polish_sim.dual.calibration.circle import GOOD_ARC

    notes = [f"{name} does not fit the others and was left out." for name in done.figures["outliers"]]
    for robot, circles in done.found.circles.items():
        notes += [
            f"the arc of axis {axis} of the {robot} is {np.degrees(circle.arc):.0f} deg; 120 deg or "
            "more is good."
            for axis, circle in enumerate(circles, 1)
            if circle.arc < GOOD_ARC
        ]
    notes += [
        f"axes 1 and 2 of the {robot} miss each other by {1e3 * axes.gap:.3f} mm, more than noise "
        "explains: that they meet on this arm was not used. Is the arm as its table says?"
        for robot, axes in done.found.frames.items()
        if not axes.meets
    ]
    position = done.found.T_master_follower[:3, 3]
    std = np.sqrt(np.diag(done.found.covariance)[:3])
    return (*notes, f"follower's base in the master's: {_mm(position)} mm; std {_mm(std)} mm")


def _write_arm(pair: str, done: ArmsFound, folder: Path) -> None:
    from polish_sim.dual.calibration.arm import tracked_table, write_arm_calibration
    from polish_sim.dual.plots import plot_arms

    write_arm_calibration(folder / CALIBRATION, done.found, pair, done.true)
    write_found(
        folder,
        {**done.figures, "pair": pair},
        tracked_table(done.measured, done.found),
        {"arms.png": plot_arms(done)},
    )


def _arm_notes(done: ArmsFound) -> tuple[str, ...]:
    """How far each arm is off its table, at most."""
    import numpy as np

    from polish_sim.motion.kinematics import NOMINAL

    notes = []
    for robot, table in done.found.tables.items():
        off = np.abs(table - NOMINAL)
        lengths = 1e3 * off[1:3].max()
        angles = np.degrees(off[[0, 3]].max())
        notes.append(f"{robot}: off its table by up to {lengths:.2f} mm and {angles:.3f} deg")
    return tuple(notes)


def _mm(values: Any) -> str:
    return ", ".join(f"{1e3 * value:.3f}" for value in values)
