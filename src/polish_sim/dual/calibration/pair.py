"""Bases, tool and part of two robots in one least squares.

Found one by one each has its own error, and on the part the errors add up. A closing touch, the tool's tip at
a mark of the part the other robot holds, measures their sum at the workplace:

    T_master_follower (R_2 p + t_2) = T_master_flange T_flange_work m

All measurements are weighted by their covariance: maximum likelihood for Gaussian noise, to first order in
the errors of what was found one by one, and the Cramér-Rao bound is met.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.calibration.fit import Problem, solve
from polish_sim.calibration.matched_points import check_spread, kabsch, moved_frame, point_slopes
from polish_sim.spatial import apply, apply_each, place_of, vectors_from_rotations

SOURCES = ("bases", "tool", "part", "closing")  #: Groups of measurements, each with its own noise
INSTRUMENTS = {"bases": "tracker", "tool": "touches", "part": "touches", "closing": "touches"}
"""What each source is measured with."""
#: Smaller standard deviations are taken as this [m], [rad]: rounding is not much below
LEAST_NOISE = 1e-9
BASES, TIP, PART = slice(0, 6), slice(6, 9), slice(9, 15)
"""Places of the unknowns: displacement and small turn of the follower's base (master axes) and of the part
(flange axes), displacement of the tip between them."""


class PairParts(NamedTuple):
    """Bases, tool and part as found one by one, each with its covariance."""

    T_master_follower: Array  #: The follower's base in the master's, shape (4, 4)
    bases_covariance: Array  #: Of its origin [m] and a small rotation [rad], master axes, shape (6, 6)
    tip: Array  #: The tool's tip on the follower's flange [m], shape (3,)
    tip_covariance: Array  #: Flange axes [m^2], shape (3, 3)
    marks_flange: Array  #: Marks of the part on the master's flange [m], shape (k, 3)
    marks_covariance: Array  #: Flange axes [m^2], shape (k, 3, 3)
    touch_noise: float = 0.0  #: Of a coordinate of a touch by both arms, as the residuals say [m]
    R_flange_tool: Array = np.eye(3)  #: How the tool stands on its flange, shape (3, 3)


class ClosingTouches(NamedTuple):
    """The follower's tip brought to marks of the part the master holds; flange poses as the robots say
    them."""

    T_master_flange: Array  #: Of the master in its base, shape (n, 4, 4)
    T_follower_flange: Array  #: Of the follower in its base, shape (n, 4, 4)
    mark: Indices  #: Which mark was touched, shape (n,)


class PairAdjustment(NamedTuple):
    """Bases, tool and part that agree best with everything measured."""

    T_master_follower: Array  #: Shape (4, 4)
    tip: Array  #: On the follower's flange [m], shape (3,)
    T_flange_work: Array  #: The part on the master's flange, shape (4, 4)
    #: Information of each of `SOURCES` on the 15 unknowns, (15, 15); they add up
    informations: Mapping[str, Array] = MappingProxyType({})

    def moved(self, step: Array) -> PairAdjustment:
        """Bases, tool and part after a step of the 15 unknowns, in the order of BASES, TIP, PART."""
        return PairAdjustment(
            moved_frame(self.T_master_follower, step[BASES]),
            self.tip + step[TIP],
            moved_frame(self.T_flange_work, step[PART]),
        )

    @property
    def covariance(self) -> Array:
        """Covariance of the 15 unknowns: base (m, rad), tip (m), part (m, rad), shape (15, 15)."""
        return np.linalg.inv(np.sum(list(self.informations.values()), axis=0))

    def share(self, source: str) -> Array:
        """What the noise of one source adds to the covariance, shape (15, 15); the shares add up to it."""
        C = self.covariance
        return C @ self.informations[source] @ C


def adjust_pair(parts: PairParts, marks_work: Array, closing: ClosingTouches, noise: float) -> PairAdjustment:
    """Adjust bases, tool and marks that were found one by one, with their covariances, to each other.

    Args:
        parts: What was found.
        marks_work: The same marks as drawn, work frame [m], shape (k, 3).
        closing: Touches that close the chain; none leaves bases and tip as they are.
        noise: Standard deviation of one coordinate of a closing touch [m].

    Raises:
        CalibrationError: The marks cannot determine where the part is.
    """
    check_spread(marks_work)
    whiten = [_whitening(C) for C in (parts.bases_covariance, parts.tip_covariance, parts.marks_covariance)]
    whiten.append(np.eye(3) / max(noise, LEAST_NOISE))

    def whitened(chain: PairAdjustment) -> list[tuple[Array, Array]]:
        """Derivatives (r, 15) and residuals (r,) of each source, in standard deviations."""
        white = [
            (W @ J, W @ e[..., None])
            for W, (J, e) in zip(whiten, _rows(chain, parts, marks_work, closing), strict=True)
        ]
        return [(J.reshape(-1, 15), e.ravel()) for J, e in white]

    problem = Problem(
        lambda chain: np.concatenate([e for _, e in whitened(chain)])[:, None],
        lambda chain: np.concatenate([J for J, _ in whitened(chain)])[:, None],
        PairAdjustment.moved,
    )
    found = solve(
        problem, PairAdjustment(parts.T_master_follower, parts.tip, kabsch(parts.marks_flange, marks_work))
    )
    informations = [J.T @ J for J, _ in whitened(found)]
    return found._replace(informations=dict(zip(SOURCES, informations, strict=True)))


def _whitening(covariance: Array) -> Array:
    """W with W C W^T = 1, for a covariance C or a stack of them."""
    return np.linalg.inv(np.linalg.cholesky(covariance + LEAST_NOISE**2 * np.eye(covariance.shape[-1])))


def _rows(
    chain: PairAdjustment, parts: PairParts, marks_work: Array, closing: ClosingTouches
) -> list[tuple[Array, Array]]:
    """Derivatives (..., 15) and residuals (...) of each source [m], [rad]."""
    T_mf, tip, T_fw, _ = chain
    turned = vectors_from_rotations(T_mf[:3, :3] @ parts.T_master_follower[:3, :3].T)
    bases = np.concatenate([T_mf[:3, 3] - parts.T_master_follower[:3, 3], turned])
    seen = apply(T_fw, marks_work)
    J_marks = np.zeros((len(seen), 3, 15))
    J_marks[..., PART] = point_slopes(T_fw, seen)
    # How far closing touches are from closing the chain, master axes.
    R_1, R_2 = closing.T_master_flange[:, :3, :3], closing.T_follower_flange[:, :3, :3]
    tips_master = apply(T_mf, place_of(closing.T_follower_flange, tip))
    marks_flange = seen[closing.mark]
    marks_master = apply_each(closing.T_master_flange, marks_flange)
    J_closing = np.zeros((len(closing.mark), 3, 15))
    J_closing[..., BASES] = point_slopes(T_mf, tips_master)
    J_closing[..., TIP] = T_mf[:3, :3] @ R_2
    J_closing[..., PART] = -R_1 @ point_slopes(T_fw, marks_flange)
    return [
        (np.eye(15)[BASES], bases),
        (np.eye(15)[TIP], tip - parts.tip),
        (J_marks, seen - parts.marks_flange),
        (J_closing, tips_master - marks_master),
    ]
