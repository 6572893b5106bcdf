"""A tool frame's files: touches and moves as CSV in and out, calibration.toml out, and the tool a run takes from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.calibration.tables import QUATERNION, Kind, Measured, read_table, write_table
from polish_sim.dual.calibration.tool import ToolFrameEstimate, ToolMeasurements
from polish_sim.dual.calibration.tool_checks import ToolTouches, point_error_bound
from polish_sim.errors import InputError
from polish_sim.spatial import transform
from polish_sim.tables import csv_text

TCP: Final = Kind(
    "tcp",
    "a tool frame",
    "The tool on the flange: its tip [m] and axes (unit quaternion wxyz), with standard deviations (_std), covariance "
    "of the tip [m^2, flange axes]. rotation_rad_std: small rotations about the tool's x, y, z.",
)
KIND_COLUMN, TOUCH, START, ALONG_X, IN_XZ, MOVE = "kind", "touch", "start", "along_x", "in_xz", "move"
KINDS: Final = (TOUCH, START, ALONG_X, IN_XZ, MOVE)
POSITION: Final = ("x_mm", "y_mm", "z_mm")
MOVED: Final = ("move_x_mm", "move_y_mm", "move_z_mm")


def tool_figures(measured: ToolMeasurements, found: ToolFrameEstimate, noise: float | None = None) -> dict[str, Any]:
    """An estimate under the names of calibration.toml and metrics.json.

    Args:
        measured: Touches and moves.
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
        "noise_m": float(tip.noise[0]),
        "position_std_m": float(np.linalg.norm(tip.std)),
        "position_crb_m": point_error_bound(
            measured.touches.R[tip.used], float(tip.noise[0]) if noise is None else noise
        ),
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
    write_table(file, TCP, figures | {"position_covariance": found.tip.covariance[:3, :3].tolist()})


def read_tool_calibration(file: Path) -> Array:
    """Read the tool on the flange, T_flange_tool, shape (4, 4).

    Raises:
        InputError: No such file, not the calibration of a tool frame, or a value that cannot be.
    """
    table = read_table(file, TCP)
    quaternion = table.numbers("quaternion_wxyz", (4,))
    if abs(np.linalg.norm(quaternion) - 1.0) > 1e-6:
        raise InputError(f"'{file}': quaternion_wxyz has length {np.linalg.norm(quaternion):.4g}, wanted 1.")
    R = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return transform(R, table.numbers("position_m", (3,)))


def read_tool_measurements(file: Path) -> ToolMeasurements:
    """Read flange poses of touches and moves of a real robot.

    Columns in any order: position of the flange ``x_mm..z_mm`` or ``x_m..z_m`` and its orientation as in
    `read_readings`; ``kind`` says what a line is, by default a touch: ``start``, ``along_x`` and ``in_xz`` give the
    axes, or ``start`` and any ``move`` by ``move_x_mm..move_z_mm`` in tool axes.

    Raises:
        InputError: No such file, a column missing, units mixed, a value that is none; names the line.
        CalibrationError: A pose that is none.
    """
    columns = Measured.read(file, "flange pose", "flange poses")
    T = transform(columns.rotations("the flange"), columns.reached_points("", "the position of the flange"))
    kinds = _kinds(columns)
    touches = ToolTouches(T[kinds == TOUCH])
    if not (kinds != TOUCH).any():
        return ToolMeasurements(touches, np.empty((0, 4, 4)))
    order = [_the_one(columns, kinds, START)]
    if (kinds != MOVE).all():
        order += [_the_one(columns, kinds, kind) for kind in (ALONG_X, IN_XZ)]
        return ToolMeasurements(touches, T[order])
    columns.need(MOVED, "how far a move went, tool axes")
    rows = np.flatnonzero(kinds == MOVE)
    moves = 1e-3 * columns.rows(kinds == MOVE).numbers(MOVED)
    return ToolMeasurements(touches, T[[*order, *rows]], np.concatenate([np.zeros((1, 3)), moves]))


def _kinds(columns: Measured) -> NDArray[np.str_]:
    if KIND_COLUMN not in columns.texts:
        return np.full(len(columns), TOUCH)
    kinds = [text.lower() or TOUCH for text in columns.texts[KIND_COLUMN]]
    for row, kind in enumerate(kinds):
        if kind not in KINDS:
            raise InputError(
                f"'{columns.file}', {columns.place(row)}: unknown kind '{kind}'. Known: {', '.join(KINDS)}."
            )
    return np.array(kinds)


def _the_one(columns: Measured, kinds: NDArray[np.str_], kind: str) -> int:
    rows = np.flatnonzero(kinds == kind)
    if len(rows) != 1:
        raise InputError(
            f"'{columns.file}' has {len(rows)} lines of the kind '{kind}', wanted one: the tool's axes are found from "
            f"{START}, {ALONG_X} and {IN_XZ}, one line each, or from {START} and several of {MOVE}."
        )
    return int(rows[0])


def tool_table(measured: ToolMeasurements, found: ToolFrameEstimate) -> str:
    """Touches and moves, how far each touch is from the fit, and whether it was used, as CSV that reads back."""
    names = ["touch", KIND_COLUMN, *POSITION, *QUATERNION, *(f"residual_{axis}_mm" for axis in "xyz"), "used"]
    names += list(MOVED) if measured.moves_tool is not None else []
    moves = np.zeros((0, 3)) if measured.moves_tool is None else measured.moves_tool
    rows = []
    for k, T in enumerate(measured.touches.T_base_flange):
        residual = [f"{1e3 * value:.6g}" for value in found.tip.residuals[k]]
        rows.append([*_pose(k, TOUCH, T), *residual, int(found.tip.used[k]), *([0, 0, 0] if len(moves) else [])])
    kinds = (START, ALONG_X, IN_XZ) if measured.moves_tool is None else (START, *[MOVE] * len(moves))
    for k, (kind, T) in enumerate(zip(kinds, measured.T_base_flange_moves, strict=False)):
        moved = [f"{1e3 * value:.9g}" for value in moves[k]] if len(moves) else []
        rows.append([*_pose(k, kind, T), 0, 0, 0, 1, *moved])
    return csv_text(names, rows)


def _pose(k: int, kind: str, T: Array) -> list[Any]:
    turn = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True, scalar_first=True)
    return [k + 1, kind, *(f"{1e3 * value:.9g}" for value in T[:3, 3]), *(f"{value:.12g}" for value in turn)]
