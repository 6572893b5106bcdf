"""Error budget of the tool on the part, two arms calibrated as `run dual` calibrates them (layer 9).

Noise of tracker and touches goes through the calibrations of bases, tool and part to the tool's place on the rim:
once to first order, by covariances, and once drawn, each source alone and all together. To first order the error is,
in the part's axes, R_work_flange (t + psi x r_mark) - R_work_master (d + phi x r_base) - R_work_tool R_tool_flange p:
d, phi of the follower's base in the master's, t, psi of the part on its flange, p of the tip on its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.error_size import length_quantile
from polish_sim.calibration.frames import ROBOTS, point_covariance
from polish_sim.calibration.tool import fit_tool_point
from polish_sim.config import DualConfig
from polish_sim.experiments.calibrate_base import TrueBases, simulate_arcs
from polish_sim.experiments.calibrate_tcp import TOOL_DOWN, TcpTrial, simulate_touches
from polish_sim.experiments.pair_frames import (
    ARC_POINTS,
    T_TRACKER_MASTER,
    PairFrames,
    calibrated_frames,
    tool_errors,
    true_chain,
)
from polish_sim.experiments.pair_placement import default_poses
from polish_sim.motion.coordination import Chain2
from polish_sim.spatial import apply, skew, transform

Array = NDArray[np.float64]

SOURCES: Final[Mapping[str, str]] = MappingProxyType(
    {"bases": "T_master_follower", "tool": "T_flange_tool", "part": "T_flange_gripper"}
)
"""What is calibrated, and the link of the chain its error sits in: the part's is told together with the gripper's."""
TOGETHER: Final = "together"
ARC_DESIGNS: Final = 20
"""Sets of measured arcs the bases' covariance is averaged over: a tracker takes its points where it will."""


@dataclass(frozen=True)
class PairBudgetTrial:
    """Calibrations of two robots, again and again, and the rim they are to work on."""

    dual: DualConfig = field(default_factory=DualConfig)
    draws: int = 300
    seed: int = 0
    rim_radius: float = 0.08
    """Of the rim, about that of the hub [m]."""
    rim_height: float = 0.038
    """Above the part's origin [m]."""
    points: int = 24
    """Places on it where the error is looked at."""

    @property
    def T_work_tool(self) -> Array:
        """The tool on the rim, its z axis into the part, shape (points, 4, 4)."""
        return transform(np.tile(TOOL_DOWN, (self.points, 1, 1)), self._around(self.points))

    @property
    def marks(self) -> Array:
        """Points that are touched to find the part, evenly around the rim [m], shape (dual.marks, 3)."""
        return self._around(self.dual.marks)

    @property
    def T_master_work(self) -> Array:
        """Where the part is held: the first place `run dual` tries, base of the master, shape (4, 4)."""
        return next(default_poses(true_chain(self.dual), np.array([0.0, 0.0, 1.0]), np.zeros(3)))

    def _around(self, count: int) -> Array:
        angle = 2.0 * np.pi * np.arange(count) / count
        x, y = self.rim_radius * np.cos(angle), self.rim_radius * np.sin(angle)
        return np.stack([x, y, np.full(count, self.rim_height)], axis=1)


class Share(NamedTuple):
    """What one source, or all, does to the tool on the part."""

    predicted_rms_m: float
    """To first order, by covariances."""
    drawn_rms_m: float
    drawn_rms_std_m: float
    """How well the draws tell their rms."""
    predicted_p95_m: float
    """95% of the errors, over calibrations and places, are no larger."""
    drawn_p95_m: float
    predicted_axial_share: float
    """Of the mean square, what lies along the tool axis: pressed on the part, the force loop takes it."""
    drawn_axial_share: float
    predicted_across_rms_m: float
    """What is left for the force loop not to take."""
    drawn_across_rms_m: float

    @property
    def deviation_sigma(self) -> float:
        """Drawn minus predicted, over how well the draws tell it."""
        return (self.drawn_rms_m - self.predicted_rms_m) / self.drawn_rms_std_m if self.drawn_rms_std_m else 0.0


def predict_covariances(trial: PairBudgetTrial) -> dict[str, Array]:
    """Covariance of the tool's place on the part by source and together, to first order.

    Args:
        trial: Noise, marks, rim.

    Returns:
        By source [m^2], work frame, each (points, 3, 3).
    """
    true = true_chain(trial.dual)
    tip = _tip_covariance(trial.dual.touch_noise_m)
    R_work_flange = trial.T_work_tool[:, :3, :3] @ true.T_flange_tool[:3, :3].T
    found = {
        "bases": _bases_covariances(trial, true),
        "tool": R_work_flange @ tip @ np.swapaxes(R_work_flange, 1, 2),
        "part": _part_covariances(trial, true, tip),
    }
    return found | {TOGETHER: np.sum(list(found.values()), axis=0)}


def draw_errors(trial: PairBudgetTrial) -> Iterator[dict[str, Array]]:
    """Calibrate again and again, through the whole chain: nothing is linear here.

    Yields:
        Draw by draw, by source and together: from the tool as wanted to the tool as it is, work frame [m],
        each (points, 3).
    """
    rng = np.random.default_rng([trial.seed, 15])
    T_master_work, T_work_tool, marks = trial.T_master_work, trial.T_work_tool, trial.marks
    for _ in range(trial.draws):
        true, believed = calibrated_frames(trial.dual, marks, rng)
        chains = {name: true._replace(**{link: getattr(believed, link)}) for name, link in SOURCES.items()}
        chains[TOGETHER] = believed
        yield {name: tool_errors(PairFrames(true, chain), T_master_work, T_work_tool) for name, chain in chains.items()}


