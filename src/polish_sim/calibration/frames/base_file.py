"""calibration.toml of two bases: written by `calibrate base`, loaded by runs with two robots (layer 8b)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.frames.measurements import BaseCalibration
from polish_sim.calibration.toml_table import numbers_of, read_table, write_table
from polish_sim.errors import CalibrationError, InputError
from polish_sim.spatial import transform

Array = NDArray[np.float64]

KIND = "base"
_HEAD = """\
# The follower robot's base in the master's, T_master_follower, and its covariance: displacement of the origin xyz [m]
# and small rotation xyz [rad], master axes. `pair` names the two robots it is true for.
# true_transform: of simulated robots only.
"""


class CalibratedBases(NamedTuple):
    """Where the follower's base is."""

    T_master_follower: Array
    """Shape (4, 4)."""
    covariance: Array
    """Of its origin [m] and rotation [rad], master axes, shape (6, 6)."""
    T_true: Array | None = None
    """Where it really is, if the measurements were simulated, shape (4, 4)."""


def base_figures(found: BaseCalibration) -> dict[str, Any]:
    """A calibration under the names of calibration.toml and metrics.json."""
    std = np.sqrt(np.diag(found.covariance))
    distances = np.concatenate([group.residuals[group.used] for group in found.groups])
    outliers = {group.name: (np.flatnonzero(~group.used) + 1).tolist() for group in found.groups}
    axes: dict[str, Any] = {}
    if found.axes:
        each = found.axes.values()
        axes = {"gap_m": max(robot.gap for robot in each), "axes_meet": all(robot.meets for robot in each)}
    return axes | {
        "transform": found.T_master_follower.tolist(),
        "origin_m_std": std[:3].tolist(),
        "rotation_rad_std": std[3:].tolist(),
        "noise_m": found.noise,
        "residual_rms_m": float(np.sqrt(np.mean(distances**2))),
        "measurements": len(distances),
        "outliers": [f"{name}: {number}" for name, numbers in outliers.items() for number in numbers],
    }


def write_base_calibration(file: Path, found: BaseCalibration, pair: str, T_true: Array | None = None) -> None:
    """Write calibration.toml; ``pair`` names the two robots, ``T_true`` says where simulated ones really stand."""
    figures = {"kind": KIND, "pair": pair} | base_figures(found)
    if T_true is not None:
        figures["true_transform"] = np.asarray(T_true).tolist()
    write_table(file, _HEAD, figures | {"covariance": found.covariance.tolist()})


def read_base_calibration(file: Path, pair: str) -> CalibratedBases:
    """Read where the follower's base is.

    Args:
        file: A calibration.toml of `calibrate base`.
        pair: The robots that are to run, as the calibration names them.

    Raises:
        InputError: No such file, not the calibration of bases, or a value that cannot be.
        CalibrationError: The calibration of another pair of robots.
    """
    table = read_table(file, KIND, "two bases")
    refuse_other_pair(file, table, pair)
    covariance = numbers_of(file, table, "covariance", (6, 6))
    T_true = pose_of(file, table, "true_transform") if "true_transform" in table else None
    return CalibratedBases(pose_of(file, table, "transform"), covariance, T_true)


def refuse_other_pair(file: Path, table: Mapping[str, Any], pair: str) -> None:
    """Refuse what was calibrated on other robots.

    Raises:
        CalibrationError: It names another pair.
    """
    if table.get("pair") != pair:
        raise CalibrationError(
            f"'{file}' is the calibration of another pair of robots: {table.get('pair')!r}, not '{pair}'. "
            "Calibrate this pair, or name it as the file does."
        )


def pose_of(file: Path, table: Mapping[str, Any], name: str) -> Array:
    """A pose of a table, shape (4, 4).

    Raises:
        InputError: It is not there, or is none.
    """
    T = numbers_of(file, table, name, (4, 4))
    if np.abs(T[:3, :3].T @ T[:3, :3] - np.eye(3)).max() > 1e-6 or np.linalg.det(T[:3, :3]) < 0.0:
        raise InputError(f"'{file}': {name} is not a right-handed rotation and a displacement.")
    return transform(T[:3, :3], T[:3, 3])
