"""`polish-sim calibrate tcp`, `base` and `arm`: where the tool is, where the second robot stands, the arms' tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from polish_sim.cli import console
from polish_sim.cli.options import OUTPUT_OPTIONS, Given, Own, takes
from polish_sim.cli.output_folder import claimed
from polish_sim.config.key import DEG, MM
from polish_sim.dual.experiment import CALIBRATIONS
from polish_sim.errors import InputError, count_text, leave_out, unknown_name

if TYPE_CHECKING:
    import numpy as np

    from polish_sim.analysis.claim import Claim
    from polish_sim.cli.outcome import Outcome
    from polish_sim.dual.arms import PairArms
    from polish_sim.dual.calibrate_bases import ArmsFound, BasesFound
    from polish_sim.dual.calibrate_tcp import TcpCalibration

PANEL: Final = "Instrument and measurements"
LARGEST_NOISE: Final = 10.0  #: [mm]
CLAIMS_OF_METHOD: Final = {"circles": "base", "poses": "base-poses", "handshake": "base-poses"}
TRIAL_OPTIONS: Final = ("--seed", "--seeds", "--check", *OUTPUT_OPTIONS)
DATA: Final = Own(
    "--data", PANEL, "FILE.csv", "Measurements of real robots instead of simulated ones: docs/calibration.md.", Path
)
PAIR: Final = Own(
    "--pair", PANEL, "NAME", "Name of the two robots; a run refuses the calibration of another pair; default simulated."
)

ARM: Final = Own(
    "--arm", PANEL, "NAME", "ideal (default): the instruments' errors alone; ur5e: those of the arms as well, "
    "docs/how_real.md."
)  # fmt: skip


def noise_option(name: str, of: str, default: str) -> Own:
    """The option of an instrument's noise."""
    text = f"Noise of {of} per coordinate, rms (mm); default {default}."
    return Own(name, PANEL, "MM", text, float, 0.0, LARGEST_NOISE, MM)


class Calibrated(NamedTuple):
    """A calibration and how it is written and shown."""

    claims: Sequence[Claim]
    title: str
    figures: Mapping[str, Any]
    notes: tuple[str, ...]
    write: Callable[[Path], None]


@takes(
    DATA,
    noise_option("--noise", "a touch", "0.05"),
    Own("--poses", PANEL, "N", "Touches, 4 or more; default 10.", int, 4, 100_000),
    Own("--cone", PANEL, "DEG", "Tilt of the tool in the touches, 3 to 90 (deg); default 45.", float, 3.0, 90.0, DEG),
    Own("--cell-tool", PANEL, "", "Simulate the cell's own tool, which `run dual --calibration` takes, not one "
        "planted by the seed.", bool),
    *(ARM, *TRIAL_OPTIONS),
)  # fmt: skip
def tcp(given: Given) -> int:
    """Find the tool's tip from touches of one fixed point, and its axes from moves along them."""
    refuse_beside_data(given, "--noise", "--poses", "--cone", "--cell-tool", "--arm", "--seed", "--seeds")
    # Lazy: --help must not wait for the libraries.
    from polish_sim.dual.calibrate_tcp import TcpTrial, calibrate_tcp_from, run_tcp_calibration
    from polish_sim.dual.calibration.tool import read_tool_measurements

    claims = CALIBRATIONS["tcp-gears" if _elastic(given) else "tcp"]
    trial = TcpTrial(**_chosen(given, "noise", "poses", "cone", "seed"))
    if given["--cell-tool"]:
        from polish_sim.cell import tool_on_flange

        trial = replace(trial, T_flange_tool=tool_on_flange())

    def simulated(seed: int) -> Calibrated:
        gears = _gears(given, seed)
        read = gears and gears[0].reading("follower", gears[1])
        found = run_tcp_calibration(replace(trial, seed=seed, read=read))
        write = partial(_write_tcp, found)
        return Calibrated(claims, f"tool frame, seed {seed}", found.figures, _tcp_notes(found), write)

    def measured(file: Path) -> Calibrated:
        found = calibrate_tcp_from(read_tool_measurements(file))
        title, write = f"tool frame from {file.name}", partial(_write_tcp, found)
        return Calibrated(CALIBRATIONS["tcp-data"], title, found.figures, _tcp_notes(found), write)

    return _calibrate("tcp", "tool frame", claims, given, simulated, measured)