def compare_shares(
    trial: PairBudgetTrial, covariances: Mapping[str, Array], errors: Mapping[str, Array]
) -> dict[str, Share]:
    """Predicted beside drawn, source by source.

    Args:
        trial: What was predicted and drawn.
        covariances: By source [m^2], each (points, 3, 3).
        errors: By source [m], each (draws, points, 3); two draws or more.
    """
    axes = trial.T_work_tool[:, :3, 2]
    return {name: _share(covariances[name], errors[name], axes) for name in covariances}


def budget_figures(
    trial: PairBudgetTrial, shares: Mapping[str, Share], errors: Array, asked_rms: float
) -> tuple[dict[str, float], dict[str, float]]:
    """The figures of the whole, as analysis and as the draws have them.

    Args:
        trial: What was predicted and drawn.
        shares: By source and together.
        errors: Together, draw by draw, work frame [m], shape (draws, points, 3).
        asked_rms: Calibrations with a larger rms around the rim are counted [m].

    Returns:
        Predicted ones, and the keys of metrics.json.
    """
    whole, axes = shares[TOGETHER], trial.T_work_tool[:, :3, 2]
    across = errors - np.einsum("dnk,nk->dn", errors, axes)[..., None] * axes
    each = np.sqrt(np.mean(np.sum(errors**2, axis=2), axis=1))
    predicted = {
        "relative_error_rms_m": whole.predicted_rms_m,
        "relative_error_p95_m": whole.predicted_p95_m,
        "across_error_rms_m": whole.predicted_across_rms_m,
        "axial_share": whole.predicted_axial_share,
    }
    drawn = {
        "relative_error_rms_m": whole.drawn_rms_m,
        "relative_error_p95_m": whole.drawn_p95_m,
        "across_error_rms_m": whole.drawn_across_rms_m,
        "across_error_p95_m": float(np.percentile(np.linalg.norm(across, axis=2), 95.0)),
        "axial_share": whole.drawn_axial_share,
        "calibrations_above_share": float(np.mean(each > asked_rms)),
        "deviation_sigma_worst": max(abs(share.deviation_sigma) for share in shares.values()),
        "draws": len(errors),
    }
    return predicted, drawn


def _share(covariances: Array, errors: Array, axes: Array) -> Share:
    whole = np.sum(errors**2, axis=2)
    along = np.einsum("dnk,nk->dn", errors, axes) ** 2
    expected = float(np.mean(np.trace(covariances, axis1=1, axis2=2)))
    expected_along = float(np.mean(np.einsum("nj,njk,nk->n", axes, covariances, axes)))
    # The errors around one rim belong together: what is independent is the draws.
    each, rms = whole.mean(axis=1), float(np.sqrt(whole.mean()))
    spread = float(np.std(each, ddof=1) / np.sqrt(len(each)))
    return Share(
        float(np.sqrt(expected)),
        rms,
        spread / (2.0 * rms) if rms else 0.0,
        length_quantile(covariances, 0.95),
        float(np.percentile(np.sqrt(whole), 95.0)),
        expected_along / expected if expected else 0.0,
        float(along.mean() / whole.mean()) if rms else 0.0,
        float(np.sqrt(expected - expected_along)),
        float(np.sqrt(np.mean(whole - along))),
    )


def _bases_covariances(trial: PairBudgetTrial, true: Chain2) -> Array:
    """Of points of the part that move with the follower's base, shape (points, 3, 3)."""
    noise, T = trial.dual.tracker_noise_m, true.T_master_follower
    if noise == 0.0:
        return np.zeros((trial.points, 3, 3))
    stand = TrueBases(dict(zip(ROBOTS, (T_TRACKER_MASTER, T_TRACKER_MASTER @ T), strict=True)))
    rng = np.random.default_rng([trial.seed, 16])
    frame = np.mean(
        [simulate_arcs(stand, ARC_POINTS, 0.0, rng).fit(noise).covariance for _ in range(ARC_DESIGNS)], axis=0
    )
    R_work_master = trial.T_master_work[:3, :3].T
    offsets = apply(trial.T_master_work, trial.T_work_tool[:, :3, 3]) - T[:3, 3]
    return np.stack([R_work_master @ point_covariance(frame, offset) @ R_work_master.T for offset in offsets])


def _tip_covariance(noise: float) -> Array:
    """Of a tip found by touches, flange axes [m^2], shape (3, 3): orientations alone decide it."""
    exact = simulate_touches(TcpTrial(noise=0.0), np.eye(4), np.random.default_rng(0))
    return fit_tool_point(exact.touches, noise).covariance[:3, :3]


def _part_covariances(trial: PairBudgetTrial, true: Chain2, mark: Array) -> Array:
    """Of points of the part that is found by its marks, each with the covariance of a tip, shape (points, 3, 3)."""
    T_flange_work = true.T_flange_gripper @ true.T_gripper_work
    slopes = _slopes(apply(T_flange_work, trial.marks))
    # Kabsch's rotation is the least-squares one, all marks and axes weighed alike, though they are not known alike.
    gain = np.linalg.pinv(slopes.reshape(-1, 6))
    frame = gain @ np.kron(np.eye(len(slopes)), mark) @ gain.T
    J = T_flange_work[:3, :3].T @ _slopes(apply(T_flange_work, trial.T_work_tool[:, :3, 3]))
    return np.asarray(J @ frame @ np.swapaxes(J, 1, 2))


def _slopes(points: Array) -> Array:
    """How points move with a frame's origin and small turns about it, shape (n, 3, 6)."""
    return np.stack([np.concatenate([np.eye(3), -skew(point)], axis=1) for point in points])
