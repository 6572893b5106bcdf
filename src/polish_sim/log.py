"""The record of a run: named columns with units, written as a compressed npz without pickle."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Bools
from polish_sim.errors import InputError, PolishSimError
from polish_sim.row_file import whole_file

T = TypeVar("T")
UNREADABLE = (
    OSError, ValueError, TypeError, KeyError, EOFError, RuntimeError, MemoryError, zipfile.BadZipFile,
    zlib.error,
)  # fmt: skip
"""What reading a damaged npz may raise."""
PHASES = ("approach", "touch_down", "process", "retract")
APPROACH_PHASE, TOUCH_PHASE, PROCESS_PHASE, RETRACT_PHASE = range(len(PHASES))  #: Codes in the log

# Numbers in a row of every column, 0 = scalar; base frame unless the name says otherwise; twists and wrenches
# are (linear; angular) [m/s, rad/s] and (force; torque) [N, N m].
COLUMNS: Mapping[str, int] = {
    "time_s": 0,
    "q_rad": 6,
    "qd_rad_s": 6,
    "torque_nm": 6,
    "tcp_position_m": 3,
    "tcp_quaternion_wxyz": 4,
    "target_position_m": 3,
    "target_quaternion_wxyz": 4,
    "tcp_speed_m_s": 0,
    "command_twist": 6,
    "wrench_measured_tool": 6,
    "wrench_raw_sensor": 6,
    "wrench_true_tool": 6,
    "normal_force_n": 0,
    "normal_force_min_n": 0,
    "normal_force_max_n": 0,
    "pad_travel_m": 0,
    "path_s_m": 0,
    "pass_index": 0,
    "phase": 0,
    "host_depth_m": 0,  # of the tool beyond its target along the target's axis, by the encoders
}
LOG_ROW: Any = np.dtype((np.record, [(name, float, width or ()) for name, width in COLUMNS.items()]))
"""A row of the log as it is recorded."""
READ_BY_HOST = ("wrench_measured", "wrench_raw", "command", "host", "encoder")
"""Beginnings of the columns that a broken sensor fills with what is no number."""
NEWER = ("host_depth_m",)  #: Columns that older runs' logs go without
# Added after the run where they are known; older logs and other experiments go without.
LATER: Mapping[str, int] = {
    "exposure_nm": 0,
    "master_q_rad": 6,
    "relative_error_m": 3,
    "rule": 0,
    "case": 0,
    "hand_force_n": 3,
    "lent_j": 0,
    "encoder_q_rad": 6,
    "target_q_rad": 6,
    "target_qd_rad_s": 6,
    "target_qdd_rad_s2": 6,
    "target_qddd_rad_s3": 6,
}
_INTEGER = {"pass_index": np.int32, "phase": np.int8}
_DOUBLE = {"time_s", "tcp_position_m", "target_position_m"}


@dataclass(frozen=True)
class RunLog:
    """Columns of a run, one row per recorded step; see ``COLUMNS`` for names and widths."""

    columns: Mapping[str, NDArray[np.generic]]  #: Read-only

    def __post_init__(self) -> None:
        for column in self.columns.values():
            column.setflags(write=False)
        object.__setattr__(self, "columns", MappingProxyType(self.columns))

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return one column, (n,) or (n, k), in double precision but for whole numbers; InputError where the
        log has none of this name."""
        if name not in self.columns:
            raise InputError(
                f"the log has no column {name}: it is of an older run, or of another experiment."
            )
        column = self.columns[name]
        return column if column.dtype.kind == "i" else column.astype(np.float64, copy=False)

    def __len__(self) -> int:
        return len(self.columns["time_s"])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.columns)

    @property
    def fed(self) -> Bools:
        """Rows of the process, shape (n,)."""
        return self["phase"] == PROCESS_PHASE


def from_rows(rows: NDArray[np.void]) -> RunLog:
    """Split recorded rows, shape (n,) of ``LOG_ROW`` or more, into the named columns of the contract."""
    usual: dict[str, Any] = dict.fromkeys(COLUMNS, np.float32) | dict.fromkeys(_DOUBLE, np.float64) | _INTEGER
    return RunLog({name: np.ascontiguousarray(rows[name].astype(kind)) for name, kind in usual.items()})


