"""An arm's table, its base and the tracker's target on its flange from tracked poses, all jointly.

Least squares of where the tracker saw the target, with what is known beforehand: the nominal table and how far a built
arm may be from it. That also settles what no measurement tells, such as sliding three parallel axes along themselves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.dual.calibration.matched_points import kabsch, relative_frame
from polish_sim.dual.calibration.measurements import ROBOTS
from polish_sim.errors import CalibrationError
from polish_sim.motion.kinematics import NOMINAL, link_frames, table_slopes
from polish_sim.spatial import apply, skew, transform

Array = NDArray[np.float64]

LEAST_POSES = 20
_ROUNDS = 20
_PLACEMENT = 9


class TrackedArm(NamedTuple):
    """Poses of one arm and where a tracker saw the target on its flange."""

    q: Array
    """Joint angles as read [rad], shape (n, 6)."""
    seen: Array
    """Target, tracker frame [m], shape (n, 3)."""


class Tolerance(NamedTuple):
    """How far a built arm may be from its table, standard deviations."""

    length: float = 5e-4
    """Of d and a [m]."""
    angle: float = float(np.radians(0.02))
    """Of joint offsets and alpha [rad]."""


class ArmEstimate(NamedTuple):
    """An arm as it is."""

    table: Array
    """Shape (4, 6)."""
    T_tracker_base: Array
    """Shape (4, 4)."""
    target: Array
    """On the flange [m], shape (3,)."""
    residuals: Array
    """Seen minus predicted [m], shape (n, 3)."""
    base_covariance: Array
    """Of the base's origin [m] and rotation [rad], tracker axes, whatever the table is, shape (6, 6)."""

    def target_at(self, q: Array) -> Array:
        """Where the target is, tracker frame [m], shape (n, 3)."""
        return _predict(self, q)[1]


def fit_arm(tracked: TrackedArm, noise: float, tolerance: Tolerance | None = None) -> ArmEstimate:
    """Table, base and target of an arm.

    Args:
        tracked: Twenty poses or more, all joints well moved.
        noise: Standard deviation of one coordinate of the tracker [m].
        tolerance: How far the arm may be from the nominal table.

    Returns:
        The most probable arm.

    Raises:
        CalibrationError: Fewer poses than needed.
    """
    tolerance = tolerance or Tolerance()
    spread = np.repeat([tolerance.angle, tolerance.length, tolerance.length, tolerance.angle], 6)
    return _refined(tracked, np.concatenate([np.full(_PLACEMENT, np.inf), spread]), max(noise, 1e-9))


def fit_placement(tracked: TrackedArm) -> ArmEstimate:
    """Base and target alone, the table taken as nominal: what is left is the table's fault.

    Raises:
        CalibrationError: Fewer poses than needed.
    """
    return _refined(tracked, np.concatenate([np.full(_PLACEMENT, np.inf), np.zeros(24)]), 1.0)


def _refined(tracked: TrackedArm, spread: Array, noise: float) -> ArmEstimate:
    """Gauss-Newton; ``spread`` of each unknown about its nominal value, 0 keeps it there."""
    if len(tracked.q) < LEAST_POSES:
        raise CalibrationError(
            f"{len(tracked.q)} poses cannot tell an arm's table (33 unknowns): give {LEAST_POSES} or more, 60 are good."
        )
    free = spread > 0.0
    weight = np.where(free, noise / np.where(free, spread, 1.0), 0.0)[free]
    arm = _start(tracked)
    for _ in range(_ROUNDS):
        frames, points = _predict(arm, tracked.q)
        J = _slopes(arm, frames, points)[:, :, free].reshape(-1, int(free.sum()))
        off = np.concatenate([np.zeros(_PLACEMENT), (NOMINAL - arm.table).ravel()])[free]
        rows, right = (
            np.concatenate([J, np.diag(weight)]),
            np.concatenate([(tracked.seen - points).ravel(), weight * off]),
        )
        step = np.zeros(len(free))
        step[free] = np.linalg.lstsq(rows, right, rcond=1e-14)[0]
        arm = _moved(arm, step)
        if np.abs(step).max() < 1e-13:
            break
    covariance = noise**2 * np.linalg.pinv(rows.T @ rows)[:6, :6]
    return arm._replace(residuals=tracked.seen - _predict(arm, tracked.q)[1], base_covariance=covariance)


def _start(tracked: TrackedArm) -> ArmEstimate:
    """The nominal arm, the target on the flange's origin, the base by matched points."""
    own = link_frames(tracked.q)[:, 6, :3, 3]
    stretch = float(np.linalg.norm(np.std(tracked.seen, axis=0)) / np.linalg.norm(np.std(own, axis=0)))
    if not 0.5 < stretch < 2.0:
        raise CalibrationError(
            f"the tracker saw the target move {stretch:.3g} times as far as the arm did: are units mixed (mm, m)?"
        )
    T = kabsch(tracked.seen, own, np.ones(len(own)))
    return ArmEstimate(NOMINAL, T, np.zeros(3), tracked.seen - apply(T, own), np.zeros((6, 6)))


