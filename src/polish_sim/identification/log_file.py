"""A robot's own log as CSV: joint positions and torques over time, checked before they are believed (layer 8d).

Columns ``time_s``, ``q1_rad`` to ``q6_rad``, ``torque1_nm`` to ``torque6_nm``; others are left out.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError
from polish_sim.exchange.checks import finite_column
from polish_sim.exchange.named_columns import read_named_columns
from polish_sim.identification.robot_log import RobotLog

Array = NDArray[np.float64]

TURN: Final = 2.0 * np.pi
_GAP: Final = 3.0
"""Steps longer than this many usual ones are gaps."""
_FLAT: Final = 0.01
"""Share of samples at exactly the largest torque from which a drive is taken as saturated."""
_LEAST_SAMPLES: Final = 500


def read_robot_log(file: Path, joints: int = 6, periodic: bool = False) -> RobotLog:
    """Read a log and refuse what would spoil an identification.

    Args:
        file: The CSV.
        joints: How many joints it must tell.
        periodic: Whether a period is known: then gaps do no harm.

    Raises:
        InputError: A column is missing, a value is none, time does not increase, there are gaps, angles look like
            degrees, a torque is saturated; names the place.
    """
    names = ["time_s", *(f"q{j + 1}_rad" for j in range(joints)), *(f"torque{j + 1}_nm" for j in range(joints))]
    columns, lines = _read(file)
    missing = [name for name in names if name not in columns]
    if missing:
        raise InputError(
            f"'{file}' lacks the column{'s' if len(missing) > 1 else ''} {', '.join(missing)}. "
            f"It has: {', '.join(columns)}."
        )

    def place(row: int) -> str:
        return f"line {lines[row]}"

    values = np.stack([finite_column(file, name, columns[name], place) for name in names], axis=1)
    log = RobotLog(values[:, 0], values[:, 1 : 1 + joints], values[:, 1 + joints :])
    if len(log.time) < _LEAST_SAMPLES:
        raise InputError(
            f"'{file}' holds {len(log.time)} samples; an identification takes at least {_LEAST_SAMPLES}, better 10 s "
            "at 250 Hz or more."
        )
    _check_time(file, log.time, lines, periodic)
    _check_units(file, log)
    _check_saturation(file, log)
    return log


def _read(file: Path) -> tuple[dict[str, list[str]], list[int]]:
    try:
        text = file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read the log '{file}': {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"'{file}' is not a text file ({error.reason}). Give a CSV.") from error
    columns, lines = read_named_columns(file, text, "sample")
    return dict(columns), list(lines)


def _check_time(file: Path, time: Array, lines: list[int], periodic: bool) -> None:
    step = np.diff(time)
    if np.any(step <= 0.0):
        row = int(np.argmax(step <= 0.0)) + 1
        raise InputError(
            f"'{file}', line {lines[row]}: time_s does not increase ({time[row]:g} after {time[row - 1]:g}). "
            "Sort the samples and leave double ones out."
        )
    gaps = step > _GAP * np.median(step)
    if np.any(gaps) and not periodic:
        row = int(np.argmax(gaps)) + 1
        raise InputError(
            f"'{file}', line {lines[row]}: a gap of {step[row - 1]:.3g} s, {int(gaps.sum())} in all; samples are "
            f"{np.median(step):.3g} s apart. Accelerations cannot be told across a gap: log without, or give --period "
            "if the motion repeats."
        )


def _check_units(file: Path, log: RobotLog) -> None:
    far = np.abs(log.q).max(axis=0)
    if np.any(far > 1.05 * TURN):
        joint = int(np.argmax(far))
        raise InputError(
            f"'{file}': q{joint + 1}_rad reaches {far[joint]:.4g}, more than a turn. Are these degrees? Give radians."
        )


def _check_saturation(file: Path, log: RobotLog) -> None:
    largest = np.abs(log.torque).max(axis=0)
    flat = np.mean(np.abs(log.torque) >= largest * (1.0 - 1e-9), axis=0)
    if np.any((flat > _FLAT) & (largest > 0.0)):
        joint = int(np.argmax(flat))
        raise InputError(
            f"'{file}': torque{joint + 1}_nm stands at {largest[joint]:.4g} N m in {100 * flat[joint]:.0f}% of the "
            "samples: the drive is saturated there and the model does not hold. Move more slowly."
        )