@takes(
    DATA,
    Own("--method", PANEL, "NAME", "circles (default), poses or handshake: docs/calibration.md."),
    noise_option("--noise", "a measured point", "0.03"),
    Own("--points", PANEL, "N", "Points of an arc (default 200), poses of each robot (12) or common points (10).", int,
        3, 100_000),
    *(ARM, PAIR, *TRIAL_OPTIONS),
)  # fmt: skip
def base(given: Given) -> int:
    """Find where the second robot's base stands in the first one's, from a laser tracker or from common touches."""
    refuse_beside_data(given, "--noise", "--points", "--arm", "--seed", "--seeds")
    # Lazy: --help must not wait for the libraries.
    from polish_sim.dual.calibrate_bases import BaseTrial, calibrate_base_from, run_base_calibration
    from polish_sim.dual.calibration.bases import method_named, read_base_measurements

    method, pair = given["--method"] or "circles", given["--pair"] or "simulated"
    method_named(method)
    trial = BaseTrial(method, **_chosen(given, "noise", "points", "seed"))
    kind = CLAIMS_OF_METHOD[method]
    if _elastic(given) and method == "handshake":
        raise InputError("--arm ur5e is for --method circles and poses: 'handshake' simulates no joints.")
    claims = CALIBRATIONS["base-gears" if _elastic(given) else kind]

    def simulated(seed: int) -> Calibrated:
        gears = _gears(given, seed)
        found = run_base_calibration(replace(trial, seed=seed, flanges=gears and gears[0].standing(gears[1])))
        title, write = f"bases by {method}, seed {seed}", partial(_write_base, found, method, pair)
        return Calibrated(claims, title, found.figures, _base_notes(found), write)

    def measured(file: Path) -> Calibrated:
        found = calibrate_base_from(read_base_measurements(file, method))
        title, write = f"bases from {file.name}", partial(_write_base, found, method, pair)
        return Calibrated(CALIBRATIONS[f"{kind}-data"], title, found.figures, _base_notes(found), write)

    return _calibrate(kind, f"bases by {method}", claims, given, simulated, measured)


@takes(
    DATA,
    noise_option("--noise", "a measured point", "0.03"),
    Own("--poses", PANEL, "N", "Poses of each arm, 20 or more; default 60.", int, 20, 10_000),
    Own("--length-error", PANEL, "MM", "Error of the simulated arms' d and a, standard deviation (mm); default 0.5.",
        float, 0.0, 2.0, MM),
    Own("--angle-error", PANEL, "DEG", "Error of their joint offsets and alpha (deg); default 0.02.", float, 0.0, 0.2,
        DEG),
    *(ARM, PAIR, *TRIAL_OPTIONS),
)  # fmt: skip
def arm(given: Given) -> int:
    """Find two arms' true Denavit-Hartenberg tables from poses a laser tracker measured."""
    refuse_beside_data(given, "--noise", "--poses", "--length-error", "--angle-error", "--arm", "--seed", "--seeds")
    # Lazy: --help must not wait for the libraries.
    from polish_sim.dual.calibrate_bases import ArmTrial, calibrate_arm_from, run_arm_calibration
    from polish_sim.dual.calibration.arm import Tolerance, read_tracked

    usual, pair = ArmTrial(), given["--pair"] or "simulated"
    length, angle = given["--length-error"], given["--angle-error"]
    tolerance = Tolerance(
        usual.tolerance.length if length is None else length, usual.tolerance.angle if angle is None else angle
    )
    trial = replace(usual, tolerance=tolerance, **_chosen(given, "noise", "poses", "seed"))

    def calibrated(found: ArmsFound, kind: str, title: str) -> Calibrated:
        write = partial(_write_arm, found, pair)
        return Calibrated(CALIBRATIONS[kind], title, found.figures, _arm_notes(found), write)

    def simulated(seed: int) -> Calibrated:
        gears = _gears(given, seed)
        rest = gears and partial(gears[0].rest, rng=gears[1])
        return calibrated(run_arm_calibration(replace(trial, seed=seed, rest=rest)), "arm", f"arms, seed {seed}")

    def measured(file: Path) -> Calibrated:
        return calibrated(calibrate_arm_from(read_tracked(file)), "arm-data", f"arms from {file.name}")

    return _calibrate("arm", "arms", CALIBRATIONS["arm"], given, simulated, measured)


