"""What samples tell about base parameters: normal equations joint by joint, so that weights can change (layer 8d)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.base_parameters import BaseParameters
from polish_sim.identification.torque_model import PIECE, States, TorqueModel

Array = NDArray[np.float64]

STANDSTILL: Final = 0.1
"""Below this speed [rad/s] a joint's torque gets no weight: its friction has no known size."""
TURNING: Final = 0.06
"""While any joint is slower than this [rad/s] no torque gets weight: all feel how its friction turns round."""
STANDING: Final = (0.01, 0.5)
"""Below this speed [rad/s] and acceleration [rad/s^2] a joint stands still: it does not turn round either."""


class JointSums(NamedTuple):
    """Sums over samples for each of n joints and r base parameters."""

    squares: Array
    """Y_j^T Y_j, shape (n, r, r)."""
    products: Array
    """Y_j^T tau_j, shape (n, r)."""
    torque_sum: Array
    """Sum of tau_j, shape (n,)."""
    torque_squares: Array
    """Sum of tau_j^2, shape (n,)."""
    samples: Array
    """Samples that count, shape (n,)."""

    def plus(self, other: JointSums) -> JointSums:
        """Sums over both sets of samples."""
        return JointSums(*(a + b for a, b in zip(self, other, strict=True)))

    def weighed(self, share: Array) -> JointSums:
        """The same samples with rows and torques divided by a share of each joint's noise (n,)."""
        squared = share**2
        return JointSums(
            self.squares / squared[:, None, None], self.products / squared[:, None], self.torque_sum / share,
            self.torque_squares / squared, self.samples,
        )  # fmt: skip


def sum_samples(model: TorqueModel, base: BaseParameters, states: States, torque: Array) -> JointSums:
    """Gather the normal equations of measured states and torques.

    Args:
        model: The torque model.
        base: Its base parameters.
        states: Measured states, shape (m, n) each.
        torque: Measured torques [N m], shape (m, n).

    Returns:
        Sums, joint by joint.
    """
    n, r = model.joints, base.rank
    squares, products = np.zeros((n, r, r)), np.zeros((n, r))
    moving = told_rows(states)
    for first in range(0, len(torque), PIECE):
        rows = slice(first, first + PIECE)
        Y = model.regressor(states.rows(rows))[:, :, base.columns] * moving[rows, :, None]
        for j in range(n):
            of_joint = np.ascontiguousarray(Y[:, j])
            squares[j] += of_joint.T @ of_joint
            products[j] += of_joint.T @ torque[rows, j]
    used = np.where(moving, torque, 0.0)
    return JointSums(squares, products, used.sum(0), (used**2).sum(0), moving.sum(0).astype(float))


def told_rows(states: States) -> NDArray[np.bool_]:
    """Which torques tell something: the joint moves, and no joint turns round; shape (m, n)."""
    speed = np.abs(states.qd)
    standing = (speed <= STANDING[0]) & (np.abs(states.qdd) <= STANDING[1])
    turning = (speed <= TURNING) & ~standing
    return np.asarray((speed > STANDSTILL) & ~np.any(turning, axis=1)[:, None])


def information(sums: JointSums, sigma: Array) -> Array:
    """Fisher information of the base parameters at noise sigma (n,) [N m], shape (r, r)."""
    return np.asarray(np.tensordot(1.0 / sigma**2, sums.squares, axes=1))


def cramer_rao(sums: JointSums, sigma: Array) -> Array:
    """Least covariance any unbiased estimate can have, shape (r, r)."""
    return inverse_of(information(sums, sigma))


def inverse_of(H: Array) -> Array:
    """Inverse of a positive definite matrix whose rows have very different units."""
    scale = 1.0 / np.sqrt(np.diag(H))
    return np.asarray(np.linalg.inv(H * np.outer(scale, scale)) * np.outer(scale, scale))
