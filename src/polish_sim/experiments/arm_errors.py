"""Study: arms that are not as their table says, and the joint calibration that puts that right (layer 9)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.arm import NOMINAL, ArmEstimate, Tolerance, TrackedArm, fit_arm, fit_placement
from polish_sim.calibration.frames import ROBOTS
from polish_sim.experiments.calibrate_base import TARGET, planted_bases

Array = NDArray[np.float64]

LOW, HIGH = np.radians([[-80, -140, 20, -180, -90, -90], [80, -50, 120, 0, 90, 90]])
"""Joint angles of the poses, drawn evenly between [rad]."""
CHECKS: Final = 400


@dataclass(frozen=True)
class ArmErrorTrial:
    """Two arms with errors in their tables, measured by a tracker."""

    tolerance: Tolerance = field(default_factory=Tolerance)
    """Standard deviations of the injected errors."""
    noise: float = 3e-5
    """Of one coordinate of the tracker [m]."""
    poses: int = 60
    seed: int = 0


class ArmErrorResult(NamedTuple):
    """Rms error of the follower's tool point relative to the master's in poses not measured [m]."""

    nominal: float
    """Bases and targets calibrated, tables taken as nominal."""
    calibrated: float
    """Tables, bases and targets calibrated jointly."""


def run_arm_errors(trial: ArmErrorTrial) -> ArmErrorResult:
    """Plant two arms with wrong tables, measure both, and predict the relative tool point both ways.

    The tool point is the target itself: what is left is the arms' and bases' error, not that of a tool calibration.
    """
    rng = np.random.default_rng([trial.seed, 13])
    bases = planted_bases(rng).T_tracker
    truth = {robot: ArmEstimate(_wrong_table(trial, rng), bases[robot], TARGET, np.empty((0, 3))) for robot in ROBOTS}
    tracked = {robot: _measured(trial, arm, rng) for robot, arm in truth.items()}
    q = {robot: rng.uniform(LOW, HIGH, (CHECKS, 6)) for robot in ROBOTS}
    nominal = {robot: fit_placement(one) for robot, one in tracked.items()}
    joint = {robot: fit_arm(one, trial.noise, trial.tolerance) for robot, one in tracked.items()}
    return ArmErrorResult(*(_relative_error(found, truth, q) for found in (nominal, joint)))


def _wrong_table(trial: ArmErrorTrial, rng: np.random.Generator) -> Array:
    angle, length = trial.tolerance.angle, trial.tolerance.length
    return NOMINAL + np.array([[angle], [length], [length], [angle]]) * rng.standard_normal((4, 6))


def _measured(trial: ArmErrorTrial, arm: ArmEstimate, rng: np.random.Generator) -> TrackedArm:
    q = rng.uniform(LOW, HIGH, (trial.poses, 6))
    return TrackedArm(q, arm.target_at(q) + trial.noise * rng.standard_normal((trial.poses, 3)))


def _relative_error(found: dict[str, ArmEstimate], truth: dict[str, ArmEstimate], q: dict[str, Array]) -> float:
    off = {robot: found[robot].target_at(q[robot]) - truth[robot].target_at(q[robot]) for robot in ROBOTS}
    return float(np.sqrt(np.mean(np.sum((off[ROBOTS[1]] - off[ROBOTS[0]]) ** 2, axis=1))))