def _elastic(given: Given) -> bool:
    from polish_sim.cell.real_arm import ARMS

    name = given["--arm"] or "ideal"
    if name not in ARMS:
        raise unknown_name("--arm", name, ARMS)
    return name != "ideal"


def _gears(given: Given, seed: int) -> tuple[PairArms, np.random.Generator] | None:
    """Both arms of a seed with their gears, if they are asked for, and what draws how far those have slipped."""
    if not _elastic(given):
        return None
    import numpy as np

    from polish_sim.dual.arms import lone_arms
    from polish_sim.dual.calibrate_bases import Q_NEAR

    return lone_arms(seed, Q_NEAR), np.random.default_rng([seed, 18])


def refuse_beside_data(given: Given, *simulated: str) -> None:
    """Refuse, by name, options of a simulated measurement beside a real one."""
    idle = [name for name in simulated if given[name] is not None]
    if given["--data"] is not None and idle:
        raise InputError(leave_out(idle, "would change nothing with --data"))


def _chosen(given: Given, *names: str) -> dict[str, Any]:
    """Options that were given, by the names of a trial's fields."""
    return {name: given[f"--{name}"] for name in names if given[f"--{name}"] is not None}


def _calibrate(
    kind: str,
    what: str,
    claims: Sequence[Claim],
    given: Given,
    simulated: Callable[[int], Calibrated],
    measured: Callable[[Path], Calibrated],
) -> int:
    """Calibrate from a file, once, or with many seeds, write the folder and show the outcome."""
    from polish_sim.cli.outcome import Outcome

    command, first = kind.partition("-")[0], given["--seed"] or 0
    with claimed(given["--out"], f"calibrate-{command}", given["--overwrite"]) as folder:
        if given["--seeds"] is not None and given["--data"] is None:
            seeds = range(first, first + given["--seeds"])
            outcome = _together(f"calibrate-{kind}", claims, what, seeds, simulated, folder.draft)
        else:
            done = simulated(first) if given["--data"] is None else measured(given["--data"])
            done.write(folder.draft)
            outcome = Outcome(done.claims, done.title, {"this calibration": done.figures}, notes=done.notes)
    return outcome.finish(folder.final, check=bool(given["--check"]))


def _together(
    kind: str,
    claims: Sequence[Claim],
    what: str,
    seeds: Sequence[int],
    simulated: Callable[[int], Calibrated],
    draft: Path,
) -> Outcome:
    """Calibrate with each seed: rms and worst value of each figure; broken off, over those that were done."""
    from polish_sim.analysis.run_record import METRICS, package_versions, write_json
    from polish_sim.cli.outcome import Outcome

    runs, interrupted = _each_seed(seeds, simulated)

    def over(summary: Callable[[list[float]], float]) -> dict[str, float]:
        known = {c.figure: [run[c.figure] for run in runs.values() if c.figure in run] for c in claims}
        return {figure: summary(values) for figure, values in known.items() if values}

    rms, worst = over(lambda values: (sum(value**2 for value in values) / len(values)) ** 0.5), over(max)
    table = {"experiment": kind, "seeds": list(runs), "rms": rms, "worst": worst, "runs": runs}
    write_json(draft / METRICS, table | {"versions": package_versions()})
    title = f"{what}, {count_text(len(runs), 'seed')}"
    return Outcome(claims, title, {"rms": rms, "worst seed": worst}, interrupted=interrupted)


