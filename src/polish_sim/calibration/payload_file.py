"""A payload's files: readings as CSV in and out, calibration.toml out, and the tool a run takes from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array, rms
from polish_sim.calibration.payload import BIAS, GRAVITY, PayloadEstimate, PayloadReadings
from polish_sim.calibration.tables import (
    JOINTS,
    QUATERNION,
    Measured,
    Quantity,
    quaternions_of,
    read_table,
    write_table,
)
from polish_sim.errors import InputError
from polish_sim.tables import csv_text

PAYLOAD = Quantity(
    "payload",
    "a payload",
    "The tool behind the wrist sensor and the sensor's bias, with standard deviations (_std), from readings "
    "at rest. Sensor axes; torques about the sensor's origin. A reading of the idle tool: f = m g u + b, t "
    "= c x (m g u) + b_t, u against gravity. Covariance in the order of: mass, first moment xyz [kg m], "
    "force bias xyz, torque bias xyz.",
)
TIME = "time_s"
OF_SENSOR = ("bias_n", "bias_nm", "drift_n_s", "drift_nm_s")
WRENCH = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")


class CalibratedTool(NamedTuple):
    """What a host needs to compensate the tool's weight."""

    mass: float  #: [kg]
    center: Array  #: Centre of mass in the sensor frame [m], shape (3,)


def estimate_figures(estimate: PayloadEstimate) -> dict[str, Any]:
    """An estimate under the names of calibration.toml and metrics.json."""
    figures: dict[str, Any] = {
        "mass_kg": estimate.mass,
        "mass_kg_std": estimate.mass_std,
        "center_m": estimate.center.tolist(),
        "center_m_std": estimate.center_std.tolist(),
    }
    of_sensor = (column[BIAS.start :].reshape(-1, 3) for column in (estimate.theta, estimate.std))
    for name, value, std in zip(OF_SENSOR, *of_sensor, strict=False):
        figures |= {name: value.tolist(), f"{name}_std": std.tolist()}
    if len(estimate.theta) > 10:
        figures["drift_zero_s"] = estimate.zero_time
    return figures | {
        "mass_std_relative": estimate.mass_std / estimate.mass,
        "center_std_max_m": float(estimate.center_std.max()),
        "residual_rms_n": rms(estimate.residuals[estimate.used, :3]),
        "residual_rms_nm": rms(estimate.residuals[estimate.used, 3:]),
        "readings": len(estimate.used),
        "outliers": (np.flatnonzero(~estimate.used) + 1).tolist(),
        "condition": estimate.condition,
    }


def write_calibration(file: Path, estimate: PayloadEstimate) -> None:
    """Write calibration.toml."""
    figures = estimate_figures(estimate) | {
        "gravity_m_s2": GRAVITY,
        "covariance": estimate.covariance.tolist(),
    }
    write_table(file, PAYLOAD, figures)


def read_calibrated_tool(file: Path) -> CalibratedTool:
    """Mass and centre from a calibration.toml; InputError if it is not the calibration of a payload."""
    table = read_table(file, PAYLOAD)
    mass = float(table.numbers("mass_kg", ()))
    if not 0.0 < mass < 1e3:
        raise InputError(f"'{file}': mass_kg is {mass!r}, wanted a number above 0 [kg].")
    return CalibratedTool(mass, table.numbers("center_m", (3,)))


def read_readings(file: Path) -> PayloadReadings:
    """Read poses and readings of a real robot; blank lines and lines that begin with # are left out.

    Columns in any order, others are ignored: the orientation of the sensor in a frame with z up, as
    ``qw..qz``, as a rotation vector ``rx_rad..rz_rad`` (what a UR shows) or as a matrix ``r11..r33``; the
    reading ``fx_n..tz_nm`` in sensor axes about the sensor's origin; ``time_s`` if the drift is asked for.
    Raises InputError naming the line.
    """
    columns = Measured.read(file, "reading", "poses and readings")
    columns.need(WRENCH, "the reading in sensor axes, [N] and [N m]")
    R_base_sensor = columns.rotations("the sensor")
    time = columns.column(TIME) if TIME in columns.texts else np.zeros(len(columns))
    return PayloadReadings(time, R_base_sensor, columns.numbers(WRENCH))


def residual_table(readings: PayloadReadings, estimate: PayloadEstimate, q: Array | None = None) -> str:
    """Readings, residuals and whether each was used, as CSV that ``read_readings`` takes; ``q`` (n, 6) if
    known."""
    turns = quaternions_of(readings.R_base_sensor)
    names = ["reading", TIME, *QUATERNION, *WRENCH, *(f"residual_{name}" for name in WRENCH), "used"]
    rows = []
    for k in range(len(readings)):
        numbers = [readings.time[k], *turns[k], *readings.wrenches[k], *estimate.residuals[k]]
        joints = [] if q is None else [f"{value:.9g}" for value in q[k]]
        rows.append([k + 1, *(f"{value:.9g}" for value in numbers), int(estimate.used[k]), *joints])
    return csv_text(names + ([] if q is None else [*JOINTS]), rows)
