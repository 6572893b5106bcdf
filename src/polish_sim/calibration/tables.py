"""A user's CSV of measurements as named columns: numbers, lengths with their unit, orientations."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array, Bools
from polish_sim.calibration.payload import ROTATION_TOLERANCE
from polish_sim.errors import InputError
from polish_sim.exchange.columns import read_named_columns
from polish_sim.exchange.way_points import finite_column

QUATERNION: Final = ("qw", "qx", "qy", "qz")
ROTATION_VECTOR: Final = ("rx_rad", "ry_rad", "rz_rad")
MATRIX: Final = ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33")
UNITS: Final[Mapping[str, float]] = {"m": 1.0, "mm": 1e-3}
FULL_TURN: Final = 2.0 * np.pi + 0.01
"""A rotation vector is no longer than this [rad]."""
_LARGEST_RATIO = 100.0
REACH: Final = (0.02, 5.0)
"""How far from its base a robot's flange or tip is, in the middle of all lines, whatever the robot [m]."""


@dataclass(frozen=True)
class Columns:
    """Columns of text by name, in the order of a file."""

    file: Path
    texts: Mapping[str, Sequence[str]]
    lines: Sequence[int]
    """The line each row stands on."""

    def __len__(self) -> int:
        return len(self.lines)

    def place(self, row: int) -> str:
        """Where a row stands."""
        return f"line {self.lines[row]}"

    def numbers(self, names: Sequence[str]) -> Array:
        """Columns of numbers, shape (n, len(names))."""
        return np.stack([finite_column(self.file, name, self.texts[name], self.place) for name in names], axis=1)

    def need(self, names: Sequence[str], what: str) -> None:
        """Refuse a file that lacks columns.

        Raises:
            InputError: Naming those it lacks, what they are and those it has.
        """
        missing = [name for name in names if name not in self.texts]
        if missing:
            raise InputError(
                f"'{self.file}' lacks the column{'s' if len(missing) > 1 else ''} {', '.join(missing)}: {what}. "
                f"It has: {', '.join(self.texts)}."
            )

    def points(self, prefix: str, what: str) -> Array:
        """Points from columns ``<prefix>x_mm`` to ``<prefix>z_mm``, or the same in metres (``_m``) [m], shape (n, 3).

        Raises:
            InputError: A column missing, or lines or columns in different units.
        """
        given = {unit: [axis for axis in "xyz" if f"{prefix}{axis}_{unit}" in self.texts] for unit in UNITS}
        used = [unit for unit, axes in given.items() if axes]
        if len(used) > 1:
            raise InputError(
                f"'{self.file}' mixes units: {what} is partly in {used[0]}, partly in {used[1]}. Give all in one unit."
            )
        unit = used[0] if used else "mm"
        names = [f"{prefix}{axis}_{unit}" for axis in "xyz"]
        self.need(names, f"{what}, in mm (or in m: {', '.join(f'{prefix}{axis}_m' for axis in 'xyz')})")
        points = UNITS[unit] * self.numbers(names)
        self._refuse_mixed(points, what)
        return points

    def reached_points(self, prefix: str, what: str) -> Array:
        """The same of points a robot reached, in its own base: where no robot can be the unit is another one.

        Raises:
            InputError: As `points`, or too near or too far for any robot.
        """
        points = self.points(prefix, what)
        middle = float(np.median(np.linalg.norm(points, axis=1)))
        if not REACH[0] <= middle <= REACH[1]:
            unit = next(unit for unit in UNITS if f"{prefix}x_{unit}" in self.texts)
            raise InputError(
                f"'{self.file}': {what} is {1e3 * middle:.4g} mm from the robot's base in the middle of all lines: no "
                f"robot works there. Are these numbers in {unit}, as the header says?"
            )
        return points

    def _refuse_mixed(self, points: Array, what: str) -> None:
        """Refuse lines a hundred times as far away as the middle one, or as near."""
        distance = np.linalg.norm(points, axis=1)
        middle = float(np.median(distance))
        wrong = (distance > _LARGEST_RATIO * middle) | (distance * _LARGEST_RATIO < middle)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(
                f"'{self.file}', {self.place(row)}: {what} is {1e3 * distance[row]:.4g} mm from the origin, in the "
                f"other lines about {1e3 * middle:.4g} mm. Are units mixed (mm, m)?"
            )

    def rotations(self, what: str) -> Array:
        """Rotation matrices from a unit quaternion, a rotation vector or a matrix by rows, shape (n, 3, 3).

        Raises:
            InputError: None of them there, or values that are no rotation; names the line.
        """
        forms: Mapping[tuple[str, ...], Callable[[Array], Array]] = {
            QUATERNION: _from_quaternions,
            ROTATION_VECTOR: lambda values: Rotation.from_rotvec(values).as_matrix(),
            MATRIX: lambda values: values.reshape(-1, 3, 3),
        }
        given = next((names for names in forms if set(names) <= set(self.texts)), None)
        if given is None:
            known = "; ".join(", ".join(names) for names in forms)
            raise InputError(
                f"'{self.file}' says nowhere how {what} stood. Wanted one of: {known}. It has: {', '.join(self.texts)}."
            )
        values = self.numbers(given)
        if given == ROTATION_VECTOR and (np.linalg.norm(values, axis=1) > FULL_TURN).any():
            row = int(np.argmax(np.linalg.norm(values, axis=1) > FULL_TURN))
            raise InputError(
                f"'{self.file}', {self.place(row)}: rx_rad to rz_rad turn by more than once round. Are they degrees?"
            )
        R = forms[given](values)
        wrong = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2)) > ROTATION_TOLERANCE
        wrong |= np.linalg.det(R) < 0.0
        if wrong.any():
            said = "a unit quaternion" if given == QUATERNION else "a rotation matrix (orthonormal, right-handed)"
            place = self.place(int(np.argmax(wrong)))
            raise InputError(f"'{self.file}', {place}: {given[0]} to {given[-1]} are not {said}.")
        return np.asarray(R)

    def rows(self, mask: Bools) -> Columns:
        """Some of the rows."""
        keep = np.flatnonzero(mask).tolist()
        texts = {name: [column[k] for k in keep] for name, column in self.texts.items()}
        return Columns(self.file, texts, [self.lines[k] for k in keep])


