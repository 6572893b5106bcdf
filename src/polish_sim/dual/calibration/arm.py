"""Tables of two arms, with their bases and the tracker's targets on their flanges, from tracked poses.

Each arm by least squares of where the tracker saw the target, with prior knowledge: the nominal table and how
far a built arm may be from it. That also fixes what no measurement shows, such as sliding three parallel axes
along themselves. Of arms with elastic joints whose weight is known, the gears are found along: how much each
winds up below, between and above its catalogue's knees, and its error by the rotor's angle, once and twice a
period.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools
from polish_sim.calibration.fit import Problem, solve
from polish_sim.calibration.tables import (
    JOINTS,
    XYZ_MM,
    Calibration,
    Kind,
    Measured,
    mm_texts,
    read_table,
    write_table,
)
from polish_sim.config import RealArmConfig
from polish_sim.dual.calibration.bases import ROBOTS, robots_of
from polish_sim.dual.calibration.matched_points import kabsch, moved_frame, point_slopes, relative_frame
from polish_sim.errors import CalibrationError
from polish_sim.motion.kinematics import NOMINAL, link_frames, table_slopes
from polish_sim.spatial import apply
from polish_sim.tables import csv_text

LEAST_POSES = 20
FOLDS = 5  #: Parts of the poses that are predicted from the others in turn
USUAL_NOISE = 3e-5  #: Of a laser tracker, per coordinate [m]
_PLACEMENT, _GEARS = 9, 42
CATALOGUE: Final = RealArmConfig()  #: Of the gears: where their stiffness changes, and their ratio
_RIGID: Final = np.zeros((6, 7))
_LIKELY: Final = np.repeat([[*[1e-4] * 3, *[3e-4] * 4], [*[6e-4] * 3, *[3e-4] * 4]], 3, axis=0)
"""What gears may do: wind up [rad/(N m)], err [rad], standard deviations, shape (6, 7)."""
ARM: Final = Kind(
    "arm",
    "two arms",
    "Two arms' Denavit-Hartenberg tables as found: joint offsets [rad], d [m], a [m], alpha [rad], six "
    "each, and transform, the follower's base in the master's, which goes with them. `pair` names the two "
    "robots it is true for. true_...: of simulated robots only.",
)
FAR_M, FAR_RAD = 0.01, 0.02  #: No built arm is farther off its table than this [m], [rad]
JOINTS_DEG: Final = tuple(f"q{k}_deg" for k in range(1, 7))
TURNS = 2.0  #: No joint of the arm turns farther, so that a larger angle is in degrees [full turns]


class TrackedArm(NamedTuple):
    """Poses of one arm and where a tracker saw the target on its flange."""

    q: Array  #: Joint angles as read [rad], shape (n, 6)
    seen: Array  #: Target, tracker frame [m], shape (n, 3)
    weight: Array | None = None  #: Torques that hold the arm's weight [N m], shape (n, 6); None: rigid joints

    def rows(self, kept: Bools) -> TrackedArm:
        """Some of the poses."""
        return TrackedArm(self.q[kept], self.seen[kept], None if self.weight is None else self.weight[kept])


class Tolerance(NamedTuple):
    """How far a built arm may be from its table, standard deviations."""

    length: float = 5e-4  #: Of d and a [m]
    angle: float = float(np.radians(0.02))  #: Of joint offsets and alpha [rad]


class ArmEstimate(NamedTuple):
    """An arm as calibrated, or as built."""

    table: Array  #: Shape (4, 6)
    T_tracker_base: Array  #: Shape (4, 4)
    target: Array  #: On the flange [m], shape (3,)
    residuals: Array  #: Seen minus predicted [m], shape (n, 3)
    #: Of the base's origin [m] and rotation [rad], tracker axes, whatever the table is, (6, 6)
    base_covariance: Array
    gears: Array = _RIGID  #: What joints turn by a unit of each column of `gear_columns`, shape (6, 7)

    def links_at(self, q: Array, weight: Array | None = None) -> Array:
        """Angles of the links (n, 6) [rad] with the encoders at ``q``, under torques that hold the weight (n,
        6)."""
        return q if weight is None else q + np.sum(gear_columns(q, weight) * self.gears, axis=2)

    def target_at(self, q: Array, weight: Array | None = None) -> Array:
        """Where the target is, tracker frame [m], shape (n, 3)."""
        T = self.T_tracker_base @ link_frames(self.links_at(q, weight), self.table)[:, 6]
        return np.asarray(T[:, :3, :3] @ self.target + T[:, :3, 3])


def gear_columns(q: Array, weight: Array) -> Array:
    """What turns the links off their encoders: torque by parts between the knees, error once and twice, (n,
    6, 7)."""
    size, way = np.abs(weight), -np.sign(weight)
    first, second = np.array(CATALOGUE.knee_1_nm), np.array(CATALOGUE.knee_2_nm)
    parts = (np.minimum(size, first), np.clip(size, first, second) - first, np.maximum(size - second, 0.0))
    phase = 2.0 * CATALOGUE.gear_ratio * q
    waves = (np.sin(phase), np.cos(phase), np.sin(2.0 * phase), np.cos(2.0 * phase))
    return np.stack([*(way * part for part in parts), *waves], axis=2)


def fit_arm(tracked: TrackedArm, noise: float, tolerance: Tolerance | None = None) -> ArmEstimate:
    """The most probable table, base and target of an arm, from twenty poses or more with all joints well
    moved.

    ``noise``: of one coordinate of the tracker [m]; ``tolerance``: of the nominal table. Fewer poses:
    CalibrationError.
    """
    tolerance = tolerance or Tolerance()
    spread = np.repeat([tolerance.angle, tolerance.length, tolerance.length, tolerance.angle], 6)
    gears = np.zeros(_GEARS) if tracked.weight is None else _LIKELY.ravel()
    return _refined(tracked, np.concatenate([np.full(_PLACEMENT, np.inf), spread, gears]), max(noise, 1e-9))


def fit_placement(tracked: TrackedArm) -> ArmEstimate:
    """Base and target alone, the table taken as nominal: the residual is the table's error."""
    return _refined(tracked, np.concatenate([np.full(_PLACEMENT, np.inf), np.zeros(24 + _GEARS)]), 1.0)


