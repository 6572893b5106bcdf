"""Two arms from tracked poses, in one frame; their calibration.toml and the CSV of the poses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Figures, rms_length
from polish_sim.calibration.arm import (
    LEAST_POSES,
    ArmEstimate,
    Tolerance,
    TrackedArm,
    fit_arm,
    fit_placement,
    residual_rms,
)
from polish_sim.calibration.matched_points import relative_frame
from polish_sim.calibration.tables import (
    JOINTS,
    XYZ_MM,
    Calibration,
    Measured,
    Quantity,
    mm_texts,
    read_table,
    write_table,
)
from polish_sim.dual.calibration.bases import ROBOTS, robots_of
from polish_sim.dual.calibration.tool import refuse_far_off
from polish_sim.errors import CalibrationError
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.tables import csv_text

FOLDS = 5  #: Parts of the poses that are predicted from the others in turn
ARM = Quantity(
    "arm",
    "Two arms' Denavit-Hartenberg tables as found: joint offsets [rad], d [m], a [m], alpha [rad], six "
    "each, and transform, the follower's base in the master's, which goes with them. `pair` names the two "
    "robots it is true for. true_...: of simulated robots only.",
)
FAR_M, FAR_RAD = 0.01, 0.02  #: No built arm is farther off its table than this [m], [rad]
JOINTS_DEG = tuple(f"q{k}_deg" for k in range(1, 7))
TURNS = 2.0  #: No joint of the arm turns farther, so that a larger angle is in degrees [full turns]


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

    Raises CalibrationError for too few poses, mixed units, or poses that no arm near its table explains.
    """
    arms = {robot: fit_arm(one, noise, tolerance) for robot, one in tracked.items()}
    for robot, arm in arms.items():
        refuse_far_off(
            arm.residuals,
            f"no arm near the maker's table fits the poses of the {robot}",
            "Are columns swapped, is a sign lost, are units mixed, or joints in another order? Give joint "
            "angles as the robot reads them, and where the tracker saw the target then.",
        )
    return PairTables(arms)


def held_out_rms(tracked: Mapping[str, TrackedArm], noise: float, tolerance: Tolerance) -> float:
    """Distance from where the tracker saw the target to where arms found from the other poses say, rms [m].

    Undefined (NaN) where too few poses would be left to find an arm.
    """
    if min(len(one.q) for one in tracked.values()) < FOLDS / (FOLDS - 1) * LEAST_POSES:
        return math.nan
    off: list[Array] = []
    for one in tracked.values():
        fold = np.arange(len(one.q)) % FOLDS
        for k in range(FOLDS):
            found = fit_arm(one.rows(fold != k), noise, tolerance)
            off.append(found.left(one.rows(fold == k)))
    return rms_length(np.concatenate(off))


def pair_figures(tracked: Mapping[str, TrackedArm], found: PairTables, tolerance: Tolerance) -> Figures:
    """A calibration under the names of metrics.json.

    residual_rms_m is of one coordinate, nominal_rms_m the distance left if only base and target are fitted,
    heldout_rms_m the distance in poses that were left out in turn, transform T_master_follower.
    """
    noise = residual_rms(list(found.arms.values()))
    nominal = [fit_placement(one).residuals for one in tracked.values()]
    return {
        "poses": sum(len(one.q) for one in tracked.values()),
        "residual_rms_m": noise,
        "nominal_rms_m": rms_length(np.concatenate(nominal)),
        "heldout_rms_m": held_out_rms(tracked, noise, tolerance),
        "transform": found.T_master_follower,
    }


class CalibratedArms(NamedTuple):
    """Two arms on file."""

    tables: Mapping[str, Array]  #: Robot by robot, each (4, 6)
    T_master_follower: Array  #: Shape (4, 4)
    covariance: Array  #: Of its origin [m] and rotation [rad], master axes, shape (6, 6)
    true_tables: Mapping[str, Array] | None  #: As the arms really are, if they are simulated
    T_true: Array | None  #: Where the follower's base really is then, shape (4, 4)
    gears: Mapping[str, Array]  #: As found, each as `ArmEstimate.gears`


def write_arm_calibration(file: Path, found: PairTables, pair: str, true: PairTables | None) -> None:
    """Write calibration.toml; ``pair`` names the two robots, ``true`` are the tables of simulated ones."""
    values: dict[str, Any] = {"pair": pair}
    for prefix, arms in (("", found), ("true_", true)):
        if arms is not None:
            values[f"{prefix}transform"] = arms.T_master_follower
            values |= {f"{prefix}{robot}_table": arms.tables[robot] for robot in ROBOTS}
    values |= {f"{robot}_gears": arm.gears for robot, arm in found.arms.items() if arm.gears.any()}
    write_table(file, ARM, values | {"covariance": found.bases[1]})


def read_arm_calibration(file: Path, pair: str) -> CalibratedArms:
    """Read both arms' tables from a calibration.toml of `calibrate arm`, for the robots named ``pair``.

    Raises:
        InputError: No such file, not the calibration of arms, or a value that cannot be.
        CalibrationError: The calibration of another pair of robots, or of arms of another make.
    """
    table = read_table(file, ARM.name)
    table.refuse_other_pair(pair)
    simulated = "true_transform" in table.values
    return CalibratedArms(
        _tables(table, ""),
        table.pose("transform"),
        table.numbers("covariance", (6, 6)),
        _tables(table, "true_") if simulated else None,
        table.pose("true_transform") if simulated else None,
        {robot: _gears(table, robot) for robot in ROBOTS},
    )


def _gears(read: Calibration, robot: str) -> Array:
    """Zeros in a file of arms whose joints were taken for rigid."""
    name = f"{robot}_gears"
    return read.numbers(name, (6, 7)) if name in read.values else np.zeros((6, 7))


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
    rows = [
        [robot, *(f"{value:.12g}" for value in q), *mm_texts((*seen, *left))]
        for robot, one in tracked.items()
        for q, seen, left in zip(one.q, one.seen, found.arms[robot].residuals, strict=True)
    ]
    return csv_text(names, rows)
