"""Weighted least squares: base parameters with their covariance, and the noise that weighs the joints (layer 8d)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import IdentificationError
from polish_sim.identification.base_parameters import BaseParameters
from polish_sim.identification.information import STANDSTILL, JointSums, information, inverse_of
from polish_sim.identification.torque_model import States, TorqueModel

Array = NDArray[np.float64]

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