def _refined(tracked: TrackedArm, spread: Array, noise: float) -> ArmEstimate:
    """Least squares; ``spread``: standard deviation of each unknown about its nominal value (75,), 0 keeps it
    there."""
    if len(tracked.q) < LEAST_POSES:
        raise CalibrationError(
            f"{len(tracked.q)} poses cannot determine an arm's table (33 unknowns): give {LEAST_POSES} or "
            "more, 60 are good."
        )
    free = spread > 0.0
    prior = 1.0 / spread[free]

    def residuals(arm: ArmEstimate) -> Array:
        off = np.concatenate([np.zeros(_PLACEMENT), (arm.table - NOMINAL).ravel(), arm.gears.ravel()])[free]
        left = arm.target_at(tracked.q, tracked.weight) - tracked.seen
        return np.concatenate([left.ravel() / noise, prior * off])[:, None]

    def slopes(arm: ArmEstimate) -> Array:
        J = _slopes(arm, tracked)[:, :, free].reshape(-1, int(free.sum()))
        return np.concatenate([J / noise, np.diag(prior)])[:, None]

    def moved(arm: ArmEstimate, step: Array) -> ArmEstimate:
        whole = np.zeros(len(free))
        whole[free] = step
        T = moved_frame(arm.T_tracker_base, whole[:6])
        return arm._replace(
            table=arm.table + whole[9:33].reshape(4, 6), T_tracker_base=T, target=arm.target + whole[6:9],
            gears=arm.gears + whole[33:].reshape(6, 7),
        )  # fmt: skip

    arm = solve(Problem(residuals, slopes, moved), _start(tracked))
    rows = slopes(arm)[:, 0]
    covariance = np.asarray(np.linalg.pinv(rows.T @ rows)[:6, :6], dtype=np.float64)
    return arm._replace(
        residuals=tracked.seen - arm.target_at(tracked.q, tracked.weight), base_covariance=covariance
    )


def _start(tracked: TrackedArm) -> ArmEstimate:
    """The nominal arm, the target on the flange's origin, the base by matched points."""
    own = link_frames(tracked.q)[:, 6, :3, 3]
    stretch = float(np.linalg.norm(np.std(tracked.seen, axis=0)) / np.linalg.norm(np.std(own, axis=0)))
    if not 0.5 < stretch < 2.0:
        raise CalibrationError(
            f"the tracker saw the target move {stretch:.3g} times as far as the arm did: are units mixed "
            "(mm, m)?"
        )
    T = kabsch(tracked.seen, own)
    return ArmEstimate(NOMINAL, T, np.zeros(3), tracked.seen - apply(T, own), np.zeros((6, 6)))


