"""A tool's frame on the flange: its tip from touches of one fixed point, its axes from moves along them.

Every touch says R_i p + t_i = c with p the tip in the flange frame and c the point in the base frame (paper
2). Solved for both at once: differences between successive touches, as the paper has it, lose a fifth to a
third of the information.

Subtracting the mean of all leaves (R_i - mean R) p: the common part of the orientations gives no information.
With M = I - mean(R)^T mean(R) the covariance of p is sigma^2 M^-1 / n (paper 2): the best is a mean rotation
of zero, with 3D rms errors of sqrt(3 / n) sigma.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array, Bools, Figures, angles_between, norms, rms_length, unit
from polish_sim.calibration.fit import Fit, Problem, agreeing, fit, slopes_of
from polish_sim.calibration.tables import (
    QUATERNION,
    XYZ_MM,
    Measured,
    Quantity,
    mm_texts,
    quaternions_of,
    read_table,
    write_table,
)
from polish_sim.errors import CalibrationError, InputError, number_text
from polish_sim.spatial import matrices, place_of, transform, vectors_from_rotations
from polish_sim.tables import csv_text

LEAST_MOVE = 5e-3  #: Shortest move that gives a direction [m]
LEAST_SINE = 0.1  #: Least sine of the angle between the two moves
TCP = Quantity(
    "tcp",
    "The tool on the flange: its tip [m] and axes (unit quaternion wxyz), with standard deviations (_std), "
    "covariance of the tip [m^2, flange axes]. rotation_rad_std: small rotations about the tool's x, y, z.",
)
KIND_COLUMN, TOUCH, START, ALONG_X, IN_XZ = "kind", "touch", "start", "along_x", "in_xz"
MOVES = (START, ALONG_X, IN_XZ)
KINDS = (TOUCH, *MOVES)


class ToolPoint(Fit[Array]):
    """Tip and touched point: x [m], shape (6,); residuals: tip minus touched point, base frame [m], shape (n,
    3)."""

    @property
    def point(self) -> Array:
        """Tip in the flange frame [m], shape (3,)."""
        return self.x[:3]

    @property
    def touched(self) -> Array:
        """The touched point in the base frame [m], shape (3,)."""
        return self.x[3:]

    @property
    def std(self) -> Array:
        """Standard deviations of the tip [m], shape (3,)."""
        return super().std[:3]


def fit_tool_point(T_base_flange: Array, noise: float | None = None, used: Bools | None = None) -> ToolPoint:
    """Tip and touched point by least squares, efficient for equal Gaussian noise: covariance sigma^2 (A^T
    A)^-1.

    ``noise``: standard deviation of one coordinate of a touch [m], None takes it from the residuals;
    ``used``: touches to use, (n,), None uses all. Raises CalibrationError if the orientations cannot
    determine the tip.
    """
    R = T_base_flange[:, :3, :3]
    check_touches(R if used is None else R[used])
    return ToolPoint(**vars(fit(_problem(T_base_flange), np.zeros(6), noise, used)))


def _problem(T_base_flange: Array) -> Problem[Array]:
    """R_i p - c = -t_i for the unknowns p, c."""
    c = np.tile(-np.eye(3), (len(T_base_flange), 1, 1))
    A = np.concatenate([T_base_flange[:, :3, :3], c], axis=2)
    return Problem(lambda x: A @ x + T_base_flange[:, :3, 3], lambda _: A)


def refuse_far_off(residuals: Array, found: str, cure: str) -> None:
    """Refuse measurements (n, 3) [m] that what was ``found`` leaves further off than any are; ``cure``: what
    to look at."""
    left = rms_length(residuals)
    if left > LARGEST_LEFT:
        raise CalibrationError(f"{found}: they leave {number_text(1e3 * left, 2)} mm rms. {cure}")


TOOL_DOWN = np.diag([1.0, -1.0, -1.0])
LEAST_TOUCHES = 4
#: Least square root of an eigenvalue of M [-]: poses that differ by 3 deg rms about some axis
LEAST_SPREAD = 0.05
LARGEST_LEFT = 5e-3  #: No touches by hand, and no tracker, miss by more than this [m]


def orientation_spread(R_base_flange: Array) -> tuple[Array, Array]:
    """How far orientations (n, 3, 3) differ along each direction of the flange, least first, and those
    directions.

    Square roots of the eigenvalues of M, 0 to 1, shape (3,); the directions as columns (3, 3).
    """
    differences = R_base_flange - R_base_flange.mean(axis=0)
    _, values, directions = np.linalg.svd(differences.reshape(-1, 3), full_matrices=False)
    return values[::-1] / np.sqrt(len(R_base_flange)), directions[::-1].T


def check_touches(R_base_flange: Array) -> None:
    """Refuse orientations (n, 3, 3) that cannot determine the tool point; names the direction that is
    unseen."""
    count = len(R_base_flange)
    if count < LEAST_TOUCHES:
        raise CalibrationError(
            f"{count} touch{'es' if count != 1 else ''} cannot separate tool point and touched point: "
            f"{LEAST_TOUCHES} in different orientations are the least, ten are good."
        )
    spread, directions = orientation_spread(R_base_flange)
    if spread[1] < LEAST_SPREAD:
        raise CalibrationError(
            f"the flange stands nearly the same in all {count} touches (they differ by "
            f"{np.degrees(spread[2]):.2g} deg rms): tilt it and turn it between touches."
        )
    if spread[0] < LEAST_SPREAD:
        unseen = directions[:, 0]
        x, y, z = unseen * np.sign(unseen[np.abs(unseen).argmax()])
        raise CalibrationError(
            f"the direction ({x:.2f}, {y:.2f}, {z:.2f}) of the flange points the same way in all {count} "
            "touches: the tool point along it is unknown. Poses that only spin, or a cone without a spin of "
            "its own, do that; 'calibrate tcp' without --data writes poses that do not."
        )


def plan_touch_orientations(count: int, cone: float) -> Array:
    """Orientations R_base_flange (n, 3, 3) for touches of one point.

    With the tool tilted by theta towards n azimuths 2 pi k / n and turned about itself by twice the azimuth,
    the mean rotation is cos(theta) e_z e_z^T exactly, for every n >= 4: the best a cone of theta allows. The
    3D rms error is then sigma sqrt((2 + 1 / sin(theta)^2) / n), within 5% of the best possible from 62 deg
    on.

    Args:
        count: Number of touches, four or more.
        cone: Angle of the flange's z axis from straight down [rad], 3 to 90 deg; outside it a
            CalibrationError.
    """
    if count < LEAST_TOUCHES:
        raise CalibrationError(f"{count} touches are too few for a tool point: give {LEAST_TOUCHES} or more.")
    if not math.radians(3.0) <= cone <= math.radians(90.0):
        raise CalibrationError(
            f"a cone of {math.degrees(cone):g} deg: give 3 to 90 deg. Without a tilt the length "
            "of the tool stays unknown."
        )
    azimuth = 2.0 * np.pi * np.arange(count) / count
    # Spin within half a turn either way, as a wrist has it.
    spin = np.mod(2.0 * azimuth + np.pi, 2.0 * np.pi) - np.pi
    turns = Rotation.from_euler("ZYZ", np.column_stack([azimuth, np.full(count, cone), spin]))
    return TOOL_DOWN @ turns.as_matrix()


def point_error_bound(R_base_flange: Array, noise: float) -> float:
    """Least 3D rms error any unbiased estimate of the tip can have [m]: the Cramér-Rao bound.

    ``R_base_flange``: of the touches, (n, 3, 3); ``noise``: standard deviation of one coordinate of a touch
    [m].
    """
    spread, _ = orientation_spread(R_base_flange)
    return noise * rms_length(1.0 / (np.sqrt(len(R_base_flange)) * spread))


class ToolOrientation(NamedTuple):
    """How the tool stands on the flange."""

    R_flange_tool: Array  #: Shape (3, 3)
    covariance: Array  #: Of a small rotation about the tool's axes [rad^2], shape (3, 3)


def tip_positions_flange(T_base_flange: Array, point_flange: Array) -> Array:
    """Where the tip was, from the first pose's tip on, axes of the first flange [m], shape (m, 3).

    The flange should keep its orientation; what it turned by mistake is allowed for. ``T_base_flange``: the
    start first, (m, 4, 4); ``point_flange``: the tip in the flange frame [m], (3,).
    """
    tips = place_of(T_base_flange, point_flange)
    return (tips - tips[0]) @ T_base_flange[0, :3, :3]


def orientation_from_three_points(points: Array, noise: float) -> ToolOrientation:
    """Tool axes from a start, a move along the tool's +x and a move in its x-z plane, z positive
    (Gram-Schmidt).

    ``points``: the three tip positions, flange axes [m], (3, 3); ``noise``: of one coordinate [m]; the
    covariance is to first order. Raises CalibrationError for moves too short or both along one line.
    """
    moves = points[1:] - points[0]
    lengths = norms(moves)
    if lengths.min() < LEAST_MOVE:
        raise CalibrationError(
            f"a move of {1e3 * lengths.min():.2g} mm is too short to determine a direction: "
            f"move {1e3 * LEAST_MOVE:g} mm or more, 100 mm is good."
        )
    if np.sin(angles_between(*moves)) < LEAST_SINE:
        raise CalibrationError(
            "the move along x and the move in the x-z plane are nearly parallel: the second must leave the x "
            "axis."
        )
    R = _axes_of(points)

    def turned(step: Array) -> Array:
        return vectors_from_rotations(R.T @ _axes_of(points + step.reshape(3, 3)))

    J = slopes_of(turned, 9)
    return ToolOrientation(R, noise**2 * J @ J.T)


def _axes_of(points: Array) -> Array:
    """Axes (3, 3) of a tool whose tip was at three points (3, 3): start, along x, in the x-z plane."""
    x = unit(points[1] - points[0])
    across = points[2] - points[0]
    z = unit(across - (across @ x) * x)
    return np.column_stack([x, np.cross(z, x), z])


class ToolMeasurements(NamedTuple):
    """Touches of one fixed point, and moves of the tip along known directions of the tool."""

    touches: Array  #: Flange at each touch, base frame [m], shape (n, 4, 4)
    T_base_flange_moves: Array  #: Flange at start, along +x, in the x-z plane, (3, 4, 4); or none, (0, 4, 4)


@dataclass(frozen=True)
class ToolFrameEstimate:
    """Where the tool's tip is and how the tool stands, on the flange."""

    tip: ToolPoint
    #: None if no moves were measured: the tool then stands as the flange does
    orientation: ToolOrientation | None

    @property
    def T_flange_tool(self) -> Array:
        """Pose of the tool on the flange, shape (4, 4)."""
        R = np.eye(3) if self.orientation is None else self.orientation.R_flange_tool
        return transform(R, self.tip.point)