def _predict(arm: ArmEstimate, q: Array) -> tuple[Array, Array]:
    """All frames and the target as the tracker sees them, shapes (n, 7, 4, 4) and (n, 3)."""
    frames = arm.T_tracker_base @ link_frames(q, arm.table)
    return frames, frames[:, 6, :3, :3] @ arm.target + frames[:, 6, :3, 3]


def _slopes(arm: ArmEstimate, frames: Array, points: Array) -> Array:
    """Derivative of the target by base (6), target (3) and table (24), shape (n, 3, 33)."""
    arms = points - arm.T_tracker_base[:3, 3]
    base = np.stack([np.concatenate([np.eye(3), -skew(v)], axis=1) for v in arms])
    return np.concatenate([base, frames[:, 6, :3, :3], table_slopes(frames, points)], axis=2)


def _moved(arm: ArmEstimate, step: Array) -> ArmEstimate:
    R = Rotation.from_rotvec(step[3:6]).as_matrix() @ arm.T_tracker_base[:3, :3]
    T = transform(R, arm.T_tracker_base[:3, 3] + step[:3])
    return arm._replace(table=arm.table + step[9:].reshape(4, 6), T_tracker_base=T, target=arm.target + step[6:9])


# Tables, bases and targets of two arms from one tracker: what a run with two robots computes with.

FOLDS = 5
"""Parts of the poses that are predicted from the others in turn."""
USUAL_NOISE = 3e-5
"""Of a laser tracker, per coordinate [m]."""


class PairTables(NamedTuple):
    """Two arms as they are built, robot by robot."""

    arms: Mapping[str, ArmEstimate]

    @property
    def tables(self) -> Mapping[str, Array]:
        """Each (4, 6)."""
        return {robot: arm.table for robot, arm in self.arms.items()}

    @property
    def bases(self) -> tuple[Array, Array]:
        """The follower's base in the master's, (4, 4), and its covariance, (6, 6): with these tables and no others."""
        master, follower = (self.arms[robot] for robot in ROBOTS)
        return relative_frame(
            master.T_tracker_base, master.base_covariance, follower.T_tracker_base, follower.base_covariance
        )

    @property
    def T_master_follower(self) -> Array:
        """The follower's base in the master's, shape (4, 4)."""
        return self.bases[0]


def fit_pair(tracked: Mapping[str, TrackedArm], noise: float | None, tolerance: Tolerance) -> PairTables:
    """Both arms, each from its own poses.

    Args:
        tracked: What the tracker saw, robot by robot.
        noise: Standard deviation of one coordinate [m]; None: that of a good tracker, then what the fit leaves.
        tolerance: How far an arm may be from the nominal table.

    Raises:
        CalibrationError: Too few poses, or units mixed.
    """
    found = {robot: fit_arm(one, USUAL_NOISE if noise is None else noise, tolerance) for robot, one in tracked.items()}
    if noise is None:
        found = {robot: fit_arm(one, residual_rms([found[robot]]), tolerance) for robot, one in tracked.items()}
    return PairTables(found)


def held_out_rms(tracked: Mapping[str, TrackedArm], noise: float, tolerance: Tolerance) -> float:
    """Distance from where the tracker saw the target to where arms found from the other poses say, rms [m].

    Undefined (NaN) where too few poses would be left to find an arm.
    """
    if min(len(one.q) for one in tracked.values()) < FOLDS / (FOLDS - 1) * LEAST_POSES:
        return math.nan
    squares: list[Array] = []
    for one in tracked.values():
        fold = np.arange(len(one.q)) % FOLDS
        for k in range(FOLDS):
            found = fit_arm(TrackedArm(one.q[fold != k], one.seen[fold != k]), noise, tolerance)
            squares.append(np.sum((one.seen[fold == k] - found.target_at(one.q[fold == k])) ** 2, axis=1))
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def pair_figures(tracked: Mapping[str, TrackedArm], found: PairTables, tolerance: Tolerance) -> dict[str, Any]:
    """A calibration under the names of metrics.json.

    Returns:
        poses; residual_rms_m: of one coordinate; nominal_rms_m: distance left if only base and target are fitted;
        heldout_rms_m: distance in poses that were left out in turn; transform: T_master_follower.
    """
    noise = residual_rms(list(found.arms.values()))
    nominal = [np.sum(fit_placement(one).residuals ** 2, axis=1) for one in tracked.values()]
    return {
        "poses": sum(len(one.q) for one in tracked.values()),
        "residual_rms_m": noise,
        "nominal_rms_m": float(np.sqrt(np.mean(np.concatenate(nominal)))),
        "heldout_rms_m": held_out_rms(tracked, noise, tolerance),
        "transform": found.T_master_follower.tolist(),
    }


def residual_rms(arms: list[ArmEstimate]) -> float:
    """Of one coordinate of a pose [m]."""
    return float(np.sqrt(np.mean(np.concatenate([arm.residuals.ravel() for arm in arms]) ** 2)))
