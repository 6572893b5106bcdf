"""Files of calibrations: a user's CSV of lengths and orientations, and calibration.toml of every kind."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array, norms, rms
from polish_sim.calibration.payload import BIAS, GRAVITY, PayloadEstimate, PayloadReadings
from polish_sim.errors import CalibrationError, InputError
from polish_sim.spatial import ROTATION_TOLERANCE, matrices, no_rotations, rotations_from_vectors, transform
from polish_sim.tables import Columns, csv_text
from polish_sim.toml_text import read_toml, toml_text

QUATERNION = ("qw", "qx", "qy", "qz")
ROTATION_VECTOR = ("rx_rad", "ry_rad", "rz_rad")
MATRIX = ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33")
JOINTS = tuple(f"q{joint}_rad" for joint in range(1, 7))
XYZ_MM = ("x_mm", "y_mm", "z_mm")
UNITS: Mapping[str, float] = {"m": 1.0, "mm": 1e-3}
FULL_TURN = 2.0 * np.pi + 0.01  #: A rotation vector is no longer than this [rad]
_LARGEST_RATIO = 100.0  # of a line's distance and that of the middle one
REACH = (0.02, 5.0)  #: From any robot's base to its flange or tip, in the middle of all lines [m]


class Measured(Columns):
    """Columns of measurements: lengths with their unit, orientations in three forms."""

    def points(self, prefix: str, what: str) -> Array:
        """Points from columns ``<prefix>x_mm`` to ``<prefix>z_mm``, or the same in metres (``_m``) [m], shape
        (n, 3).

        Raises InputError for a missing column, or lines or columns in different units.
        """
        used = [unit for unit in UNITS if any(f"{prefix}{axis}_{unit}" in self.texts for axis in "xyz")]
        if len(used) > 1:
            raise InputError(
                f"'{self.file}' mixes units: {what} is partly in {used[0]}, partly in {used[1]}. Give all in "
                "one unit."
            )
        unit = used[0] if used else "mm"
        names = [f"{prefix}{axis}_{unit}" for axis in "xyz"]
        self.need(names, f"{what}, in mm (or in m: {', '.join(f'{prefix}{axis}_m' for axis in 'xyz')})")
        points = UNITS[unit] * self.numbers(names)
        distance = norms(points)
        middle = np.median(distance)
        self.refuse(
            (distance > _LARGEST_RATIO * middle) | (distance * _LARGEST_RATIO < middle),
            lambda row: (
                f"{what} is {1e3 * distance[row]:.4g} mm from the origin, in the other lines about "
                f"{1e3 * middle:.4g} mm. Are units mixed (mm, m)?"
            ),
        )
        return points

    def reached_points(self, what: str) -> Array:
        """`points` that a robot reached, in its own base; InputError where no robot can be: the unit is
        another one."""
        points = self.points("", what)
        middle = np.median(norms(points))
        if not REACH[0] <= middle <= REACH[1]:
            unit = next(unit for unit in UNITS if f"x_{unit}" in self.texts)
            raise InputError(
                f"'{self.file}': {what} is {1e3 * middle:.4g} mm from the robot's base in the middle of all "
                f"lines: no robot works there. Are these numbers in {unit}, as the header says?"
            )
        return points

    def rotations(self, what: str) -> Array:
        """Rotations (n, 3, 3) of a unit quaternion, a rotation vector or a matrix by rows; names a wrong
        line."""
        forms = (QUATERNION, ROTATION_VECTOR, MATRIX)
        given = next((names for names in forms if set(names) <= set(self.texts)), None)
        if given is None:
            known = "; ".join(map(", ".join, forms))
            raise InputError(
                f"'{self.file}' says nowhere how {what} stood. Wanted one of: {known}. It has: "
                f"{', '.join(self.texts)}."
            )
        values = self.numbers(given)
        size = norms(values)
        if given == QUATERNION:
            self.refuse(
                np.abs(size - 1.0) >= ROTATION_TOLERANCE, lambda _: "qw to qz are not a unit quaternion."
            )
            return matrices(values)
        if given == ROTATION_VECTOR:
            self.refuse(
                size > FULL_TURN, lambda _: "rx_rad to rz_rad turn by more than once round. Are they degrees?"
            )
            return rotations_from_vectors(values)
        R = values.reshape(-1, 3, 3)
        self.refuse(
            no_rotations(R),
            lambda _: "r11 to r33 are not a rotation matrix (orthonormal, right-handed).",
        )
        return R


def quaternions_of(R: Array) -> Array:
    """Unit quaternions wxyz (..., 4) of rotations (..., 3, 3), real part positive."""
    return Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)


def mm_texts(lengths: Iterable[float]) -> list[str]:
    """Lengths [m] as a table's texts in mm."""
    return [f"{1e3 * length:.9g}" for length in lengths]


