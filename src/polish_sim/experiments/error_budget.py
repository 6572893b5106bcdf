"""Error budget of two calibrated arms: from an instrument's noise to the tool on the part (layer 9).

The follower's tip relative to the master's, both arms exactly as their tables say: what is left is calibration. To
first order the error is R2 dp2 - R1 dp1 + (d + phi x r): dp are the tips' errors on their flanges, d and phi those
of the follower's base in the master's, r runs from that base to the tip.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.frames import ROBOTS, base_from_meeting_axes, fit_circle, point_covariance, relative_frame
from polish_sim.calibration.tool import fit_tool_point
from polish_sim.experiments.calibrate_base import BaseTrial, planted_bases, simulate_arcs
from polish_sim.experiments.calibrate_tcp import TOOL_DOWN, TcpTrial, planted_tool, simulate_touches
from polish_sim.spatial import apply, inverse

Array = NDArray[np.float64]

R_MASTER, R_FOLLOWER = np.diag([-1.0, 1.0, -1.0]), TOOL_DOWN
"""How the flanges stand in their own bases while they work."""
MEETING_POINT = np.array([-0.5, -0.1, 0.45])
"""Where the tools meet, master base [m]: half way between the bases."""


@dataclass(frozen=True)
class BudgetTrial:
    """Calibrations of two tools and two bases, again and again."""

    tool: TcpTrial = field(default_factory=TcpTrial)
    base: BaseTrial = field(default_factory=BaseTrial)
    draws: int = 200
    seed: int = 0


class Share(NamedTuple):
    """What one calibration does to the relative tool position, 3D rms."""

    drawn: float
    """Over the draws [m]."""
    stated: float
    """By the calibrations' own covariances [m]."""


class ErrorBudget(NamedTuple):
    """Where the error of the tool on the part comes from."""

    shares: dict[str, Share]
    """master tool, follower tool, bases, all."""
    errors: Array
    """Relative tool position, found minus true, master base, draw by draw [m], shape (n, 3)."""

    @property
    def p95(self) -> float:
        """Size of the error that 95% stay below [m]."""
        return float(np.percentile(np.linalg.norm(self.errors, axis=1), 95.0))


def run_error_budget(trial: BudgetTrial) -> ErrorBudget:
    """Draw calibrations and compare the errors at the tool with what their covariances say.

    Args:
        trial: Noise and poses of tools and bases, number of draws.

    Returns:
        Shares and errors.
    """
    rng = np.random.default_rng([trial.seed, 14])
    drawn, stated = [], []
    for _ in range(trial.draws):
        tips = [_tip(trial.tool, rng) for _ in ROBOTS]
        base = _base(trial.base, rng)
        parts = [-R_MASTER @ tips[0][0], base[2] @ R_FOLLOWER @ tips[1][0], base[0]]
        drawn.append(parts)
        stated.append([np.trace(tips[0][1]), np.trace(tips[1][1]), np.trace(base[1])])
    errors, variances = np.array(drawn), np.mean(stated, axis=0)
    names = ("master tool", "follower tool", "bases")
    shares = {name: Share(_rms(errors[:, k]), float(np.sqrt(variances[k]))) for k, name in enumerate(names)}
    total = errors.sum(axis=1)
    shares["all"] = Share(_rms(total), float(np.sqrt(variances.sum())))
    return ErrorBudget(shares, total)


def _tip(trial: TcpTrial, rng: np.random.Generator) -> tuple[Array, Array]:
    """Error of a tip on its flange and its covariance."""
    T_flange_tool = planted_tool(rng)
    found = fit_tool_point(simulate_touches(trial, T_flange_tool, rng).touches, trial.noise)
    return found.point - T_flange_tool[:3, 3], found.covariance[:3, :3]


def _base(trial: BaseTrial, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Error at the meeting point through the follower's base, its covariance, and how that base stands."""
    truth = planted_bases(rng)
    arcs = simulate_arcs(truth, trial.points or 200, trial.noise, rng).arcs
    bases = {r: base_from_meeting_axes(*(fit_circle(points, trial.noise) for points in arcs[r])) for r in ROBOTS}
    first, second = (bases[robot] for robot in ROBOTS)
    T, covariance = relative_frame(first.T, first.covariance, second.T, second.covariance)
    point_follower = apply(inverse(truth.T_master_follower), MEETING_POINT[None])
    error = apply(T, point_follower)[0] - MEETING_POINT
    return error, point_covariance(covariance, MEETING_POINT - T[:3, 3]), truth.T_master_follower[:3, :3]


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
