"""The record of a run: named columns with units, written as a compressed npz without pickle (layer 3)."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError

Array = NDArray[np.float64]

PHASES = ("approach", "touch_down", "process", "retract")

# Shape of one row ("" = scalar) and unit of every column, base frame unless the name says otherwise.
COLUMNS: Mapping[str, tuple[int, str]] = MappingProxyType(
    {
        "time_s": (0, "s"),
        "q_rad": (6, "rad"),
        "qd_rad_s": (6, "rad/s"),
        "torque_nm": (6, "N m"),
        "tcp_position_m": (3, "m"),
        "tcp_quaternion_wxyz": (4, "-"),
        "target_position_m": (3, "m"),
        "target_quaternion_wxyz": (4, "-"),
        "tcp_speed_m_s": (0, "m/s"),
        "command_twist": (6, "m/s, rad/s"),
        "wrench_measured_tool": (6, "N, N m"),
        "wrench_raw_sensor": (6, "N, N m"),
        "wrench_true_tool": (6, "N, N m"),
        "normal_force_n": (0, "N"),
        "normal_force_min_n": (0, "N"),
        "normal_force_max_n": (0, "N"),
        "pad_travel_m": (0, "m"),
        "path_s_m": (0, "m"),
        "pass_index": (0, "-"),
        "phase": (0, "-"),
    }
)
# Added after the run where they are known; older logs and other experiments go without.
LATER: Mapping[str, tuple[int, str]] = MappingProxyType(
    {
        "exposure_nm": (0, "N m"),
        "master_q_rad": (6, "rad"),
        "relative_error_m": (3, "m"),
        "rule": (0, "-"),
        "case": (0, "-"),
        "hand_force_n": (3, "N"),
        "lent_j": (0, "J"),
        "target_q_rad": (6, "rad"),
        "target_qd_rad_s": (6, "rad/s"),
        "target_qdd_rad_s2": (6, "rad/s^2"),
        "target_qddd_rad_s3": (6, "rad/s^3"),
    }
)
_INTEGER = {"pass_index": np.int32, "phase": np.int8}
_DOUBLE = {"time_s", "tcp_position_m", "target_position_m"}


@dataclass(frozen=True)
class RunLog:
    """Columns of a run, one row per recorded step; see ``COLUMNS`` for names, widths and units."""

    columns: Mapping[str, NDArray[np.generic]]

    def __getitem__(self, name: str) -> NDArray[np.generic]:
        """Return one column, shape (n,) or (n, k)."""
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["time_s"])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.columns)


def from_rows(rows: Array) -> RunLog:
    """Split an array of packed rows, shape (n, row_width()), into the named columns of the contract."""
    columns: dict[str, NDArray[np.generic]] = {}
    for name, (start, width) in row_layout().items():
        block = rows[:, start] if width == 0 else rows[:, start : start + width]
        dtype = _INTEGER.get(name, np.float64 if name in _DOUBLE else np.float32)
        column = np.ascontiguousarray(block.astype(dtype))
        column.setflags(write=False)
        columns[name] = column
    return RunLog(MappingProxyType(columns))


def with_column(log: RunLog, name: str, values: Array) -> RunLog:
    """The log with one of the columns ``LATER`` after the run, values (n,) or (n, k)."""
    if name not in LATER or len(values) != len(log):
        raise ValueError(f"'{name}' with {len(values)} rows does not belong in a log of {len(log)} rows")
    column = np.array(values, dtype=np.float64)
    column.setflags(write=False)
    return RunLog(MappingProxyType({**log.columns, name: column}))


def row_layout() -> dict[str, tuple[int, int]]:
    """First index and width (0 = scalar) of every column in a packed row."""
    layout, start = {}, 0
    for name, (width, _unit) in COLUMNS.items():
        layout[name] = (start, width)
        start += max(width, 1)
    return layout


def row_width() -> int:
    """Numbers in one packed row."""
    return sum(max(width, 1) for width, _unit in COLUMNS.values())


def write_log(path: Path, log: RunLog) -> None:
    """Write the log; the file appears under its name only when it is whole."""
    temporary = path.with_name(f".{path.name}.part")
    with temporary.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **dict(log.columns))
    temporary.replace(path)


def read_log(path: Path) -> RunLog:
    """Read a log written by ``write_log``.

    Raises:
        InputError: If the file is missing, damaged, or lacks a column of the contract.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            columns = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"cannot read the log '{path}': {error}. Was the run finished?") from error
    missing = [name for name in COLUMNS if name not in columns]
    if missing:
        raise InputError(f"the log '{path}' lacks the columns {', '.join(missing)}: it is not a run's log.")
    for column in columns.values():
        column.setflags(write=False)
    return RunLog(MappingProxyType(columns))
