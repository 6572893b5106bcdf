"""Tables, bases and targets of two arms from one tracker: what a run with two robots computes with (layer 8b)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.arm.fit import LEAST_POSES, ArmEstimate, Tolerance, TrackedArm, fit_arm, fit_placement
from polish_sim.calibration.frames import ROBOTS
from polish_sim.calibration.frames.relative import relative_frame

Array = NDArray[np.float64]

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