def fit_tool_frame(measured: ToolMeasurements, noise: float | None = None) -> ToolFrameEstimate:
    """Tip and axes of a tool; touches too far off to be noise are left out.

    ``noise``: standard deviation of one coordinate of the tip [m]; None takes it from the touches' residuals.
    Raises CalibrationError if poses or moves cannot determine the frame, or touches do not fit each other;
    with unknown noise also for touches no tip explains.
    """
    touches = measured.touches
    check_touches(touches[:, :3, :3])
    tip = fit_tool_point(touches, noise, agreeing(_problem(touches), np.zeros(6), "touches"))
    if noise is None:
        refuse_far_off(
            tip.residuals[tip.used],
            "no tip fits these touches",
            "Wanted are positions and orientations of the flange in the base, touch by touch, of one tool "
            "and one fixed point. Are columns swapped, is a sign lost, or are orientations in degrees or "
            "those of another frame?",
        )
    if len(measured.T_base_flange_moves) == 0:
        return ToolFrameEstimate(tip, None)
    points = tip_positions_flange(measured.T_base_flange_moves, tip.point)
    return ToolFrameEstimate(tip, orientation_from_three_points(points, tip.noise[0]))


def tool_figures(measured: ToolMeasurements, found: ToolFrameEstimate, noise: float | None = None) -> Figures:
    """An estimate under the names of calibration.toml and metrics.json; ``noise``: true one [m], if known."""
    tip = found.tip
    orientation = found.orientation
    figures: Figures = {
        "position_m": tip.point,
        "position_m_std": tip.std,
        "quaternion_wxyz": quaternions_of(found.T_flange_tool[:3, :3]),
        "touched_m": tip.touched,
        "noise_m": tip.noise[0],
        "position_std_m": np.linalg.norm(tip.std),
        "position_crb_m": point_error_bound(
            measured.touches[tip.used, :3, :3], tip.noise[0] if noise is None else noise
        ),
        "residual_rms_m": rms_length(tip.residuals[tip.used]),
        "touches": int(tip.used.sum()),
        "outliers": np.flatnonzero(~tip.used) + 1,
    }
    if orientation is not None:
        std = np.sqrt(np.diag(orientation.covariance))
        figures |= {"rotation_rad_std": std, "rotation_std_max_rad": std.max()}
    return figures


