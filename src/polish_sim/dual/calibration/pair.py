"""Bases, tool and part of two robots in one least squares.

Found one by one each has its own error, and on the part the errors add up. A closing touch, the tool's tip at a mark of
the part the other robot holds, tells their sum where the work is done:

    T_master_follower (R_2 p + t_2) = T_master_flange T_flange_work m

All that was measured is weighed by its covariance: maximum likelihood for Gaussian noise, to first order in the errors
of what was found one by one, and the Cramér-Rao bound is met.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.dual.calibration.matched_points import check_matched, kabsch
from polish_sim.spatial import apply, transform

# What is known of two robots before they are adjusted together, and the touches that close their chain.

Array = NDArray[np.float64]


class PairParts(NamedTuple):
    """Bases, tool and part as found one by one, each with its covariance."""

    T_master_follower: Array
    """The follower's base in the master's, shape (4, 4)."""
    bases_covariance: Array
    """Of its origin [m] and a small rotation [rad], master axes, shape (6, 6)."""
    tip: Array
    """The tool's tip on the follower's flange [m], shape (3,)."""
    tip_covariance: Array
    """Flange axes [m^2], shape (3, 3)."""
    marks_flange: Array
    """Marks of the part on the master's flange [m], shape (k, 3)."""
    marks_covariance: Array
    """Flange axes [m^2], shape (k, 3, 3)."""


class ClosingTouches(NamedTuple):
    """The follower's tip brought to marks of the part the master holds; flange poses as the robots say them."""

    T_master_flange: Array
    """Of the master in its base, shape (n, 4, 4)."""
    T_follower_flange: Array
    """Of the follower in its base, shape (n, 4, 4)."""
    mark: NDArray[np.int64]
    """Which mark was touched, shape (n,)."""


SOURCES: Final = ("bases", "tool", "part", "closing")
"""Groups of measurements, each with its own noise."""
LEAST_NOISE: Final = 1e-9
"""What is said to be known better is taken to be known as well as this [m], [rad]: rounding is not much below."""
BASES, TIP, PART = slice(0, 6), slice(6, 9), slice(9, 15)
"""Places of the unknowns: displacement and small turn of the follower's base (master axes) and of the part (flange
axes), displacement of the tip between them."""
_ROUNDS: Final = 8


class PairAdjustment(NamedTuple):
    """Bases, tool and part that agree best with everything measured."""

    T_master_follower: Array
    """Shape (4, 4)."""
    tip: Array
    """On the follower's flange [m], shape (3,)."""
    T_flange_work: Array
    """The part on the master's flange, shape (4, 4)."""
    informations: Mapping[str, Array]
    """What each of `SOURCES` tells of the 15 unknowns, (15, 15) each; they add up."""

    @property
    def covariance(self) -> Array:
        """Of the 15 unknowns: base (m, rad), tip (m), part (m, rad), shape (15, 15)."""
        return np.asarray(np.linalg.inv(np.sum(list(self.informations.values()), axis=0)))

    def share(self, source: str) -> Array:
        """What the noise of one source adds to the covariance, shape (15, 15); the shares add up to it."""
        C = self.covariance
        return np.asarray(C @ self.informations[source] @ C)


def adjust_pair(parts: PairParts, marks_work: Array, closing: ClosingTouches, noise: float) -> PairAdjustment:
    """Adjust what was found one by one to each other.

    Args:
        parts: Bases, tool and marks with their covariances.
        marks_work: The same marks as drawn, work frame [m], shape (k, 3).
        closing: Touches that close the chain; none leaves bases and tip as they are.
        noise: Standard deviation of one coordinate of a closing touch [m].

    Returns:
        The adjusted chain and what each source says of it.

    Raises:
        CalibrationError: The marks cannot tell where the part is.
    """
    check_matched(parts.marks_flange, marks_work)
    start = kabsch(parts.marks_flange, marks_work, np.ones(len(marks_work)))
    state = _State(parts.T_master_follower, parts.tip, start)
    for _ in range(_ROUNDS):
        rows = _whitened(state, parts, marks_work, closing, max(noise, LEAST_NOISE))
        J, e = (np.concatenate([row[k] for row in rows.values()]) for k in (0, 1))
        step = np.linalg.lstsq(J, -e, rcond=None)[0]
        state = _moved(state, step)
        if np.abs(step).max() < 1e-12:
            break
    return PairAdjustment(*state, {name: J.T @ J for name, (J, _) in rows.items()})


