"""Measurements of two bases as CSV, one form for each way to measure (file -> measurements -> file) (layer 8b)."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.csv_columns import Columns, read_columns
from polish_sim.calibration.frames.measurements import (
    LEAST_POSES,
    ROBOTS,
    AxisArcs,
    BaseCalibration,
    BaseMeasurements,
    Handshake,
    TrackedPoses,
)
from polish_sim.errors import CalibrationError, InputError, unknown_name

Array = NDArray[np.float64]

_NAMES: Final[Mapping[str, str]] = {"1": "master", "2": "follower", "master": "master", "follower": "follower"}
_XYZ: Final = ("x_mm", "y_mm", "z_mm")


class Method(NamedTuple):
    """A way to measure bases: how its file is read and written."""

    read: Callable[[Columns], BaseMeasurements]
    table: Callable[[BaseMeasurements, BaseCalibration], str]
    text: str


def read_base_measurements(file: Path, method: str) -> BaseMeasurements:
    """Read measurements of two bases.

    Args:
        file: The CSV; its columns are those of docs/calibration.md.
        method: A key of `METHODS`.

    Raises:
        InputError: No such file or method, a column or a robot missing, units mixed, a value that is none.
        CalibrationError: Fewer poses than are asked.
    """
    return method_named(method).read(read_columns(file, "measurement", "measurements of the bases"))


def method_named(name: str) -> Method:
    """A way to measure bases.

    Raises:
        InputError: There is none of that name.
    """
    if name not in METHODS:
        raise unknown_name("method", name, METHODS)
    return METHODS[name]


def robots_of(columns: Columns) -> NDArray[np.str_]:
    """Whose measurement each line is, master or follower, shape (n,).

    Raises:
        InputError: No such column, another name in it, or one of the robots is missing.
    """
    columns.need(["robot"], "whose measurement a line is: master or follower (or 1, 2)")
    for row, text in enumerate(columns.texts["robot"]):
        if text.lower() not in _NAMES:
            raise InputError(f"'{columns.file}', {columns.place(row)}: robot is '{text}', wanted master or follower.")
    robots = np.array([_NAMES[text.lower()] for text in columns.texts["robot"]])
    for robot in ROBOTS:
        if not (robots == robot).any():
            raise InputError(
                f"'{columns.file}' holds no measurement of the {robot}: both robots must be seen from the same place "
                "of the tracker."
            )
    return robots


def _read_arcs(columns: Columns) -> AxisArcs:
    robots = robots_of(columns)
    columns.need(["axis"], "which joint turned: 1 or 2")
    axes = columns.numbers(["axis"])[:, 0]
    if not np.isin(axes, (1.0, 2.0)).all():
        row = int(np.argmin(np.isin(axes, (1.0, 2.0))))
        raise InputError(f"'{columns.file}', {columns.place(row)}: axis is {axes[row]:g}, wanted 1 or 2.")
    points = columns.points("", "the target's position")
    for robot in ROBOTS:
        for axis in (1, 2):
            if not ((robots == robot) & (axes == axis)).any():
                raise InputError(f"'{columns.file}' holds no arc of axis {axis} of the {robot}.")
    return AxisArcs({r: (points[(robots == r) & (axes == 1.0)], points[(robots == r) & (axes == 2.0)]) for r in ROBOTS})


def _read_poses(columns: Columns) -> TrackedPoses:
    robots = robots_of(columns)
    own = columns.reached_points("", "the target's position in the robot's base")
    seen = columns.points("tracker_", "the target's position seen by the tracker")
    for robot in ROBOTS:
        count = int(np.sum(robots == robot))
        if count < LEAST_POSES:
            raise CalibrationError(
                f"{count} poses of the {robot} are too few for its base: give {LEAST_POSES} or more."
            )
    return TrackedPoses({robot: (seen[robots == robot], own[robots == robot]) for robot in ROBOTS})


def _read_handshake(columns: Columns) -> Handshake:
    for robot in ROBOTS:
        if not any(name.startswith(f"{robot}_x") for name in columns.texts):
            raise InputError(
                f"'{columns.file}' holds no touches of the {robot}: wanted {', '.join(f'{robot}_{n}' for n in _XYZ)}. "
                f"It has: {', '.join(columns.texts)}."
            )
    return Handshake(*(columns.reached_points(f"{robot}_", f"where the {robot} touched") for robot in ROBOTS))


def _arc_table(measured: BaseMeasurements, found: BaseCalibration) -> str:
    assert isinstance(measured, AxisArcs)
    rows = []
    for robot in ROBOTS:
        for axis, (points, circle) in enumerate(zip(measured.arcs[robot], found.circles[robot], strict=True), 1):
            for point, e, used in zip(points, circle.residuals, circle.used, strict=True):
                rows.append([robot, axis, *_mm(point), *_mm(e), int(used)])
    return _csv(["robot", "axis", *_XYZ, "residual_radial_mm", "residual_axial_mm", "used"], rows)


def _pose_table(measured: BaseMeasurements, found: BaseCalibration) -> str:
    assert isinstance(measured, TrackedPoses)
    rows = []
    for robot, group in zip(ROBOTS, found.groups, strict=True):
        seen, own = measured.points[robot]
        for k in range(len(own)):
            rows.append([robot, *_mm(own[k]), *_mm(seen[k]), *_mm(group.residuals[k : k + 1]), int(group.used[k])])
    return _csv(["robot", *_XYZ, *(f"tracker_{n}" for n in _XYZ), "residual_mm", "used"], rows)


def _handshake_table(measured: BaseMeasurements, found: BaseCalibration) -> str:
    assert isinstance(measured, Handshake)
    group = found.groups[0]
    rows = [
        [*_mm(a), *_mm(b), *_mm(group.residuals[k : k + 1]), int(group.used[k])]
        for k, (a, b) in enumerate(zip(measured.points_master, measured.points_follower, strict=True))
    ]
    return _csv([f"{robot}_{n}" for robot in ROBOTS for n in _XYZ] + ["residual_mm", "used"], rows)


def _mm(values: Array) -> list[str]:
    return [f"{1e3 * value:.9g}" for value in values]


def _csv(names: list[str], rows: list[list[object]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([names, *rows])
    return out.getvalue()


METHODS: Final[Mapping[str, Method]] = MappingProxyType(
    {
        "circles": Method(_read_arcs, _arc_table, "a tracker sees axes 1 and 2 turn"),
        "poses": Method(_read_poses, _pose_table, "a tracker sees a target at points the robot knows (Kabsch)"),
        "handshake": Method(_read_handshake, _handshake_table, "both tools touch the same points"),
    }
)