def write_tool_calibration(file: Path, figures: Figures, found: ToolFrameEstimate) -> None:
    """Write calibration.toml."""
    write_table(file, TCP, figures | {"position_covariance": found.tip.covariance[:3, :3]})


def read_tool_calibration(file: Path) -> Array:
    """T_flange_tool from a calibration.toml; InputError if it is not the calibration of a tool frame."""
    table = read_table(file, TCP.name)
    quaternion = table.numbers("quaternion_wxyz", (4,))
    if abs(np.linalg.norm(quaternion) - 1.0) > 1e-6:
        raise InputError(f"'{file}': quaternion_wxyz has length {np.linalg.norm(quaternion):.4g}, wanted 1.")
    return transform(matrices(quaternion), table.numbers("position_m", (3,)))


def read_tool_measurements(file: Path) -> ToolMeasurements:
    """Read flange poses of touches and moves of a real robot.

    Columns in any order: position of the flange ``x_mm..z_mm`` or ``x_m..z_m`` and its orientation as in
    `read_readings`; ``kind`` says what a line is, by default a touch: ``start``, ``along_x`` and ``in_xz``
    give the axes. Raises InputError naming the line.
    """
    columns = Measured.read(file, "flange pose", "flange poses")
    T = transform(columns.rotations("the flange"), columns.reached_points("the position of the flange"))
    kinds = _kinds(columns)
    touches = T[kinds == TOUCH]
    if not (kinds != TOUCH).any():
        return ToolMeasurements(touches, np.empty((0, 4, 4)))
    return ToolMeasurements(touches, T[[_the_one(columns, kinds, kind) for kind in MOVES]])


