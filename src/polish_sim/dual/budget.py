"""Error budget of the tool on the part, two arms calibrated as `run dual` calibrates them.

Noise of the instruments propagates through the calibration of bases, tool and part, and through their
adjustment to closing touches, to the tool's place on the rim: to first order, by covariances, and drawn, the
noise of each source alone and of all together. To first order the error is, in the part's axes,
R_work_flange (t + psi x r_mark) - R_work_master (d + phi x r_base) - R_work_tool R_tool_flange p:
d, phi of the follower's base in the master's, t, psi of the part on its flange, p of the tip on its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, directions_at
from polish_sim.calibration.fit import slopes_of
from polish_sim.config import DualConfig
from polish_sim.dual.arms import ClosedChain
from polish_sim.dual.calibration.pair import (
    LEAST_NOISE,
    SOURCES,
    PairAdjustment,
    PairParts,
    adjust_pair,
)
from polish_sim.dual.calibration.tool import TOOL_DOWN
from polish_sim.dual.frames import (
    Site,
    believed_chain,
    find_parts,
    tool_errors,
    touch_marks,
    true_chain,
)
from polish_sim.dual.placement import default_poses
from polish_sim.spatial import apply, transform

TOGETHER = "together"
#: Sets of measured arcs the prediction is averaged over: a tracker takes its points where it will
DESIGNS = 10


@dataclass(frozen=True)
class PairBudgetTrial:
    """Calibrations of two robots, again and again, and the rim they are to work on."""

    dual: DualConfig = DualConfig()
    draws: int = 300
    seed: int = 0
    rim_radius: float = 0.08  #: Of the rim, about that of the hub [m]
    rim_height: float = 0.038  #: Above the part's origin [m]
    points: int = 24  #: Places on it where the error is looked at

    @property
    def T_work_tool(self) -> Array:
        """The tool on the rim, its z axis into the part, shape (points, 4, 4)."""
        return self._around(self.points)

    @property
    def site(self) -> Site:
        """Points of the rim that are touched to find the part, and again with the tool; `dual.marks` of
        them."""
        return Site(self.T_master_work, self._around(self.dual.marks))

    @property
    def T_master_work(self) -> Array:
        """Where the part is held: the first place `run dual` tries, base of the master, shape (4, 4)."""
        return next(default_poses(true_chain(self.dual), np.array([0.0, 0.0, 1.0]), np.zeros(3)))

    def _around(self, count: int) -> Array:
        """The tool at places all round the rim, shape (count, 4, 4)."""
        angle = 2.0 * np.pi * np.arange(count) / count
        rim = np.column_stack([self.rim_radius * directions_at(angle), np.full(count, self.rim_height)])
        return transform(TOOL_DOWN, rim)


class Share(NamedTuple):
    """The error of the tool on the part from one source, or all."""

    predicted_rms_m: float  #: To first order, by covariances
    drawn_rms_m: float
    drawn_rms_std_m: float  #: Standard error of the drawn rms
    drawn_p95_m: float  #: 95% of the errors, over calibrations and places, are no larger
    #: Of the mean square, along the tool axis: in contact the force loop removes it
    predicted_axial_share: float
    drawn_axial_share: float
    predicted_across_rms_m: float  #: What the force loop does not remove
    drawn_across_rms_m: float
    drawn_across_p95_m: float

    @property
    def deviation_sigma(self) -> float:
        """Drawn minus predicted, over its standard error; 0 where there is no noise but rounding."""
        if not self.drawn_rms_std_m or max(self.drawn_rms_m, self.predicted_rms_m) < LEAST_NOISE:
            return 0.0
        return (self.drawn_rms_m - self.predicted_rms_m) / self.drawn_rms_std_m


class Prediction(NamedTuple):
    """Covariances of the tool on the part, to first order."""

    #: How the tool's place on the part moves with the 15 unknowns, work frame, shape (points, 3, 15)
    slopes: Array
    #: Covariance of the unknowns by source, (15, 15) each; they add up to the whole
    shares: Mapping[str, Array]

    @property
    def covariances(self) -> dict[str, Array]:
        """Covariances of the tool's place by source and together [m^2], work frame, each (points, 3, 3)."""
        found = {name: self.slopes @ C @ np.swapaxes(self.slopes, 1, 2) for name, C in self.shares.items()}
        return found | {TOGETHER: np.sum(list(found.values()), axis=0)}


def predict(trial: PairBudgetTrial) -> Prediction:
    """Noise of the instruments to the tool on the part, to first order."""
    dual = trial.dual
    true = true_chain(trial.dual)
    adjusted = [
        _adjusted_exactly(dual, true, trial.site, np.random.default_rng([trial.seed, 16, k]))
        for k in range(DESIGNS)
    ]
    shares = {name: np.mean([one.share(name) for one in adjusted], axis=0) for name in SOURCES}
    if dual.tracker_noise_m == 0.0:
        shares["bases"] = np.zeros((15, 15))
    if dual.touch_noise_m == 0.0:
        shares |= dict.fromkeys(("tool", "part", "closing"), np.zeros((15, 15)))
    return Prediction(_slopes(trial, true), shares)


