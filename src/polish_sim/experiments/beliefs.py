"""What the host knows before a run: its arm (``robot.compensation``), its tool (``payload``), and what a run
before it has learned (``process.learn``).

With a compensation it computes with the arm as it is built, not with the maker's table. Before the run the
arm stands still in poses around its work, and a laser tracker sees a target at the tool's point. Table, base,
target and gears are found as by ``calibrate arm``. The host then knows where its links are, q = encoder -
wind-up(weight) + error(encoder), and its Jacobian has the slope of that error: a tool commanded to go
straight does, although the gears between err with each turn of their rotors.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from textwrap import wrap

import numpy as np

from polish_sim.analysis.claim import figure_of
from polish_sim.analysis.run_record import differences, ending, read_record
from polish_sim.arrays import Array
from polish_sim.calibration.arm import USUAL_NOISE, ArmEstimate, Tolerance, TrackedArm, fit_arm
from polish_sim.calibration.payload import PayloadReadings, fit_payload, plan_payload_poses
from polish_sim.calibration.tables import Calibration, read_calibrated_tool
from polish_sim.cell import Cell, weight_of
from polish_sim.cell.cell import MAKERS_ARM, BelievedArm
from polish_sim.cell.gears import build_host_arm
from polish_sim.cell.kernel import Lesson
from polish_sim.cell.real_arm import AROUND, built_table, resting_arm
from polish_sim.cell.scene import robot_with_tool, tool_on_flange
from polish_sim.cell.wrist_sensor import fresh_sensor, read_at_rest
from polish_sim.config import Checked, HeadConfig, RobotConfig, Scenario
from polish_sim.control import Controller
from polish_sim.errors import ConfigError, InputError, unknown_name
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.registry import Experiment
from polish_sim.planning.toolpath import ToolPath, stretches
from polish_sim.toml_text import read_toml, toml_text

NONE, TRACKER = "none", "tracker"
POSES = 200
_STREAM = 18  # of the seed
KIND = "compensation"
HEAD = (
    "An arm as found: table (joint offsets [rad], d [m], a [m], alpha [rad], six each), base (where it "
    "stands in the frame its work is given in), tool_point on the flange [m], gears (of each joint: wind-up "
    "below, between and above the knees [rad/(N m)]; sine and cosine of twice the rotor's angle, of four "
    "times it [rad])."
)
FILE = "compensation.toml"


def believed_arm(scenario: Scenario, q_start: Array) -> BelievedArm:
    """What the host knows of the arm of a scenario, for work that starts at ``q_start`` (6,) [rad].

    Beside a file the arms of other seeds, which `--seeds` and the proof play, are measured.

    Raises:
        InputError: The file cannot be used.
    """
    seed, asked = scenario.seed, scenario.robot.compensation
    if asked == NONE:
        return MAKERS_ARM
    known = None if asked == TRACKER else read_arm(Path(asked), seed)
    found = known or track_arm(scenario.robot, scenario.head, seed, tuple(q_start))
    T_flange_tool = tool_on_flange().copy()
    T_flange_tool[:3, 3] = found.target
    values = {
        "kind": KIND, "seed": seed, "table": found.table.tolist(),
        "base": found.T_tracker_base.tolist(), "tool_point": found.target.tolist(),
        "gears": found.gears.tolist(),
    }  # fmt: skip
    return BelievedArm(
        build_host_arm(found.table, found.T_tracker_base, T_flange_tool, found.gears),
        {FILE: toml_text(values, head=wrap(HEAD, 116))},
    )


def check_compensation(robot: RobotConfig, seed: int, row: Experiment) -> None:
    """Refuse a compensation that changes nothing in an experiment or cannot be used.

    Raises:
        PolishSimError: Saying why and what to do.
    """
    asked = robot.compensation
    if asked == NONE:
        return
    if not row.controlled:
        raise ConfigError(f"robot.compensation is for a tool on a path: leave it out of '{row.name}'.")
    if not robot.elastic:
        raise ConfigError("robot.compensation changes nothing on robot.arm = ideal: leave one of them out.")
    if asked != TRACKER:
        if not Path(asked).is_file():
            raise unknown_name("robot.compensation or file", asked, (NONE, TRACKER))
        if row.carried:
            raise ConfigError(
                f"robot.compensation = '{asked}' is of one arm: for two set it to tracker, or give "
                "--calibration a file of 'calibrate arm'."
            )
        if read_arm(Path(asked), seed) is None:
            raise InputError(
                f"'{asked}' is not of the arm of seed {seed}: run its own seed, or set "
                "robot.compensation = tracker. To try what another arm's figures do, take the line 'seed' "
                "out."
            )


@lru_cache(4)
def track_arm(robot: RobotConfig, head: HeadConfig, seed: int, q_start: tuple[float, ...]) -> ArmEstimate:
    """Measure the arm of a seed at rest around ``q_start`` (6,) [rad] and find how it is built; kept for the
    next cell."""
    model, real = robot_with_tool(Scenario(robot=robot, head=head)).compile(), robot.real
    rng = np.random.default_rng([seed, _STREAM])
    arm, table = resting_arm(real, seed, model), built_table(real, seed, model, np.array(q_start))
    built = ArmEstimate(table, np.eye(4), tool_on_flange()[:3, 3])
    q = q_start + AROUND * rng.uniform(-1.0, 1.0, (POSES, 6))
    seen = built.tracked(arm.arrive(q, rng), USUAL_NOISE, rng)
    tolerance = Tolerance(real.length_error_m, real.angle_error_rad)
    return fit_arm(TrackedArm(q, seen, arm.weight(q), real), None, tolerance)


def read_arm(file: Path, seed: int) -> ArmEstimate | None:
    """Read a compensation.toml; None: of the arm of another seed; InputError: no such file."""
    table = Calibration(file, read_toml(file, KIND, InputError))
    if table.values.get("kind") != KIND:
        raise InputError(f"'{file}' is no {FILE} of a run with robot.compensation = tracker.")
    if table.values.get("seed", seed) != seed:
        return None
    return ArmEstimate(
        table.numbers("table", (4, 6)), table.pose("base"), table.numbers("tool_point", (3,)),
        gears=table.numbers("gears", (6, 7)),
    )  # fmt: skip


# What the host believes to carry: from a calibration before every run, or from a file.


def believe_tool(cell: Cell, rng: np.random.Generator) -> None:
    """Let the host of a cell, not yet run, learn its tool as the scenario's ``payload`` section says.

    Without a file the tool is calibrated: this run's sensor, with its bias, noise, drift, filter and
    quantisation, is read at rest in the poses of ``calibrate payload`` and the same estimator fits the
    readings. The arm's way between the poses is not simulated; the drift of that time is.

    Raises:
        InputError: If the file cannot be used.
        CalibrationError: If the readings do not determine the tool.
    """
    config = cell.scenario.payload
    if config.file:
        mass, center = read_calibrated_tool(Path(config.file))
    else:
        estimate = fit_payload(readings_at_rest(cell, rng))
        mass, center = estimate.mass, estimate.center
    cell.compensate(mass, center)


def readings_at_rest(cell: Cell, rng: np.random.Generator) -> PayloadReadings:
    """Readings of a cell's sensor in the calibration's poses, the robot not simulated."""
    config = cell.scenario.payload
    poses = plan_payload_poses(config.poses)
    loads = weight_of(cell.carried, poses.R_base_sensor)
    sensor = fresh_sensor(cell.state.sensor)
    wrenches = read_at_rest(sensor, loads, poses.move_times, config.settle_s, config.average_s, rng)
    time = np.cumsum(poses.move_times + config.settle_s + config.average_s) - 0.5 * config.average_s
    return PayloadReadings(time, poses.R_base_sensor.copy(), wrenches)


# What a run learns from one before it: how deep the tool has to go at each place of the path, fed forward.
#
# Iterative learning control (Bristow, Tharayil and Alleyne, IEEE Control Systems 26(3), 96-114, 2006):
#
#     h(s) = z . (p - p_target) + (F_set - F) / k,     u += dh/ds ds/dt
#
# Position and force are what the host of the run before knew, k the springs as drawn. h holds the part as it
# lies and is bent, and what the gears err in that pose of the arm. It is low-passed without delay at
# sqrt(k/m) / 2 pi, m the mass the sensor carries: the gears' errors move that mass unseen by the encoders,
# and at that frequency its inertia takes all of the force out of the reading.

SPACING = 0.0005  #: Of the places at which it is learned [m]
SHORTEST_S = 0.5  #: A stretch in contact from which something is learned [s]
SAME = ("part", "robot", "head", "pad", "process", "smoothing", "faults")
"""Sections that decide what repeats."""
FREE = ("part.pose", "process.learn", "process.preston_1_pa")
"""Keys of these that may differ; where the part stands is compared by itself."""
FIGURE = "learned_from"  #: Figure of a run: how many before it, each learned from the one before


def check_learning(folder: str, label: str, controller: Controller) -> None:
    """Refuse a controller, of a ``label``, that cannot learn, and a run in a folder that cannot be learned
    from.

    Raises:
        InputError: Saying which and what to do.
    """
    if callable(getattr(controller, "prepare", None)):
        raise InputError(
            f"--learn is not for {label}: it prepares for the path itself and turns the "
            "tool by what it feels, so that its depths do not repeat. Take hybrid-pi, or a law of your own "
            "without prepare()."
        )
    record = read_record(Path(folder))
    if "host_depth_m" not in record.log.columns or record.path is None:
        raise InputError(
            f"nothing can be learned from '{folder}': it is no run of 'surface', or one of an older version."
        )
    if record.metrics.get("protective_stop"):
        raise InputError(
            f"'{folder}' {ending(record)} of its path, and a run that learned what led there would stop "
            "sooner: learn from one that did not stop."
        )


def read_lesson(scenario: Checked, path: ToolPath, reach: Reach) -> Lesson:
    """Read what the run ``process.learn`` learned about this path on this part.

    Raises:
        InputError: The folder is no run, or one of another path, place, part, arm, seed or setting.
    """
    from scipy.signal import butter, sosfiltfilt  # slow to import

    folder = scenario.process.learn
    record = read_record(Path(folder))
    keys = differences([record.scenario, scenario])
    before = record.path
    other = [key for key in keys if key.partition(".")[0] in SAME and key not in FREE]
    other += [] if record.scenario.seed == scenario.seed else ["seed"]
    if (
        before is None
        or before.positions_work.shape != path.positions_work.shape
        or not np.allclose(before.positions_work, path.positions_work, atol=1e-9)
    ):
        other.insert(0, "the path")
    if not np.allclose(record.metrics.get("T_base_work") or np.nan, reach.T_base_work, atol=1e-9):
        other.append("where the part stands")
    if other:
        raise InputError(
            f"the run '{folder}' differs from this one in {', '.join(other[:4])}: what it learned holds for "
            f"the same job alone. Repeat it with --config {Path(folder) / 'config.toml'}, its own --path if "
            "it had one, and --learn."
        )
    beliefs = scenario.controller.adaptive
    time, s = (record.log[name] for name in ("time_s", "path_s_m"))
    wanted = path.force_at(s, scenario.process.contact_force_n)
    reading = record.log["wrench_measured_tool"][:, 2]
    height = record.log["host_depth_m"] + (wanted - reading) / beliefs.stiffness_n_m
    rate = 1.0 / np.median(np.diff(time))
    highest = math.sqrt(beliefs.stiffness_n_m / beliefs.tool_mass_kg) / (2.0 * math.pi)
    low = butter(2, min(highest, 0.2 * rate), fs=rate, output="sos")
    places = np.arange(0.0, path.s[-1], SPACING)
    slope = np.zeros(len(places))
    for first, last in stretches(record.log.fed):
        if last + 1 - first < SHORTEST_S * rate:
            continue
        at, rows = np.unique(s[first : last + 1], return_index=True)
        learned = sosfiltfilt(low, height[first : last + 1])[rows]
        inside = (places >= at[0]) & (places <= at[-1])
        if inside.sum() > 1:
            slope[inside] = np.gradient(np.interp(places[inside], at, learned), SPACING)
    runs = 1 + int(np.nan_to_num(figure_of(record.metrics, FIGURE)))
    return Lesson(slope, SPACING, beliefs.command_delay_s, runs)
