"""`polish-sim calibrate tcp`, `base` and `arm`: where the tool is, where the second robot stands, the arms'
tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from polish_sim.cli.boundary import Outcome
from polish_sim.cli.many import Many, run_seeds, seed_folder
from polish_sim.cli.options import OUTPUT_OPTIONS, Given, Own, chosen, refuse_beside, refuse_without, takes
from polish_sim.cli.output_folder import claimed, put_file
from polish_sim.config.key import DEG, MM
from polish_sim.dual.experiment import CALIBRATIONS
from polish_sim.errors import unknown_name
from polish_sim.experiments.registry import SEED_OPTIONS
from polish_sim.row_file import Metrics, save_plots, whole_folder, write_metrics

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

    from polish_sim.dual.arms import PairArms
    from polish_sim.dual.calibrate import ArmsFound, BasesFound, TcpCalibration

CALIBRATION = "calibration.toml"
PANEL = "Instrument and measurements"
BESIDE_DATA = ("--data", "--pair", "--drift", "--check", *OUTPUT_OPTIONS)
"""Options that count for measurements of real robots, too."""
LARGEST_NOISE = 10.0  #: [mm]
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


class Means(NamedTuple):
    """A calibration as its options ask for it: how it is done, written and shown."""

    kind: str  #: From a file its claims are those of ``<kind>-data``
    what: str  #: What is found, for titles
    claims: str  #: Asked of simulated measurements
    run: Callable[[int], Any]  #: Simulates and calibrates with a seed
    read: Callable[[Path], Any]  #: Measurements from a file
    fit: Callable[[Any], Any]  #: Calibrates from them
    show: Callable[[Any], tuple[str, ...]]  #: Prints its own tables, returns notes
    write: Callable[[Any, Path], None]
    mean: str = "rms"  #: Of many seeds, or ``mean``
    folders: bool = False  #: Whether each of many seeds leaves its files


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
        3.0,
        90.0,
        DEG,
    ),
    Own(
        "--cell-tool",
        PANEL,
        "",
        "Simulate the cell's own tool, which `run dual --calibration` takes, not one planted by the seed.",
        bool,
    ),
    *(ARM, *TRIAL_OPTIONS),
)
def tcp(given: Given) -> int:
    """Find the tool's tip from touches of one fixed point, and its axes from moves along them."""
    # Lazy: --help must not wait for the libraries.
    from polish_sim.dual.calibrate import TcpTrial, calibrate_tcp_from, run_tcp_calibration
    from polish_sim.dual.calibration.tool import read_tool_measurements

    trial = TcpTrial(**chosen(given, "noise", "poses", "cone"))
    if given["--cell-tool"]:
        from polish_sim.cell import tool_on_flange

        trial = replace(trial, T_flange_tool=tool_on_flange())

    def run(seed: int) -> TcpCalibration:
        gears = _gears(given, seed)
        return run_tcp_calibration(
            replace(trial, seed=seed, read=gears and gears[0].reading("follower", gears[1]))
        )

    claims = "tcp-gears" if _elastic(given) else "tcp"
    read = (read_tool_measurements, calibrate_tcp_from)
    return carry_out(given, Means("tcp", "tool frame", claims, run, *read, _tcp_notes, _write_tcp), trial)


@takes(
    DATA,
    noise_option("--noise", "a measured point", "0.03"),
    Own("--points", PANEL, "N", "Points of an arc; default 200.", int, 6, 100_000),
    *(ARM, PAIR, *TRIAL_OPTIONS),
)  # fmt: skip
def base(given: Given) -> int:
    """Find where the second robot's base stands in the first one's, from axes turned before a laser
    tracker."""
    # Lazy: --help must not wait for the libraries.
    from polish_sim.dual.calibrate import BaseTrial, calibrate_base_from, run_base_calibration
    from polish_sim.dual.calibration.bases import read_base_measurements

    trial = BaseTrial(**chosen(given, "noise", "points"))

    def run(seed: int) -> BasesFound:
        gears = _gears(given, seed)
        return run_base_calibration(replace(trial, seed=seed, flanges=gears and gears[0].standing(gears[1])))

    claims = "base-gears" if _elastic(given) else "base"
    write = partial(_write_base, _pair(given))
    means = Means(
        "base", "bases", claims, run, read_base_measurements, calibrate_base_from, _base_notes, write
    )
    return carry_out(given, means, trial)


