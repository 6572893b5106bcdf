"""An arm's table, its base and the tracker's target on its flange from tracked poses, all jointly (layer 8b).

Least squares of where the tracker saw the target, with what is known beforehand: the nominal table and how far a built
arm may be from it. That also settles what no measurement tells, such as sliding three parallel axes along themselves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.calibration.frames.matched_points import kabsch
from polish_sim.errors import CalibrationError
from polish_sim.motion.arm_table import NOMINAL, arm_frames, table_slopes
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
    own = arm_frames(NOMINAL, tracked.q)[:, 6, :3, 3]
    stretch = float(np.linalg.norm(np.std(tracked.seen, axis=0)) / np.linalg.norm(np.std(own, axis=0)))
    if not 0.5 < stretch < 2.0:
        raise CalibrationError(
            f"the tracker saw the target move {stretch:.3g} times as far as the arm did: are units mixed (mm, m)?"
        )
    T = kabsch(tracked.seen, own, np.ones(len(own)))
    return ArmEstimate(NOMINAL, T, np.zeros(3), tracked.seen - apply(T, own), np.zeros((6, 6)))


def _predict(arm: ArmEstimate, q: Array) -> tuple[Array, Array]:
    """All frames and the target as the tracker sees them, shapes (n, 7, 4, 4) and (n, 3)."""
    frames = arm.T_tracker_base @ arm_frames(arm.table, q)
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
