"""Readings of a robot's own poses as CSV: in from a user's file, out as residuals.csv, which reads back (layer 8b)."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.calibration.payload import PayloadEstimate
from polish_sim.calibration.readings import ROTATION_TOLERANCE, PayloadReadings
from polish_sim.errors import InputError
from polish_sim.exchange.checks import finite_column
from polish_sim.exchange.named_columns import NamedColumns, read_named_columns

Array = NDArray[np.float64]

TIME: Final = "time_s"
QUATERNION: Final = ("qw", "qx", "qy", "qz")
ROTATION_VECTOR: Final = ("rx_rad", "ry_rad", "rz_rad")
MATRIX: Final = ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33")
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
    columns, lines = _columns(file)

    def place(row: int) -> str:
        return f"line {lines[row]}"

    def numbers(names: Sequence[str]) -> Array:
        return np.stack([finite_column(file, name, columns[name], place) for name in names], axis=1)

    _need(file, columns, WRENCH)
    forms: Mapping[tuple[str, ...], Callable[[Array], Array]] = {
        QUATERNION: _from_quaternions,
        ROTATION_VECTOR: lambda values: Rotation.from_rotvec(values).as_matrix(),
        MATRIX: lambda values: values.reshape(-1, 3, 3),
    }
    given = next((names for names in forms if set(names) <= set(columns)), None)
    if given is None:
        known = "; ".join(", ".join(names) for names in forms)
        raise InputError(
            f"'{file}' says nowhere how the sensor stood. Wanted one of: {known}. It has: {', '.join(columns)}."
        )
    R_base_sensor = forms[given](numbers(given))
    turned = np.swapaxes(R_base_sensor, 1, 2) @ R_base_sensor
    wrong = np.abs(turned - np.eye(3)).max(axis=(1, 2)) > ROTATION_TOLERANCE
    wrong |= np.linalg.det(R_base_sensor) < 0.0
    if wrong.any():
        said = "a unit quaternion" if given == QUATERNION else "a rotation matrix (orthonormal, right-handed)"
        raise InputError(f"'{file}', {place(int(np.argmax(wrong)))}: {given[0]} to {given[-1]} are not {said}.")
    time = numbers([TIME])[:, 0] if TIME in columns else np.zeros(len(R_base_sensor))
    return PayloadReadings(time, R_base_sensor, numbers(WRENCH))


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


def _columns(file: Path) -> NamedColumns:
    """Columns of text by name, and the line each row stands on."""
    try:
        text = file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read the readings '{file}': {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"'{file}' is not a text file ({error.reason}). Give a CSV of poses and readings.") from error
    return read_named_columns(file, text, "reading")


def _need(file: Path, columns: Mapping[str, Any], names: Sequence[str]) -> None:
    missing = [name for name in names if name not in columns]
    if missing:
        raise InputError(
            f"'{file}' lacks the column{'s' if len(missing) > 1 else ''} {', '.join(missing)}: the reading in sensor "
            f"axes, [N] and [N m]. It has: {', '.join(columns)}."
        )


def _from_quaternions(values: Array) -> Array:
    """Rotations of quaternions wxyz; one that is not of unit length gives no rotation."""
    length = np.linalg.norm(values, axis=1)
    safe = np.where((length > 0.0)[:, None], values, [1.0, 0.0, 0.0, 0.0])
    scale = np.where(np.abs(length - 1.0) < ROTATION_TOLERANCE, 1.0, length)
    return np.asarray(Rotation.from_quat(safe, scalar_first=True).as_matrix() * scale[:, None, None])