def read_columns(file: Path, kind: str, content: str) -> Columns:
    """Read a CSV with a header; blank lines and lines that begin with # are left out.

    Args:
        file: The file.
        kind: What a line of it is, e.g. ``"reading"``.
        content: What it should hold, e.g. ``"poses and readings"``.

    Raises:
        InputError: No such file, no text, no CSV, or no lines.
    """
    try:
        text = file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read the {kind}s '{file}': {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"'{file}' is not a text file ({error.reason}). Give a CSV of {content}.") from error
    return Columns(file, *read_named_columns(file, text, kind))


def _from_quaternions(values: Array) -> Array:
    """Rotations of quaternions wxyz; one that is not of unit length gives no rotation."""
    length = np.linalg.norm(values, axis=1)
    safe = np.where((length > 0.0)[:, None], values, [1.0, 0.0, 0.0, 0.0])
    scale = np.where(np.abs(length - 1.0) < ROTATION_TOLERANCE, 1.0, length)
    return np.asarray(Rotation.from_quat(safe, scalar_first=True).as_matrix() * scale[:, None, None])


# calibration.toml as text and back: one flat table, its kind named.


def write_table(file: Path, head: str, figures: Mapping[str, Any]) -> None:
    """Write a table under a comment that says what it is."""
    lines = [f"{name} = {_literal(value)}" for name, value in figures.items()]
    file.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")


def _literal(value: Any) -> str:
    if isinstance(value, (str, bool)):
        # JSON and TOML write these alike.
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list):
        return "[" + ", ".join(_literal(entry) for entry in value) + "]"
    if isinstance(value, np.generic):
        return repr(value.item())
    # TOML wants a digit on both sides of the point and reads 1e-05 as well as Python does.
    return repr(value)


def calibration_kind(file: Path, wanted: tuple[str, ...]) -> str:
    """The kind of a calibration.toml, one of those ``wanted``.

    Raises:
        InputError: No such file, no TOML, or none of them.
    """
    kind = _read(file).get("kind")
    if kind not in wanted:
        raise InputError(
            f"'{file}' is none of the calibrations a run can take (kind = {kind!r}): give a calibration.toml made by "
            f"'calibrate {' | '.join(wanted)}'."
        )
    return str(kind)


def read_table(file: Path, kind: str, what: str) -> Mapping[str, Any]:
    """Read a calibration of one kind.

    Args:
        file: The file.
        kind: Its kind, e.g. ``"payload"``: that of the command that makes it.
        what: What it calibrates, e.g. ``"a payload"``.

    Raises:
        InputError: No such file, no TOML, or the calibration of something else.
    """
    table = _read(file)
    if table.get("kind") != kind:
        raise InputError(
            f"'{file}' is not the calibration of {what} (kind = {table.get('kind')!r}). "
            f"Give a calibration.toml made by 'calibrate {kind}'."
        )
    return table


def _read(file: Path) -> Mapping[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read the calibration '{file}': {error.strerror}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"the calibration '{file}' is not valid TOML: {error}.") from error


def numbers_of(file: Path, table: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Array:
    """Numbers of a table.

    Raises:
        InputError: They are not there, not finite, or of another shape.
    """
    try:
        values = np.array(table.get(name), dtype=np.float64)
    except (TypeError, ValueError):
        values = np.array(math.nan)
    if values.shape != shape or not np.isfinite(values).all():
        wanted = " x ".join(map(str, shape))
        raise InputError(f"'{file}': {name} is {table.get(name)!r}, wanted {wanted} finite numbers.")
    return values


def is_number(value: Any) -> bool:
    """Whether a value of TOML is a finite number."""
    return not isinstance(value, bool) and isinstance(value, (int, float)) and math.isfinite(value)