def _kinds(columns: Measured) -> NDArray[np.str_]:
    if KIND_COLUMN not in columns.texts:
        return np.full(len(columns), TOUCH)
    kinds = np.array([text.lower() or TOUCH for text in columns.texts[KIND_COLUMN]])
    columns.refuse(
        ~np.isin(kinds, KINDS), lambda row: f"unknown kind '{kinds[row]}'. Known: {', '.join(KINDS)}."
    )
    return kinds


def _the_one(columns: Measured, kinds: NDArray[np.str_], kind: str) -> int:
    rows = np.flatnonzero(kinds == kind)
    if len(rows) != 1:
        raise InputError(
            f"'{columns.file}' has {len(rows)} lines of the kind '{kind}', wanted one: the tool's axes are "
            f"found from {START}, {ALONG_X} and {IN_XZ}, one line each."
        )
    return rows[0]


def tool_table(measured: ToolMeasurements, found: ToolFrameEstimate) -> str:
    """Touches and moves, how far each touch is from the fit, and whether it was used, as CSV that reads
    back."""
    names = ["touch", KIND_COLUMN, *XYZ_MM, *QUATERNION, *(f"residual_{name}" for name in XYZ_MM), "used"]
    rows = []
    for k, T in enumerate(measured.touches):
        residual = [f"{1e3 * value:.6g}" for value in found.tip.residuals[k]]
        rows.append([*_pose(k, TOUCH, T), *residual, int(found.tip.used[k])])
    for k, (kind, T) in enumerate(zip(MOVES, measured.T_base_flange_moves, strict=False)):
        rows.append([*_pose(k, kind, T), 0, 0, 0, 1])
    return csv_text(names, rows)


def _pose(k: int, kind: str, T: Array) -> list[Any]:
    return [k + 1, kind, *mm_texts(T[:3, 3]), *(f"{value:.12g}" for value in quaternions_of(T[:3, :3]))]