def _slopes(arm: ArmEstimate, tracked: TrackedArm) -> Array:
    """Derivative of the target by base (6), target (3), table (24) and gears (42), shape (n, 3, 75)."""
    frames = arm.T_tracker_base @ link_frames(arm.links_at(tracked.q, tracked.weight), arm.table)
    R = frames[:, 6, :3, :3]
    points = R @ arm.target + frames[:, 6, :3, 3]
    table, gears = table_slopes(frames, points), np.zeros((len(points), 3, 6, 7))
    if tracked.weight is not None:
        gears = table[:, :, :6, None] * gear_columns(tracked.q, tracked.weight)[:, None]
    by_gears = gears.reshape(len(points), 3, _GEARS)
    return np.concatenate([point_slopes(arm.T_tracker_base, points), R, table, by_gears], axis=2)


class PairTables(NamedTuple):
    """Two arms as they are built, robot by robot."""

    arms: Mapping[str, ArmEstimate]

    @property
    def tables(self) -> Mapping[str, Array]:
        """Each (4, 6)."""
        return {robot: arm.table for robot, arm in self.arms.items()}

    @property
    def bases(self) -> tuple[Array, Array]:
        """The follower's base in the master's, (4, 4), and its covariance, (6, 6): with these tables and no
        others."""
        master, follower = (self.arms[robot] for robot in ROBOTS)
        return relative_frame(
            master.T_tracker_base, master.base_covariance, follower.T_tracker_base, follower.base_covariance
        )

    @property
    def T_master_follower(self) -> Array:
        """The follower's base in the master's, shape (4, 4)."""
        return self.bases[0]


def fit_pair(tracked: Mapping[str, TrackedArm], noise: float | None, tolerance: Tolerance) -> PairTables:
    """Both arms, each from its own poses; ``noise``: of one coordinate [m], None: a good tracker's, then the
    residuals'.

    Raises CalibrationError for too few poses or mixed units.
    """
    found = {
        robot: fit_arm(one, USUAL_NOISE if noise is None else noise, tolerance)
        for robot, one in tracked.items()
    }
    if noise is None:
        found = {
            robot: fit_arm(one, residual_rms([found[robot]]), tolerance) for robot, one in tracked.items()
        }
    return PairTables(found)


def held_out_rms(tracked: Mapping[str, TrackedArm], noise: float, tolerance: Tolerance) -> float:
    """Distance from where the tracker saw the target to where arms found from the other poses say, rms [m].

    Undefined (NaN) where too few poses would be left to find an arm.
    """
    if min(len(one.q) for one in tracked.values()) < FOLDS / (FOLDS - 1) * LEAST_POSES:
        return math.nan
    squares: list[Array] = []
    for one in tracked.values():
        fold = np.arange(len(one.q)) % FOLDS
        for k in range(FOLDS):
            found, left = fit_arm(one.rows(fold != k), noise, tolerance), one.rows(fold == k)
            squares.append(np.sum((left.seen - found.target_at(left.q, left.weight)) ** 2, axis=1))
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def pair_figures(
    tracked: Mapping[str, TrackedArm], found: PairTables, tolerance: Tolerance
) -> dict[str, Any]:
    """A calibration under the names of metrics.json.

    residual_rms_m is of one coordinate, nominal_rms_m the distance left if only base and target are fitted,
    heldout_rms_m the distance in poses that were left out in turn, transform T_master_follower.
    """
    noise = residual_rms(list(found.arms.values()))
    nominal = [np.sum(fit_placement(one).residuals ** 2, axis=1) for one in tracked.values()]
    return {
        "poses": sum(len(one.q) for one in tracked.values()),
        "residual_rms_m": noise,
        "nominal_rms_m": float(np.sqrt(np.mean(np.concatenate(nominal)))),
        "heldout_rms_m": held_out_rms(tracked, noise, tolerance),
        "transform": found.T_master_follower.tolist(),
    }


def residual_rms(arms: list[ArmEstimate]) -> float:
    """Of one coordinate of a pose [m]."""
    return float(np.sqrt(np.mean(np.concatenate([arm.residuals.ravel() for arm in arms]) ** 2)))


