"""Weighted least squares: base parameters with their covariance, and the noise that weighs the joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import IdentificationError
from polish_sim.identification.base_parameters import BaseParameters
from polish_sim.identification.regressor import PIECE, States, TorqueModel

# What samples tell about base parameters: normal equations joint by joint, so that weights can change.

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


INTERVAL_95: Final = 1.959964
"""Half width of a 95% interval in standard deviations."""
_ROUNDS: Final = 4
_HIDDEN: Final = 1e-5
"""A direction is not told if its share of the largest singular value of the scaled regressor is below this."""


@dataclass(frozen=True)
class Estimate:
    """Base parameters found in measured torques."""

    theta: Array
    """Shape (r,)."""
    covariance: Array
    """Shape (r, r)."""
    sigma: Array
    """Torque noise found in the residuals [N m], shape (n,)."""
    r_squared: Array
    """Share of each torque's variance that is explained, shape (n,)."""
    condition: float
    """Of the stacked regressor as it stands, in SI units."""
    condition_equilibrated: float
    """Of the stacked regressor with rows in units of noise and columns of unit length."""
    inefficiency: Array | None = None
    """How many samples tell as much as one independent one, shape (n,); None where noise is taken as white."""

    @property
    def std(self) -> Array:
        """Standard deviations, shape (r,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def covers(self, truth: Array) -> NDArray[np.bool_]:
        """Which 95% intervals hold the true value, shape (r,)."""
        return np.asarray(np.abs(self.theta - truth) <= INTERVAL_95 * self.std)


class Earlier(NamedTuple):
    """What an earlier step knows of the base parameters."""

    information: Array
    """Shape (r, r), of any rank."""
    products: Array
    """That information times its estimate, shape (r,)."""


def estimate(sums: JointSums, earlier: Earlier | None = None, sigma: Array | None = None) -> Estimate:
    """Estimate base parameters, the weights by the residuals' own noise.

    Args:
        sums: What the samples say.
        earlier: What is known beforehand.
        sigma: The torques' noise [N m] where it is known, shape (n,).

    Returns:
        Parameters, covariance and noise.
    """
    n, r = sums.products.shape
    extra, pull = earlier or Earlier(np.zeros((r, r)), np.zeros(r))
    noise = np.sqrt(np.maximum(sums.torque_squares, 1e-30) / np.maximum(sums.samples, 1.0)) if sigma is None else sigma
    for _round in range(_ROUNDS):
        H = information(sums, noise) + extra
        covariance = inverse_of(H)
        theta = covariance @ (np.tensordot(1.0 / noise**2, sums.products, axes=1) + pull)
        left = residual_squares(sums, theta)
        if sigma is None:
            spent = np.array([np.sum(covariance * sums.squares[j]) / noise[j] ** 2 for j in range(n)])
            noise = np.sqrt(np.maximum(left, 1e-24) / np.maximum(sums.samples - spent, 1.0))
    total = sums.torque_squares - sums.torque_sum**2 / np.maximum(sums.samples, 1.0)
    plain = np.linalg.eigvalsh(sums.squares.sum(0))
    scale = 1.0 / np.sqrt(np.diag(H))
    equal = np.linalg.eigvalsh(H * np.outer(scale, scale))
    return Estimate(
        theta, covariance, noise, 1.0 - left / np.maximum(total, 1e-30),
        float(np.sqrt(plain[-1] / max(plain[0], 1e-300))), float(np.sqrt(equal[-1] / max(equal[0], 1e-300))),
    )  # fmt: skip


def residual_squares(sums: JointSums, theta: Array) -> Array:
    """Sum of squared residuals of each joint at theta [N^2 m^2], shape (n,)."""
    fitted = np.einsum("jrs,r,s->j", sums.squares, theta, theta)
    return np.asarray(np.maximum(sums.torque_squares - 2.0 * sums.products @ theta + fitted, 0.0))


def require_rank(sums: JointSums, base: BaseParameters, model: TorqueModel) -> None:
    """Refuse a motion that does not tell every base parameter.

    Raises:
        IdentificationError: Names joints that stood still and the parameters that stay unknown.
    """
    require_told(sums, [model.names[column] for column in base.columns], model)


def require_told(sums: JointSums, names: Sequence[str], model: TorqueModel) -> None:
    """Refuse samples that do not tell every one of some parameters.

    Args:
        sums: What the samples say of them.
        names: Their names, shape (r,).
        model: The torque model.

    Raises:
        IdentificationError: Names joints that stood still and the parameters that stay unknown.
    """
    sigma = np.sqrt(np.maximum(sums.torque_squares, 1e-12) / np.maximum(sums.samples, 1.0))
    H = information(sums, np.maximum(sigma, 1e-6))
    size = np.sqrt(np.diag(H))
    scale = 1.0 / np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
    hidden = vectors[:, values <= _HIDDEN**2 * values[-1]]
    if not hidden.size:
        return
    share = np.linalg.norm(hidden, axis=1)
    unknown = [name for name, part in zip(names, share, strict=True) if part > 1e-2]
    still = [model.chain.joints[j] for j in range(model.joints) if sums.samples[j] == 0]
    said = f" {', '.join(still)} did not move, or never faster than {STANDSTILL:g} rad/s." if still else ""
    raise IdentificationError(
        f"the motion tells {len(names) - hidden.shape[1]} of {len(names)} base parameters.{said} Not identifiable, or "
        f"only in combination: {', '.join(unknown)}. Move every joint, at different speeds, in different poses of the "
        "others."
    )


def held_out_error(model: TorqueModel, base: BaseParameters, theta: Array, states: States, exact: Array) -> Array:
    """Torque errors on a motion that was not fitted: rms error / range of the torque, shape (n,); NaN is left out."""
    off = model.regressor(states)[:, :, base.columns] @ theta - exact
    reach = np.nanmax(exact, axis=0) - np.nanmin(exact, axis=0)
    return np.asarray(np.sqrt(np.nanmean(off**2, axis=0)) / reach)


# How much less samples tell whose noise is not white, found in the residuals.
#
# Where noise stays alike for some samples, or the model lacks a torque, many samples tell no more than one independent
# one. The inefficiency g = 1 + 2 (rho_1 + rho_2 + ...) of the residuals' correlations says how many; covariances grow.

LONGEST: Final = 0.1
"""Correlations are followed over this share of the samples at most."""


def estimate_widened(
    model: TorqueModel, base: BaseParameters, sums: JointSums, states: States, torque: Array,
    earlier: Earlier | None = None,
) -> Estimate:  # fmt: skip
    """Estimate base parameters with intervals that count how alike the residuals stay from sample to sample.

    Args:
        model: The torque model.
        base: Its base.
        sums: What the samples say.
        states: The samples themselves in their order, shape (m, n) each.
        torque: Their torques [N m], shape (m, n).
        earlier: What is known beforehand.

    Returns:
        The estimate, every joint's samples weighed by its noise and inefficiency; ``sigma`` is the noise alone.
    """
    found = estimate(sums, earlier)
    left = torque - model.torque_of_base(states, base.columns, found.theta)
    g = inefficiency(left, told_rows(states))
    return replace(estimate(sums, earlier, found.sigma * np.sqrt(g)), sigma=found.sigma, inefficiency=g)


def inefficiency(residuals: Array, told: NDArray[np.bool_]) -> Array:
    """How many samples tell as much as one independent one, joint by joint.

    Args:
        residuals: What is left of the torques, in the order of time, shape (m, n).
        told: Which of them count, shape (m, n).

    Returns:
        At least 1, shape (n,).
    """
    most = max(int(LONGEST * len(residuals)), 2)
    return np.array([_of_joint(residuals[:, j], told[:, j], most) for j in range(residuals.shape[1])])


def _of_joint(residual: Array, told: NDArray[np.bool_], most: int) -> float:
    if told.sum() < 2:
        return 1.0
    mean = residual[told].mean()
    pairs = _products(told.astype(float), most)
    products = _products(np.where(told, residual - mean, 0.0), most)
    rho = np.divide(products, pairs, out=np.zeros(most), where=pairs > 0.5)
    rho /= max(rho[0], 1e-300)
    # Sums of two neighbours fall steadily; where they are lost in the noise they are left out.
    two = rho[: most - most % 2].reshape(-1, 2).sum(axis=1)
    end = int(np.argmax(two <= 0.0)) if np.any(two <= 0.0) else len(two)
    return float(max(2.0 * two[:end].sum() - 1.0, 1.0))


def _products(values: Array, most: int) -> Array:
    """Sums of products with the values k samples later, k below ``most``."""
    size = 1 << int(np.ceil(np.log2(len(values) + most)))
    spectrum = np.fft.rfft(values, size)
    return np.asarray(np.fft.irfft(spectrum * np.conj(spectrum), size)[:most])