class Quantity(NamedTuple):
    """A kind of calibration.toml."""

    name: str  #: The command that makes it, ``calibrate NAME``
    head: str  #: Comment at the top of the file: quantities, units, axes


def write_table(file: Path, kind: Quantity, figures: Mapping[str, Any]) -> None:
    """Write a calibration as one flat table under its comment."""
    text = toml_text({"kind": kind.name} | dict(figures), head=wrap(kind.head, 116))
    file.write_text(text, encoding="utf-8")


def read_table(file: Path, *kinds: str) -> Calibration:
    """Read a calibration of one of some kinds; InputError for no such file, no TOML, or the calibration
    of something else."""
    values = read_toml(file, "calibration", InputError)
    if values.get("kind") not in kinds:
        raise InputError(
            f"'{file}' is not the calibration that is wanted (kind = {values.get('kind')!r}). "
            f"Give a calibration.toml made by 'calibrate {' | '.join(kinds)}'."
        )
    return Calibration(file, values)


@dataclass(frozen=True)
class Calibration:
    """Values of a calibration.toml, checked when they are asked for."""

    file: Path
    values: Mapping[str, Any]

    def numbers(self, name: str, shape: tuple[int, ...]) -> Array:
        """Finite numbers of a shape; InputError if they are not there, not finite, or of another shape."""
        numbers = np.array(math.nan)
        with suppress(ValueError):
            given = np.array(self.values.get(name))
            numbers = given.astype(np.float64) if given.dtype.kind in "iuf" else numbers
        if numbers.shape != shape or not np.isfinite(numbers).all():
            wanted = " x ".join(map(str, shape)) or "one"
            raise InputError(
                f"'{self.file}': {name} is {self.values.get(name)!r}, wanted {wanted} finite "
                f"number{'s' * bool(shape)}."
            )
        return numbers

    def pose(self, name: str) -> Array:
        """A pose, shape (4, 4); InputError if it is missing or malformed."""
        T = self.numbers(name, (4, 4))
        if no_rotations(T[None, :3, :3], 1e-6).any():
            raise InputError(f"'{self.file}': {name} is not a right-handed rotation and a displacement.")
        return transform(T[:3, :3], T[:3, 3])

    def refuse_other_pair(self, pair: str) -> None:
        """Refuse what was calibrated on another pair of robots (CalibrationError)."""
        if self.values.get("pair") != pair:
            raise CalibrationError(
                f"'{self.file}' is the calibration of another pair of robots: {self.values.get('pair')!r}, "
                f"not '{pair}'. Calibrate this pair, or name it as the file does."
            )


PAYLOAD = Quantity(
    "payload",
    "The tool behind the wrist sensor and the sensor's bias, with standard deviations (_std), from readings "
    "at rest. Sensor axes; torques about the sensor's origin. A reading of the idle tool: f = m g u + b, t "
    "= c x (m g u) + b_t, u against gravity. Covariance in the order of: mass, first moment xyz [kg m], "
    "force bias xyz, torque bias xyz.",
)
TIME = "time_s"
OF_SENSOR = ("bias_n", "bias_nm", "drift_n_s", "drift_nm_s")
WRENCH = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")


