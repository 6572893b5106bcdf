"""Measurements of two bases, both bases from them, and their files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Bools, Figures, norms, rms
from polish_sim.calibration.matched_points import relative_frame
from polish_sim.calibration.tables import XYZ_MM, Measured, Quantity, mm_texts, read_table, write_table
from polish_sim.dual.calibration.circle import (
    BaseFrame,
    SweptCircle,
    base_from_circles,
    fit_circle,
)
from polish_sim.errors import CalibrationError, InputError
from polish_sim.tables import csv_text

T = TypeVar("T")

ROBOTS = ("master", "follower")
BASE = Quantity(
    "base",
    "The follower robot's base in the master's, T_master_follower, and its covariance: displacement of the "
    "origin xyz [m] and small rotation xyz [rad], master axes. `pair` names the two robots it is true for. "
    "true_transform: of simulated robots only.",
)
_NAMES = dict(zip(("1", "2", *ROBOTS), 2 * ROBOTS, strict=True))

Arcs = Mapping[str, tuple[Array, Array]]
"""Target seen by a tracker while axis 1, then axis 2 turns alone, robot by robot: points by rising joint
angle, tracker frame [m], (n, 3) each."""


class Group(NamedTuple):
    """Points measured together and their residuals."""

    name: str
    points: Array  #: [m], shape (n, 3)
    residuals: Array  #: Of each from the fit [m], shape (n, k)
    used: Bools  #: Shape (n,)


class BaseCalibration(NamedTuple):
    """The follower's base in the master's, and the fits it rests on."""

    T_master_follower: Array  #: Shape (4, 4)
    covariance: Array  #: Of its origin [m] and rotation [rad], master axes, shape (6, 6)
    noise: float  #: Standard deviation of one coordinate of one measurement [m]
    groups: tuple[Group, ...]
    circles: Mapping[str, tuple[SweptCircle, ...]]  #: Circles of axes 1 and 2, robot by robot
    #: The bases seen by the tracker, with the gap between their axes, robot by robot
    frames: Mapping[str, BaseFrame]


def fit_bases(arcs: Arcs, noise: float | None = None) -> BaseCalibration:
    """Both bases from four circles; ``noise`` of one coordinate [m], None: the residuals'.

    Raises CalibrationError if they are undetermined.
    """
    circles = {
        robot: tuple(
            _named(f"the {robot}'s axis {axis}", fit_circle, points, noise)
            for axis, points in enumerate(arcs[robot], 1)
        )
        for robot in ROBOTS
    }
    frames = {robot: _named(f"the {robot}", base_from_circles, *pair) for robot, pair in circles.items()}
    groups = [
        Group(f"{robot}, axis {axis}", points, circle.residuals, circle.used)
        for robot, pair in circles.items()
        for axis, (points, circle) in enumerate(zip(arcs[robot], pair, strict=True), 1)
    ]
    master, follower = frames.values()
    T, covariance = relative_frame(master.T, master.covariance, follower.T, follower.covariance)
    found = rms([circle.noise for pair in circles.values() for circle in pair])
    return BaseCalibration(T, covariance, found, tuple(groups), circles, frames)


def arcs_table(found: BaseCalibration) -> str:
    """Points, distances along the radius and the axis, and whether each was used, as CSV that reads back."""
    rows = [
        [*group.name.split(", axis "), *mm_texts((*point, *e)), int(used)]
        for group in found.groups
        for point, e, used in zip(group.points, group.residuals, group.used, strict=True)
    ]
    return csv_text(["robot", "axis", *XYZ_MM, "residual_radial_mm", "residual_axial_mm", "used"], rows)


def _named(what: str, fit: Callable[..., T], *arguments: Any) -> T:
    """A fit whose errors say whose it is."""
    try:
        return fit(*arguments)
    except CalibrationError as error:
        raise CalibrationError(f"{what}: {error}") from error


class CalibratedBases(NamedTuple):
    """Where the follower's base is."""

    T_master_follower: Array  #: Shape (4, 4)
    T_true: Array | None  #: Where it really is, if the measurements were simulated, shape (4, 4)


def base_figures(found: BaseCalibration) -> Figures:
    """A calibration under the names of calibration.toml and metrics.json."""
    std = np.sqrt(np.diag(found.covariance))
    distances = np.concatenate([norms(group.residuals[group.used]) for group in found.groups])
    outliers = {group.name: np.flatnonzero(~group.used) + 1 for group in found.groups}
    each = found.frames.values()
    return {
        "gap_m": max(robot.gap for robot in each),
        "axes_meet": all(robot.meets for robot in each),
        "transform": found.T_master_follower,
        "origin_m_std": std[:3],
        "rotation_rad_std": std[3:],
        "noise_m": found.noise,
        "residual_rms_m": rms(distances),
        "measurements": len(distances),
        "outliers": [f"{name}: {number}" for name, numbers in outliers.items() for number in numbers],
    }


def write_base_calibration(file: Path, found: BaseCalibration, pair: str, figures: Figures) -> None:
    """Write calibration.toml; ``pair`` names the two robots."""
    write_table(file, BASE, {"pair": pair} | figures | {"covariance": found.covariance})


def read_base_calibration(file: Path, pair: str) -> CalibratedBases:
    """Read where the follower's base is from a calibration.toml of `calibrate base`, for the robots named
    ``pair``.

    Raises InputError for a file that is no calibration of bases, CalibrationError for that of another pair.
    """
    table = read_table(file, BASE.name)
    table.refuse_other_pair(pair)
    T_true = table.pose("true_transform") if "true_transform" in table.values else None
    return CalibratedBases(table.pose("transform"), T_true)


def read_base_measurements(file: Path) -> Arcs:
    """Read measurements of two bases; the columns are those of docs/calibration.md.

    Raises InputError for a missing file, column or robot, mixed units or an invalid value.
    """
    columns = Measured.read(file, "measurement", "measurements of the bases")
    robots = robots_of(columns)
    columns.need(["axis"], "which joint turned: 1 or 2")
    axes = columns.column("axis")
    columns.refuse(~np.isin(axes, (1.0, 2.0)), lambda row: f"axis is {axes[row]:g}, wanted 1 or 2.")
    points = columns.points("", "the target's position")
    which = {robot: [(robots == robot) & (axes == axis) for axis in (1, 2)] for robot in ROBOTS}
    for robot, masks in which.items():
        for axis, mask in enumerate(masks, 1):
            if not mask.any():
                raise InputError(f"'{file}' holds no arc of axis {axis} of the {robot}.")
    return {robot: (points[first], points[second]) for robot, (first, second) in which.items()}


def robots_of(columns: Measured) -> NDArray[np.str_]:
    """Whose measurement each line is, master or follower, (n,); InputError for another name or a missing
    robot."""
    columns.need(["robot"], "whose measurement a line is: master or follower (or 1, 2)")
    texts = columns.texts["robot"]
    robots = np.array([_NAMES.get(text.lower(), "") for text in texts])
    columns.refuse(robots == "", lambda row: f"robot is '{texts[row]}', wanted master or follower.")
    for robot in ROBOTS:
        if not (robots == robot).any():
            raise InputError(
                f"'{columns.file}' holds no measurement of the {robot}: both robots must be seen from the "
                "same place of the tracker."
            )
    return robots