class CalibratedArms(NamedTuple):
    """Two arms on file."""

    tables: Mapping[str, Array]  #: Robot by robot, each (4, 6)
    T_master_follower: Array  #: Shape (4, 4)
    covariance: Array  #: Of its origin [m] and rotation [rad], master axes, shape (6, 6)
    true_tables: Mapping[str, Array] | None  #: As the arms really are, if they are simulated
    T_true: Array | None  #: Where the follower's base really is then, shape (4, 4)


def write_arm_calibration(file: Path, found: PairTables, pair: str, true: PairTables | None = None) -> None:
    """Write calibration.toml; ``pair`` names the two robots, ``true`` are the tables of simulated ones."""
    values: dict[str, Any] = {"pair": pair}
    for prefix, arms in (("", found), ("true_", true)):
        if arms is not None:
            values[f"{prefix}transform"] = arms.T_master_follower.tolist()
            values |= {f"{prefix}{robot}_table": arms.tables[robot].tolist() for robot in ROBOTS}
    values |= {f"{robot}_gears": arm.gears.tolist() for robot, arm in found.arms.items() if arm.gears.any()}
    write_table(file, ARM, values | {"covariance": found.bases[1].tolist()})


def read_arm_calibration(file: Path, pair: str) -> CalibratedArms:
    """Read both arms' tables from a calibration.toml of `calibrate arm`, for the robots named ``pair``.

    Raises:
        InputError: No such file, not the calibration of arms, or a value that cannot be.
        CalibrationError: The calibration of another pair of robots, or of arms of another make.
    """
    table = read_table(file, ARM)
    table.refuse_other_pair(pair)
    simulated = "true_transform" in table.values
    return CalibratedArms(
        _tables(table, ""),
        table.pose("transform"),
        table.numbers("covariance", (6, 6)),
        _tables(table, "true_") if simulated else None,
        table.pose("true_transform") if simulated else None,
    )


def _tables(read: Calibration, prefix: str) -> dict[str, Array]:
    tables = {robot: read.numbers(f"{prefix}{robot}_table", (4, 6)) for robot in ROBOTS}
    limits = np.array([FAR_RAD, FAR_M, FAR_M, FAR_RAD])[:, None]
    for robot, table in tables.items():
        if (np.abs(table - NOMINAL) > limits).any():
            raise CalibrationError(
                f"'{read.file}': {prefix}{robot}_table is more than {1e3 * FAR_M:g} mm or "
                f"{np.degrees(FAR_RAD):.1f} deg off the maker's table: it is another robot's, or its rows or "
                "units are mixed (offsets, d, a, alpha; rad and m)."
            )
    return tables


def read_tracked(file: Path) -> Mapping[str, TrackedArm]:
    """Read where a tracker saw the targets on both flanges, pose by pose.

    Columns: robot; q1_rad to q6_rad, or q1_deg to q6_deg; x_mm, y_mm, z_mm (or in m) of the target. Raises
    InputError for a missing file, column or robot, mixed units or an invalid value.
    """
    columns = Measured.read(file, "measurement", "tracked poses of two arms")
    robots = robots_of(columns)
    given = JOINTS_DEG if JOINTS_DEG[0] in columns.texts else JOINTS
    columns.need(given, "joint angles as the robot reads them, all in rad or all in deg")
    q = columns.numbers(given) * (np.pi / 180.0 if given is JOINTS_DEG else 1.0)
    columns.refuse(
        np.abs(q).max(axis=1) > TURNS * 2.0 * np.pi,
        lambda row: (
            f"a joint angle of {np.abs(q[row]).max():.4g} rad is more than the joints turn. Are they in "
            "degrees? Then name the columns q1_deg to q6_deg."
        ),
    )
    seen = columns.points("", "the target's position seen by the tracker")
    return {robot: TrackedArm(q[robots == robot], seen[robots == robot]) for robot in ROBOTS}


def tracked_table(tracked: Mapping[str, TrackedArm], found: PairTables) -> str:
    """The poses with what is left of each after the fit, as CSV that `read_tracked` reads."""
    names = ["robot", *JOINTS, *XYZ_MM, *(f"residual_{name}" for name in XYZ_MM)]
    rows = []
    for robot, one in tracked.items():
        for q, seen, left in zip(one.q, one.seen, found.arms[robot].residuals, strict=True):
            rows.append([robot, *(f"{value:.12g}" for value in q), *mm_texts((*seen, *left))])
    return csv_text(names, rows)
