"""Tracked poses of two arms as CSV (file -> poses -> file) (layer 8b)."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from polish_sim.calibration.arm.fit import TrackedArm
from polish_sim.calibration.arm.pair import PairTables
from polish_sim.calibration.csv_columns import read_columns
from polish_sim.calibration.frames import ROBOTS
from polish_sim.calibration.frames.measurements_file import robots_of
from polish_sim.errors import InputError

JOINTS_RAD = tuple(f"q{k}_rad" for k in range(1, 7))
JOINTS_DEG = tuple(f"q{k}_deg" for k in range(1, 7))
TURNS = 2.0
"""No joint of a UR5e turns farther, so that a larger angle is in degrees [full turns]."""


def read_tracked(file: Path) -> Mapping[str, TrackedArm]:
    """Read where a tracker saw the targets on both flanges, pose by pose.

    Args:
        file: The CSV: robot; q1_rad to q6_rad, or q1_deg to q6_deg; x_mm, y_mm, z_mm (or in m) of the target.

    Raises:
        InputError: No such file, a column or a robot missing, units mixed, a value that is none.
    """
    columns = read_columns(file, "measurement", "tracked poses of two arms")
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
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(names)
    for robot, one in tracked.items():
        for q, seen, left in zip(one.q, one.seen, found.arms[robot].residuals, strict=True):
            numbers = [f"{value:.12g}" for value in q] + [f"{1e3 * value:.9g}" for value in (*seen, *left)]
            writer.writerow([robot, *numbers])
    return out.getvalue()