def estimate_figures(estimate: PayloadEstimate) -> dict[str, Any]:
    """An estimate under the names of calibration.toml and metrics.json."""
    figures: dict[str, Any] = {
        "mass_kg": estimate.mass,
        "mass_kg_std": estimate.mass_std,
        "center_m": estimate.center,
        "center_m_std": estimate.center_std,
    }
    of_sensor = (column[BIAS.start :].reshape(-1, 3) for column in (estimate.theta, estimate.std))
    for name, value, std in zip(OF_SENSOR, *of_sensor, strict=False):
        figures |= {name: value, f"{name}_std": std}
    if len(estimate.theta) > 10:
        figures["drift_zero_s"] = estimate.zero_time
    return figures | {
        "mass_std_relative": estimate.mass_std / estimate.mass,
        "center_std_max_m": estimate.center_std.max(),
        "residual_rms_n": rms(estimate.residuals[estimate.used, :3]),
        "residual_rms_nm": rms(estimate.residuals[estimate.used, 3:]),
        "readings": len(estimate.used),
        "outliers": np.flatnonzero(~estimate.used) + 1,
        "condition": estimate.condition,
    }


def write_calibration(file: Path, estimate: PayloadEstimate) -> None:
    """Write calibration.toml."""
    figures = estimate_figures(estimate) | {
        "gravity_m_s2": GRAVITY,
        "covariance": estimate.covariance,
    }
    write_table(file, PAYLOAD, figures)


def read_calibrated_tool(file: Path) -> tuple[float, Array]:
    """Mass [kg] and centre of mass in the sensor frame [m], (3,), from a calibration.toml: what a host needs
    to compensate the tool's weight. InputError if it is not the calibration of a payload."""
    table = read_table(file, PAYLOAD.name)
    mass = float(table.numbers("mass_kg", ()))
    if not 0.0 < mass < 1e3:
        raise InputError(f"'{file}': mass_kg is {mass!r}, wanted a number above 0 [kg].")
    return mass, table.numbers("center_m", (3,))


def read_readings(file: Path) -> PayloadReadings:
    """Read poses and readings of a real robot; blank lines and lines that begin with # are left out.

    Columns in any order, others are ignored: the orientation of the sensor in a frame with z up, as
    ``qw..qz``, as a rotation vector ``rx_rad..rz_rad`` (what a UR shows) or as a matrix ``r11..r33``; the
    reading ``fx_n..tz_nm`` in sensor axes about the sensor's origin; ``time_s`` if the drift is asked for.
    Raises InputError naming the line.
    """
    columns = Measured.read(file, "reading", "poses and readings")
    columns.need(WRENCH, "the reading in sensor axes, [N] and [N m]")
    time = columns.column(TIME) if TIME in columns.texts else np.zeros(len(columns))
    return PayloadReadings(time, columns.rotations("the sensor"), columns.numbers(WRENCH))


def residual_table(readings: PayloadReadings, estimate: PayloadEstimate, q: Array | None) -> str:
    """Readings, residuals and whether each was used, as CSV that ``read_readings`` takes; ``q`` (n, 6) if
    known."""
    turns = quaternions_of(readings.R_base_sensor)
    names = ["reading", TIME, *QUATERNION, *WRENCH, *(f"residual_{name}" for name in WRENCH), "used"]
    q = np.empty((len(readings), 0)) if q is None else q
    rows = []
    for k in range(len(readings)):
        numbers = [readings.time[k], *turns[k], *readings.wrenches[k], *estimate.residuals[k]]
        joints = (f"{value:.9g}" for value in q[k])
        rows.append([k + 1, *(f"{value:.9g}" for value in numbers), int(estimate.used[k]), *joints])
    return csv_text([*names, *JOINTS[: q.shape[1]]], rows)
