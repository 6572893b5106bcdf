"""Readings of a robot's own poses as CSV: in from a user's file, out as residuals.csv, which reads back (layer 8b)."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.calibration.csv_columns import QUATERNION, read_columns
from polish_sim.calibration.payload import PayloadEstimate
from polish_sim.calibration.readings import PayloadReadings

Array = NDArray[np.float64]

TIME: Final = "time_s"
WRENCH: Final = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
JOINTS: Final = tuple(f"q{joint}_rad" for joint in range(1, 7))


def read_readings(file: Path) -> PayloadReadings:
    """Read poses and readings of a real robot; blank lines and lines that begin with # are left out.

    Columns in any order, others are ignored: the orientation of the sensor in a frame with z up, as ``qw..qz``, as a
    rotation vector ``rx_rad..rz_rad`` (what a UR shows) or as a matrix ``r11..r33``; the reading ``fx_n..tz_nm`` in
    sensor axes about the sensor's origin; ``time_s`` if the drift is asked for.

    Raises:
        InputError: No such file, a column missing, a value that is none, an orientation that is none; names the line.
    """
    columns = read_columns(file, "reading", "poses and readings")
    columns.need(WRENCH, "the reading in sensor axes, [N] and [N m]")
    R_base_sensor = columns.rotations("the sensor")
    time = columns.numbers([TIME])[:, 0] if TIME in columns.texts else np.zeros(len(columns))
    return PayloadReadings(time, R_base_sensor, columns.numbers(WRENCH))


def residual_table(readings: PayloadReadings, estimate: PayloadEstimate, q: Array | None = None) -> str:
    """Readings, how far each is from the fit, and whether it was used, as CSV that ``read_readings`` takes.

    Args:
        readings: The readings.
        estimate: The fit.
        q: Joint angles of the poses, if known [rad], shape (n, 6).
    """
    turns = Rotation.from_matrix(readings.R_base_sensor).as_quat(canonical=True, scalar_first=True)
    names = ["reading", TIME, *QUATERNION, *WRENCH, *(f"residual_{name}" for name in WRENCH), "used"]
    names += [] if q is None else JOINTS
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(names)
    for k in range(len(readings)):
        numbers = [readings.time[k], *turns[k], *readings.wrenches[k], *estimate.residuals[k]]
        row: list[Any] = [k + 1, *(f"{value:.9g}" for value in numbers), int(estimate.used[k])]
        table.writerow(row + ([] if q is None else [f"{value:.9g}" for value in q[k]]))
    return out.getvalue()