def _each_seed(
    seeds: Sequence[int], simulated: Callable[[int], Calibrated]
) -> tuple[dict[int, Mapping[str, Any]], bool]:
    """Figures by seed, and whether the user broke off after the first."""
    runs: dict[int, Mapping[str, Any]] = {}
    with console.progress() as observer:
        observer.stage(f"calibrate {count_text(len(seeds), 'seed')}")
        try:
            for seed in seeds:
                runs[seed] = simulated(seed).figures
                observer.progress(len(runs), len(seeds))
        except KeyboardInterrupt:
            if not runs:
                raise
            return runs, True
    return runs, False


def _write_tcp(done: TcpCalibration, folder: Path) -> None:
    from polish_sim.analysis.run_record import METRICS, package_versions, write_json
    from polish_sim.dual.calibration.tool import tool_table, write_tool_calibration
    from polish_sim.dual.plots import plot_tool
    from polish_sim.experiments.report import save_plots

    found, measured = done.found, done.measured
    write_tool_calibration(folder / "calibration.toml", done.figures, found)
    (folder / "residuals.csv").write_text(tool_table(measured, found), encoding="utf-8")
    write_json(folder / METRICS, {**done.figures, "versions": package_versions()})
    save_plots(folder, {"tool.png": plot_tool(done)})


def _tcp_notes(done: TcpCalibration) -> tuple[str, ...]:
    tip, outliers = done.found.tip, done.figures["outliers"]
    notes = [f"note: touch {number} does not fit the others and was left out." for number in outliers]
    if done.found.orientation is None:
        notes.append("note: no moves were measured: the tool's axes are taken to be the flange's.")
    x, y, z = 1e3 * tip.point
    return (*notes, f"tip on the flange: {x:.3f}, {y:.3f}, {z:.3f} mm; std {_mm(tip.std)} mm")


def _write_base(done: BasesFound, method: str, pair: str, folder: Path) -> None:
    from polish_sim.analysis.run_record import METRICS, package_versions, write_json
    from polish_sim.dual.calibration.bases import method_named, write_base_calibration
    from polish_sim.dual.plots import plot_bases
    from polish_sim.experiments.report import save_plots

    found = done.found
    write_base_calibration(folder / "calibration.toml", found, pair, done.figures.get("true_transform"))
    table = method_named(method).table(done.measured, found)
    (folder / "residuals.csv").write_text(table, encoding="utf-8")
    write_json(folder / METRICS, {**done.figures, "pair": pair, "versions": package_versions()})
    save_plots(folder, {"bases.png": plot_bases(done)})


def _base_notes(done: BasesFound) -> tuple[str, ...]:
    import numpy as np

    from polish_sim.dual.calibration.circle import GOOD_ARC

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


def _write_arm(done: ArmsFound, pair: str, folder: Path) -> None:
    from polish_sim.analysis.run_record import METRICS, package_versions, write_json
    from polish_sim.dual.calibration.arm import tracked_table, write_arm_calibration
    from polish_sim.dual.plots import plot_arms
    from polish_sim.experiments.report import save_plots

    write_arm_calibration(folder / "calibration.toml", done.found, pair, done.true)
    (folder / "residuals.csv").write_text(tracked_table(done.tracked, done.found), encoding="utf-8")
    write_json(folder / METRICS, {**done.figures, "pair": pair, "versions": package_versions()})
    save_plots(folder, {"arms.png": plot_arms(done)})


def _arm_notes(done: ArmsFound) -> tuple[str, ...]:
    """How far each arm is off its table, at most."""
    import numpy as np

    from polish_sim.motion.kinematics import NOMINAL

    notes = []
    for robot, table in done.found.tables.items():
        off = np.abs(table - NOMINAL)
        lengths, angles = 1e3 * off[1:3].max(), np.degrees(off[[0, 3]].max())
        notes.append(f"{robot}: off its table by up to {lengths:.2f} mm and {angles:.3f} deg")
    return tuple(notes)


def _mm(values: Any) -> str:
    return ", ".join(f"{1e3 * value:.3f}" for value in values)
