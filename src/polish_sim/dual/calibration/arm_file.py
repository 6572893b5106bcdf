"""Files of two arms' tables: tracked poses as CSV in and out, and calibration.toml."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.calibration.tables import Calibration, Kind, Measured, read_table, write_table
from polish_sim.dual.calibration.arm import PairTables, TrackedArm
from polish_sim.dual.calibration.base_file import robots_of
from polish_sim.dual.calibration.measurements import ROBOTS
from polish_sim.errors import CalibrationError, InputError
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.tables import csv_text

ARM: Final = Kind(
    "arm",
    "two arms",
    "Two arms' Denavit-Hartenberg tables as found: joint offsets [rad], d [m], a [m], alpha [rad], six each, and "
    "transform, the follower's base in the master's, which goes with them. `pair` names the two robots it is true for. "
    "true_...: of simulated robots only.",
)
FAR_M, FAR_RAD = 0.01, 0.02
"""No built UR5e is farther off its table than this [m], [rad]."""
JOINTS_RAD = tuple(f"q{k}_rad" for k in range(1, 7))
JOINTS_DEG = tuple(f"q{k}_deg" for k in range(1, 7))
TURNS = 2.0
"""No joint of a UR5e turns farther, so that a larger angle is in degrees [full turns]."""


class CalibratedArms(NamedTuple):
    """Two arms on file."""

    tables: Mapping[str, Array]
    """Robot by robot, each (4, 6)."""
    T_master_follower: Array
    """Shape (4, 4)."""
    covariance: Array
    """Of its origin [m] and rotation [rad], master axes, shape (6, 6)."""
    true_tables: Mapping[str, Array] | None
    """As the arms really are, if they are simulated."""
    T_true: Array | None
    """Where the follower's base really is then, shape (4, 4)."""


def write_arm_calibration(file: Path, found: PairTables, pair: str, true: PairTables | None = None) -> None:
    """Write calibration.toml; ``pair`` names the two robots, ``true`` are the tables of simulated ones."""
    values: dict[str, Any] = {"pair": pair}
    for prefix, arms in (("", found), ("true_", true)):
        if arms is not None:
            values[f"{prefix}transform"] = arms.T_master_follower.tolist()
            values |= {f"{prefix}{robot}_table": arms.tables[robot].tolist() for robot in ROBOTS}
    write_table(file, ARM, values | {"covariance": found.bases[1].tolist()})


def read_arm_calibration(file: Path, pair: str) -> CalibratedArms:
    """Read two arms' tables.

    Args:
        file: A calibration.toml of `calibrate arm`.
        pair: The robots that are to run, as the calibration names them.

    Raises:
        InputError: No such file, not the calibration of arms, or a value that cannot be.
        CalibrationError: The calibration of another pair of robots, or of arms that are no UR5e.
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
                f"'{read.file}': {prefix}{robot}_table is more than {1e3 * FAR_M:g} mm or {np.degrees(FAR_RAD):.1f} "
                "deg off the UR5e's: it is another robot's, or its rows or units are mixed (offsets, d, a, alpha; rad "
                "and m)."
            )
    return tables


def read_tracked(file: Path) -> Mapping[str, TrackedArm]:
    """Read where a tracker saw the targets on both flanges, pose by pose.

    Args:
        file: The CSV: robot; q1_rad to q6_rad, or q1_deg to q6_deg; x_mm, y_mm, z_mm (or in m) of the target.

    Raises:
        InputError: No such file, a column or a robot missing, units mixed, a value that is none.
    """
    columns = Measured.read(file, "measurement", "tracked poses of two arms")
    robots = robots_of(columns)
    given = JOINTS_DEG if JOINTS_DEG[0] in columns.texts else JOINTS_RAD
    columns.need(given, "joint angles as the robot reads them, all in rad or all in deg")
    q = columns.numbers(given) * (np.pi / 180.0 if given is JOINTS_DEG else 1.0)
    wrong = np.abs(q).max(axis=1) > TURNS * 2.0 * np.pi
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"'{file}', {columns.place(row)}: a joint angle of {np.abs(q[row]).max():.4g} rad is more than the joints "
            "turn. Are they in degrees? Then name the columns q1_deg to q6_deg."
        )
    seen = columns.points("", "the target's position seen by the tracker")
    return {robot: TrackedArm(q[robots == robot], seen[robots == robot]) for robot in ROBOTS}


def tracked_table(tracked: Mapping[str, TrackedArm], found: PairTables) -> str:
    """The poses with what is left of each after the fit, as CSV that `read_tracked` reads."""
    names = ["robot", *JOINTS_RAD, "x_mm", "y_mm", "z_mm", "residual_x_mm", "residual_y_mm", "residual_z_mm"]
    rows = []
    for robot, one in tracked.items():
        for q, seen, left in zip(one.q, one.seen, found.arms[robot].residuals, strict=True):
            numbers = [f"{value:.12g}" for value in q] + [f"{1e3 * value:.9g}" for value in (*seen, *left)]
            rows.append([robot, *numbers])
    return csv_text(names, rows)