def with_column(log: RunLog, name: str, values: Array) -> RunLog:
    """The log with one of the columns ``LATER`` after the run, values (n,) or (n, k)."""
    if name not in LATER or len(values) != len(log):
        raise ValueError(f"'{name}' with {len(values)} rows does not belong in a log of {len(log)} rows")
    return RunLog({**log.columns, name: np.array(values, dtype=np.float64)})


def write_log(path: Path, log: RunLog) -> None:
    """Write the log; the file appears under its name only when it is whole."""
    write_arrays(path, log.columns)


def write_arrays(path: Path, columns: Mapping[str, Any]) -> None:
    """Write arrays by name; the file appears under its name only when it is whole."""
    with whole_file(path) as draft, draft.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **columns)


def read_log(path: Path) -> RunLog:
    """Read a log written by ``write_log``; InputError if it is missing, damaged, or lacks a column of the
    contract."""
    return read_arrays(path, "log", "Was the run finished?", _log_of, READ_BY_HOST)


def _log_of(columns: dict[str, NDArray[Any]]) -> RunLog:
    """The log of its columns; ValueError if they are not a run's."""
    check_names(columns, [name for name in COLUMNS if name not in NEWER])
    for name, column in columns.items():
        width = {**COLUMNS, **LATER}.get(name, 0)
        if column.shape != (columns["time_s"].size, width)[: 1 + (width > 0)]:
            raise ValueError(f"the column {name} has the shape {column.shape}, others have other rows")
        if name.endswith("wxyz") and not column.any(axis=1).all():
            raise ValueError(f"the column {name} holds zeros")
    return RunLog(columns)


def check_names(arrays: Mapping[str, object], wanted: Iterable[str]) -> None:
    """Refuse arrays that lack some that are wanted (ValueError)."""
    if missing := [name for name in wanted if name not in arrays]:
        raise ValueError(f"it lacks {', '.join(missing)}")


def read_arrays(
    file: Path,
    what: str,
    remedy: str,
    build: Callable[[dict[str, NDArray[Any]]], T],
    unsure: tuple[str, ...] = (),
) -> T:
    """What ``build`` makes of the arrays in an npz, by name; those that begin as one of ``unsure`` may hold
    NaN.

    Raises:
        InputError: The file is missing or damaged, an array is not of finite numbers, or ``build`` refused
            it: ``what`` cannot be read, and the ``remedy``.
    """
    try:
        with zipfile.ZipFile(file), np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        for name, array in arrays.items():
            if array.dtype.kind not in "biuf" or not (name.startswith(unsure) or np.isfinite(array).all()):
                raise ValueError(f"'{name}' is not of finite numbers")
        return build(arrays)
    except (*UNREADABLE, PolishSimError) as error:
        raise InputError(f"cannot read the {what} '{file}': {error}. {remedy}") from error


# What the figures are computed from: the exact quantities of a run at the full rate.


class Trace(NamedTuple):
    """Exact quantities at every physics step, each of shape (n,); nothing filtered, nothing late."""

    time_s: Array
    phase: NDArray[np.int8]  #: Codes of ``PHASES``
    normal_force_n: Array  #: Contact force along the tool axis, pressing positive
    position_error_m: Array  #: Distance from the tool point to its target
    tangential_error_m: Array  #: The part of it across the target's tool axis
    orientation_error_rad: Array  #: Angle between the tool's frame and its target's
    tcp_position_m: Array  #: Tool point in the base frame, shape (n, 3)
    tcp_speed_m_s: Array
    path_s_m: Array  #: Where on the path the target is
    part_shift_m: Array  #: How far the part has moved from where it lay at rest, base frame, shape (n, 3)
    pad_travel_m: Array  #: How far the head's spring is compressed
    spindle_rad_s: Array  #: Speed of the spindle
    target_error_m: Array  #: From the tool point to its target, base frame, shape (n, 3)
    tool_on_part_m: Array
    """Tool point in the nominal work frame of a part that is carried, shape (n, 3); else zeros."""

    @property
    def fed(self) -> Bools:
        """Steps of the process, shape (n,)."""
        return self.phase == PROCESS_PHASE


# What a run took off the part: Preston's integral at every node of the region, in npz.
#
# Preston's law says dh/dt = k_p p v. The exposure, the integral of p v dt [N/m], is what the cell knows; the
# depth taken off is the wear coefficient k_p [1/Pa] times it. Without a coefficient the removal is relative:
# exposure over its mean.