class _State(NamedTuple):
    T_master_follower: Array
    tip: Array
    T_flange_work: Array


def _moved(state: _State, step: Array) -> _State:
    return _State(
        _turned(state.T_master_follower, step[BASES]),
        state.tip + step[TIP],
        _turned(state.T_flange_work, step[PART]),
    )


def _turned(T: Array, step: Array) -> Array:
    return transform(Rotation.from_rotvec(step[3:]).as_matrix() @ T[:3, :3], T[:3, 3] + step[:3])


def _whitened(
    state: _State, parts: PairParts, marks_work: Array, closing: ClosingTouches, noise: float
) -> dict[str, tuple[Array, Array]]:
    """Derivatives (r, 15) and residuals (r,) of each source, in standard deviations."""
    T_mf, tip, T_fw = state
    turned = Rotation.from_matrix(T_mf[:3, :3] @ parts.T_master_follower[:3, :3].T).as_rotvec()
    bases = np.concatenate([T_mf[:3, 3] - parts.T_master_follower[:3, 3], turned])
    seen = apply(T_fw, marks_work)
    of_marks = np.zeros((len(seen), 3, 15))
    of_marks[..., PART] = point_slopes(T_fw, seen)
    J, e = _closed(state, marks_work, closing)
    rows = (
        _white(np.eye(15)[BASES], bases, parts.bases_covariance),
        _white(np.eye(15)[TIP], tip - parts.tip, parts.tip_covariance),
        _white(of_marks, seen - parts.marks_flange, parts.marks_covariance),
        (J / noise, e / noise),
    )
    return {name: (J.reshape(-1, 15), e.ravel()) for name, (J, e) in zip(SOURCES, rows, strict=True)}


def _closed(state: _State, marks_work: Array, closing: ClosingTouches) -> tuple[Array, Array]:
    """How far closing touches are from closing the chain [m], master axes: derivatives (n, 3, 15), residuals (n, 3)."""
    T_mf, tip, T_fw = state
    R_1, R_2 = closing.T_master_flange[:, :3, :3], closing.T_follower_flange[:, :3, :3]
    tips_master = apply(T_mf, R_2 @ tip + closing.T_follower_flange[:, :3, 3])
    marks_flange = apply(T_fw, marks_work)[closing.mark]
    marks_master = np.einsum("nij,nj->ni", R_1, marks_flange) + closing.T_master_flange[:, :3, 3]
    J = np.zeros((len(closing.mark), 3, 15))
    J[..., BASES] = point_slopes(T_mf, tips_master)
    J[..., TIP] = T_mf[:3, :3] @ R_2
    J[..., PART] = -R_1 @ point_slopes(T_fw, marks_flange)
    return J, tips_master - marks_master


def point_slopes(T: Array, points: Array) -> Array:
    """How points that move with a frame T move with its origin and a small turn about it, shape (n, 3, 6)."""
    J = np.zeros((len(points), 3, 6))
    J[:, :, :3] = np.eye(3)
    # Column j of the turn: e_j x r.
    J[:, :, 3:] = np.swapaxes(np.cross(np.eye(3), (points - T[:3, 3])[:, None]), 1, 2)
    return J


def _white(J: Array, e: Array, covariance: Array) -> tuple[Array, Array]:
    """Rows in standard deviations; stacks of them, each with its covariance."""
    L = np.linalg.cholesky(covariance + LEAST_NOISE**2 * np.eye(covariance.shape[-1]))
    return np.linalg.solve(L, J), np.linalg.solve(L, e[..., None])[..., 0]
