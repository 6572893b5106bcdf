"""Experiment ``calibrate arm``: two arms that are not as their tables say, and what puts that right (layer 9).

Kinematics and a tracker's noise only; arms and bases are planted anew by the seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.arm import (
    NOMINAL,
    ArmEstimate,
    PairTables,
    Tolerance,
    TrackedArm,
    fit_pair,
    fit_placement,
    pair_figures,
)
from polish_sim.calibration.frames import ROBOTS
from polish_sim.experiments.calibrate_base import TARGET, planted_bases

Array = NDArray[np.float64]

LOW, HIGH = np.radians([[-80, -140, 20, -180, -90, -90], [80, -50, 120, 0, 90, 90]])
"""Joint angles of the poses, drawn evenly between [rad]."""
CHECKS: Final = 400


@dataclass(frozen=True)
class ArmTrial:
    """Two arms with errors in their tables, measured by a tracker."""

    tolerance: Tolerance = field(default_factory=Tolerance)
    """Standard deviations of the planted errors."""
    noise: float = 3e-5
    """Of one coordinate of the tracker [m]."""
    poses: int = 60
    """Of each arm."""
    seed: int = 0


@dataclass(frozen=True)
class ArmsFound:
    """What a calibration leaves behind."""

    tracked: Mapping[str, TrackedArm]
    found: PairTables
    figures: dict[str, Any]
    """The keys of metrics.json."""
    true: PairTables | None = None
    """The arms as they are, if they are simulated."""


def calibrate_arm_from(tracked: Mapping[str, TrackedArm]) -> ArmsFound:
    """Calibrate from poses of real arms; there is no truth to compare with.

    Raises:
        CalibrationError: If they do not tell the arms.
    """
    found = fit_pair(tracked, None, Tolerance())
    return ArmsFound(tracked, found, pair_figures(tracked, found, Tolerance()))


def run_arm_calibration(trial: ArmTrial) -> ArmsFound:
    """Plant two arms with wrong tables, measure both, find them, and predict the relative tool point in other poses.

    The tool point is the target itself: what is left is the arms' and bases' error, not that of a tool calibration.

    Returns:
        Poses, tables and figures. Of the follower's tool point relative to the master's, in poses not measured:
        relative_error_nominal_m, rms with bases and targets calibrated and the tables taken as nominal;
        relative_error_m, rms with all of it calibrated jointly.
    """
    rng = np.random.default_rng([trial.seed, 13])
    true = planted_arms(trial.tolerance, planted_bases(rng).T_tracker, rng)
    tracked = simulate_tracked(true, trial.poses, trial.noise, rng)
    q = {robot: rng.uniform(LOW, HIGH, (CHECKS, 6)) for robot in ROBOTS}
    found = fit_pair(tracked, max(trial.noise, 1e-9), trial.tolerance)
    nominal = PairTables({robot: fit_placement(one) for robot, one in tracked.items()})
    figures = pair_figures(tracked, found, trial.tolerance) | {
        "relative_error_nominal_m": _relative_error(nominal, true, q),
        "relative_error_m": _relative_error(found, true, q),
        "seed": trial.seed,
    }
    return ArmsFound(tracked, found, figures, true)


def planted_arms(tolerance: Tolerance, T_tracker_base: Mapping[str, Array], rng: np.random.Generator) -> PairTables:
    """Arms off their table by as much, where they stand before the tracker."""
    return PairTables({robot: built_arm(wrong_table(tolerance, rng), T_tracker_base[robot]) for robot in ROBOTS})


def built_arm(table: Array, T_tracker_base: Array) -> ArmEstimate:
    """An arm as it really is, the tracker's target on its flange."""
    return ArmEstimate(table, T_tracker_base, TARGET, np.empty((0, 3)), np.zeros((6, 6)))


def wrong_table(tolerance: Tolerance, rng: np.random.Generator) -> Array:
    """A table off the nominal one by normal errors of these standard deviations, shape (4, 6)."""
    spread = np.array([[tolerance.angle], [tolerance.length], [tolerance.length], [tolerance.angle]])
    return NOMINAL + spread * rng.standard_normal((4, 6))


def simulate_tracked(true: PairTables, poses: int, noise: float, rng: np.random.Generator) -> dict[str, TrackedArm]:
    """Each arm holds its target still in poses all over its workspace before the tracker."""
    tracked = {}
    for robot, arm in true.arms.items():
        q = rng.uniform(LOW, HIGH, (poses, 6))
        tracked[robot] = TrackedArm(q, arm.target_at(q) + noise * rng.standard_normal((poses, 3)))
    return tracked


def _relative_error(found: PairTables, true: PairTables, q: Mapping[str, Array]) -> float:
    off = {robot: found.arms[robot].target_at(q[robot]) - true.arms[robot].target_at(q[robot]) for robot in ROBOTS}
    return float(np.sqrt(np.mean(np.sum((off[ROBOTS[1]] - off[ROBOTS[0]]) ** 2, axis=1))))