@dataclass(frozen=True, eq=False)
class RemovalMap:
    """Exposure over the region, on the fine triangles of its drawing."""

    vertices: Array  #: Nodes on the nominal surface, work frame [m], shape (n, 3)
    normals: Array  #: Unit outward normals there, shape (n, 3)
    triangles: NDArray[np.int64]  #: Vertex indices, shape (m, 3)
    areas: Array  #: Area each node stands for [m^2], shape (n,); their sum is the region's
    exposure: Array  #: Integral of pressure x sliding speed over time [N/m], shape (n,)
    up: Array  #: Where the region is looked at from, unit, shape (3,)
    preston_1_pa: float  #: Wear coefficient [1/Pa]; 0: unknown, the removal is relative
    #: Exposure summed over the surfaces beside the region that the pad came to as well [N m]
    elsewhere_nm: float
    unplaced_share: float  #: Share of the force's impulse for which the pad touched no node [-]
    field_ratio: float
    """Impulse of the pressure field before it is scaled to the exact force, over that of the exact force
    [-]."""

    @cached_property
    def mean(self) -> float:
        """Mean exposure over the region's area [N/m]."""
        return float(self.areas @ self.exposure) / float(self.areas.sum())

    @property
    def absolute(self) -> bool:
        """Whether a wear coefficient makes the removal a depth in metres."""
        return self.preston_1_pa > 0.0

    @cached_property
    def relative(self) -> Array:
        """Removal over its mean [-], shape (n,); zero where nothing was removed at all."""
        return self.exposure / self.mean if self.mean > 0.0 else np.zeros_like(self.exposure)

    @cached_property
    def border(self) -> NDArray[np.int64]:
        """Ends of the edges with one triangle only, shape (b, 2)."""
        size = len(self.vertices)
        # One number an edge: numbers are sorted in a fraction of the time that rows take.
        edges = np.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]]) @ [size, 1]
        found, count = np.unique(edges, return_counts=True)
        return np.column_stack(np.divmod(found[count == 1], size))


def write_removal(file: Path, removal: RemovalMap) -> None:
    """Write the map as a compressed npz without pickle, positions and exposure in single precision."""
    single = {"vertices", "normals", "areas", "exposure"}
    columns = {
        name: np.asarray(value, dtype=np.float32) if name in single else value
        for name, value in vars(removal).items()
        if name in RemovalMap.__dataclass_fields__
    }
    columns["triangles"] = removal.triangles.astype(np.int32)
    write_arrays(file, columns)


NOTHING_PRESSED = ("unplaced_share", "field_ratio")  #: They are NaN where the pad never pressed
FORGET = "take its name from 'files' in metrics.json to see the run without."


def read_removal(file: Path) -> RemovalMap:
    """Read a map written by ``write_removal``; InputError if the file is damaged or lacks an entry."""
    return read_arrays(file, "removal map", f"Delete it, and {FORGET}", _removal_of, NOTHING_PRESSED)


def _removal_of(arrays: dict[str, NDArray[Any]]) -> RemovalMap:
    """The map of its arrays; ValueError if one is missing, or they do not fit each other."""
    check_names(arrays, RemovalMap.__dataclass_fields__)
    columns: dict[str, Any] = {
        name: array.astype(np.float64) if array.ndim else float(array) for name, array in arrays.items()
    }
    columns["triangles"] = triangles = arrays["triangles"].astype(np.int64)
    removal = RemovalMap(**columns)
    (count,) = nodes = removal.exposure.shape
    corners = (len(triangles), 3)
    shapes = {"vertices": (count, 3), "normals": (count, 3), "triangles": corners, "up": (3,)}
    shapes |= {"areas": nodes, "exposure": nodes}
    fits = all(array.shape == shapes.get(name, ()) for name, array in arrays.items())
    known = triangles.size and 0 <= triangles.min() <= triangles.max() < count
    if not (fits and known and removal.areas.sum() > 0.0 and removal.normals.any(axis=1).all()):
        raise ValueError("its nodes, areas and triangles do not fit each other")
    if removal.exposure.min() < 0.0:
        raise ValueError("its exposure is negative")
    return removal