def draw_errors(trial: PairBudgetTrial, number: int) -> dict[str, Array]:
    """Draw one calibration of a trial, through the whole chain: nothing is linear here.

    Returns, with the noise of each source alone and of all together, the error from the tool as wanted to the
    tool as it is, work frame [m], each (points, 3).
    """
    rng = np.random.default_rng([trial.seed, 15, number])
    dual = trial.dual
    site = trial.site
    true = true_chain(trial.dual)
    found = find_parts(dual, true, site, rng)
    exact = true_parts(found, true, site)
    touched = touch_marks(true, site, dual.closing_touches, dual.touch_noise_m, rng)
    silent = touch_marks(true, site, dual.closing_touches, 0.0, rng)
    heard = {name: (_only(name, found, exact), touched if name == "closing" else silent) for name in SOURCES}
    heard[TOGETHER] = (found, touched)
    chains = {
        name: believed_chain(
            adjust_pair(parts, site.marks_work, closing, dual.touch_noise_m), found.R_flange_tool, true
        )
        for name, (parts, closing) in heard.items()
    }
    return {
        name: tool_errors(true, chain, trial.T_master_work, trial.T_work_tool)
        for name, chain in chains.items()
    }


def compare_shares(
    trial: PairBudgetTrial, covariances: Mapping[str, Array], errors: Mapping[str, Array]
) -> dict[str, Share]:
    """By source: covariances [m^2], (points, 3, 3), beside drawn errors [m], (draws >= 2, points, 3)."""
    axes = trial.T_work_tool[:, :3, 2]
    return {name: _share(covariances[name], errors[name], axes) for name in covariances}


def budget_figures(
    shares: Mapping[str, Share], errors: Array, asked_rms: float
) -> tuple[dict[str, float], dict[str, float]]:
    """The figures of the whole, as analysis and as the draws have them: predicted ones, and the keys of
    metrics.json.

    ``errors``: together, draw by draw, work frame [m], (draws, points, 3); calibrations with an rms around
    the rim above ``asked_rms`` [m] are counted.
    """
    whole = shares[TOGETHER]
    each = np.sqrt(np.mean(np.sum(errors**2, axis=2), axis=1))
    predicted = {
        "relative_error_rms_m": whole.predicted_rms_m,
        "across_error_rms_m": whole.predicted_across_rms_m,
        "axial_share": whole.predicted_axial_share,
    }
    drawn = {
        "relative_error_rms_m": whole.drawn_rms_m,
        "relative_error_p95_m": whole.drawn_p95_m,
        "across_error_rms_m": whole.drawn_across_rms_m,
        "across_error_p95_m": whole.drawn_across_p95_m,
        "axial_share": whole.drawn_axial_share,
        "calibrations_above_share": np.mean(each > asked_rms),
        "deviation_sigma_worst": max(abs(share.deviation_sigma) for share in shares.values()),
        "draws": len(errors),
    }
    return predicted, drawn


def _share(covariances: Array, errors: Array, axes: Array) -> Share:
    whole = np.sum(errors**2, axis=2)
    along = np.einsum("dnk,nk->dn", errors, axes) ** 2
    across = np.maximum(whole - along, 0.0)
    expected = np.mean(np.trace(covariances, axis1=1, axis2=2))
    expected_along = np.mean(np.einsum("nj,njk,nk->n", axes, covariances, axes))
    # The errors around one rim belong together: what is independent is the draws.
    each = whole.mean(axis=1)
    rms = np.sqrt(whole.mean())
    spread = np.std(each, ddof=1) / np.sqrt(len(each))
    return Share(
        np.sqrt(expected),
        rms,
        spread / (2.0 * rms) if rms else 0.0,
        np.percentile(np.sqrt(whole), 95.0),
        expected_along / expected if expected else 0.0,
        along.mean() / whole.mean() if rms else 0.0,
        np.sqrt(expected - expected_along),
        np.sqrt(np.mean(across)),
        np.percentile(np.sqrt(across), 95.0),
    )


def true_parts(found: PairParts, true: ClosedChain, site: Site) -> PairParts:
    """Bases, tool and marks as they really are, believed to be known as well as those that were found."""
    marks = apply(true.T_flange_work, site.marks_work)
    return found._replace(
        T_master_follower=true.T_master_follower, tip=true.T_flange_tool[:3, 3], marks_flange=marks
    )


def _only(source: str, found: PairParts, exact: PairParts) -> PairParts:
    """What is exact, with the noise of one source."""
    name = {"bases": "T_master_follower", "tool": "tip", "part": "marks_flange"}.get(source)
    return exact if name is None else exact._replace(**{name: getattr(found, name)})


def _adjusted_exactly(
    dual: DualConfig, true: ClosedChain, site: Site, rng: np.random.Generator
) -> PairAdjustment:
    """The adjustment without any noise drawn, weighed as if there were: what its covariance needs."""
    found = find_parts(dual, true, site, rng)
    closing = touch_marks(true, site, dual.closing_touches, 0.0, rng)
    return adjust_pair(true_parts(found, true, site), site.marks_work, closing, dual.touch_noise_m)


def _slopes(trial: PairBudgetTrial, true: ClosedChain) -> Array:
    """How the tool's place on the part moves with bases, tip and part, work frame, shape (points, 3, 15)."""
    R_flange_tool, tip = true.T_flange_tool[:3, :3], true.T_flange_tool[:3, 3]
    exact = PairAdjustment(true.T_master_follower, tip, true.T_flange_work)

    def errors(step: Array) -> Array:
        believed = believed_chain(exact.moved(step), R_flange_tool, true)
        return tool_errors(true, believed, trial.T_master_work, trial.T_work_tool)

    return slopes_of(errors, 15)