@takes(
    DATA,
    noise_option("--noise", "a measured point", "0.03"),
    Own("--poses", PANEL, "N", "Poses of each arm, 20 or more; default 60.", int, 20, 10_000),
    Own(
        "--length-error",
        PANEL,
        "MM",
        "Error of the simulated arms' d and a, standard deviation (mm); default 0.5.",
        float,
        0.0,
        2.0,
        MM,
    ),
    Own(
        "--angle-error",
        PANEL,
        "DEG",
        "Error of their joint offsets and alpha (deg); default 0.02.",
        float,
        0.0,
        0.2,
        DEG,
    ),
    *(ARM, PAIR, *TRIAL_OPTIONS),
)
def arm(given: Given) -> int:
    """Find two arms' true Denavit-Hartenberg tables from poses a laser tracker measured."""
    # Lazy: --help must not wait for the libraries.
    from polish_sim.calibration.arm import Tolerance
    from polish_sim.dual.calibrate import ArmTrial, calibrate_arm_from, run_arm_calibration
    from polish_sim.dual.calibration.arm import read_tracked

    errors = {"length": given["--length-error"], "angle": given["--angle-error"]}
    tolerance = Tolerance()._replace(**{name: error for name, error in errors.items() if error is not None})
    trial = ArmTrial(tolerance, **chosen(given, "noise", "poses"))

    def run(seed: int) -> ArmsFound:
        gears = _gears(given, seed)
        return run_arm_calibration(replace(trial, seed=seed, gears=gears and gears[0].gears))

    write = partial(_write_arm, _pair(given))
    means = Means("arm", "arms", "arm", run, read_tracked, calibrate_arm_from, _arm_notes, write)
    return carry_out(given, means, trial)


def _elastic(given: Given) -> bool:
    from polish_sim.config.cell import ARM_PRESETS

    name = given["--arm"] or "ideal"
    if name not in ARM_PRESETS:
        raise unknown_name("--arm", name, ARM_PRESETS)
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


def _pair(given: Given) -> str:
    return given["--pair"] or "simulated"


def carry_out(given: Given, means: Means, trial: object) -> int:
    """Calibrate from a file, once, or with many seeds of a ``trial``, write the folder and show the
    outcome."""
    data = given["--data"]
    refuse_beside(given, "--data", *(name for name in given if name not in BESIDE_DATA))
    first = given["--seed"] or 0
    refuse_without(given, "--seeds", "--workers", "--on")
    if given["--seeds"] is not None:
        kind = f"calibrate-{means.kind}"
        claims = CALIBRATIONS[means.claims]
        prepare = partial(_each, means)
        many = Many(kind, means.what, f"{trial} {given.get('--arm')}", prepare, claims, means.mean, "here")
        return run_seeds(many, given)
    with claimed(given, f"calibrate-{means.kind}") as folder:
        found = means.run(first) if data is None else means.fit(means.read(data))
        means.write(found, folder.draft)
        claims = CALIBRATIONS[means.claims if data is None else f"{means.kind}-data"]
        title = f"{means.what}, seed {first}" if data is None else f"{means.what} from {data.name}"
        outcome = Outcome(claims, title, {"this calibration": found.figures}, notes=means.show(found))
    return outcome.finish(folder.final, given["--check"])


def _each(means: Means, folder: Path) -> Callable[[int], Metrics]:
    """What calibrates with a seed, in any process."""
    place = folder.resolve()

    def calibrated(seed: int) -> Metrics:
        found = means.run(seed)
        if means.folders:
            with whole_folder(seed_folder(place, seed)) as own:
                means.write(found, own)
        figures: Metrics = found.figures
        return figures

    return calibrated


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
    outliers = done.figures["outliers"]
    notes = [f"note: touch {number} does not fit the others and was left out." for number in outliers]
    if done.found.orientation is None:
        notes.append("note: no moves were measured: the tool's axes are taken to be the flange's.")
    x, y, z = 1e3 * tip.point
    return (*notes, f"tip on the flange: {x:.3f}, {y:.3f}, {z:.3f} mm; std {_mm(tip.std)} mm")


def _write_base(pair: str, done: BasesFound, folder: Path) -> None:
    from polish_sim.dual.calibration.bases import write_base_calibration
    from polish_sim.dual.plots import plot_bases

    write_base_calibration(folder / CALIBRATION, done.found, pair, done.figures.get("true_transform"))
    table = done.measured.table(done.found)
    write_found(folder, {**done.figures, "pair": pair}, table, {"bases.png": plot_bases(done)})


def _base_notes(done: BasesFound) -> tuple[str, ...]:
    import numpy as np

    from polish_sim.dual.calibration.circle import GOOD_ARC

    notes = [f"note: {name} does not fit the others and was left out." for name in done.figures["outliers"]]
    for robot, circles in done.found.circles.items():
        notes += [
            f"note: the arc of axis {axis} of the {robot} is {np.degrees(circle.arc):.0f} deg; 120 deg or "
            "more is good."
            for axis, circle in enumerate(circles, 1)
            if circle.arc < GOOD_ARC
        ]
    notes += [
        f"note: axes 1 and 2 of the {robot} miss each other by {1e3 * axes.gap:.3f} mm, more than noise "
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
    table = tracked_table(done.measured, done.found)
    write_found(folder, {**done.figures, "pair": pair}, table, {"arms.png": plot_arms(done)})


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
