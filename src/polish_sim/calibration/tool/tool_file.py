"""calibration.toml of a tool frame: written by `calibrate tcp`, loaded by runs (layer 8b)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.calibration.toml_table import numbers_of, read_table, write_table
from polish_sim.calibration.tool.frame import ToolFrameEstimate, ToolMeasurements
from polish_sim.calibration.tool.poses import point_error_bound
from polish_sim.errors import InputError
from polish_sim.spatial import transform

Array = NDArray[np.float64]

KIND = "tcp"
_HEAD = """\
# The tool on the flange: its tip [m] and axes (unit quaternion wxyz), with standard deviations (_std), covariance of
# the tip [m^2, flange axes]. rotation_rad_std: small rotations about the tool's x, y, z.
"""


class CalibratedToolFrame(NamedTuple):
    """Where the tool is on the flange."""

    T_flange_tool: Array
    """Shape (4, 4)."""
    position_covariance: Array
    """Of the tip [m^2], flange axes, shape (3, 3)."""


def tool_figures(measured: ToolMeasurements, found: ToolFrameEstimate, noise: float | None = None) -> dict[str, Any]:
    """An estimate under the names of calibration.toml and metrics.json.

    Args:
        measured: What it rests on.
        found: The estimate.
        noise: True standard deviation of one coordinate [m], if known: for the Cramér-Rao bound.
    """
    tip, orientation = found.tip, found.orientation
    turn = Rotation.from_matrix(found.T_flange_tool[:3, :3]).as_quat(canonical=True, scalar_first=True)
    figures: dict[str, Any] = {
        "position_m": tip.point.tolist(),
        "position_m_std": tip.std.tolist(),
        "quaternion_wxyz": turn.tolist(),
        "touched_m": tip.touched.tolist(),
        "noise_m": tip.noise,
        "position_std_m": float(np.linalg.norm(tip.std)),
        "position_crb_m": point_error_bound(measured.touches.R[tip.used], tip.noise if noise is None else noise),
        "residual_rms_m": float(np.sqrt(np.mean(np.sum(tip.residuals[tip.used] ** 2, axis=1)))),
        "touches": int(tip.used.sum()),
        "outliers": (np.flatnonzero(~tip.used) + 1).tolist(),
    }
    if orientation is not None:
        std = np.sqrt(np.diag(orientation.covariance))
        figures |= {"rotation_rad_std": std.tolist(), "rotation_std_max_rad": float(std.max())}
    return figures


def write_tool_calibration(file: Path, figures: dict[str, Any], found: ToolFrameEstimate) -> None:
    """Write calibration.toml."""
    covariance = found.tip.covariance[:3, :3].tolist()
    write_table(file, _HEAD, {"kind": KIND} | figures | {"position_covariance": covariance})


def read_tool_calibration(file: Path) -> CalibratedToolFrame:
    """Read where the tool is on the flange.

    Raises:
        InputError: No such file, not the calibration of a tool frame, or a value that cannot be.
    """
    table = read_table(file, KIND, "a tool frame")
    quaternion = numbers_of(file, table, "quaternion_wxyz", (4,))
    if abs(np.linalg.norm(quaternion) - 1.0) > 1e-6:
        raise InputError(f"'{file}': quaternion_wxyz has length {np.linalg.norm(quaternion):.4g}, wanted 1.")
    R = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    T = transform(R, numbers_of(file, table, "position_m", (3,)))
    return CalibratedToolFrame(T, numbers_of(file, table, "position_covariance", (3, 3)))
