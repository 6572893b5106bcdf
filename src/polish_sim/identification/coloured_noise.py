"""How much less samples tell whose noise is not white, found in the residuals (layer 8d).

Where noise stays alike for some samples, or the model lacks a torque, many samples tell no more than one independent
one. The inefficiency g = 1 + 2 (rho_1 + rho_2 + ...) of the residuals' correlations says how many; covariances grow.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.base_parameters import BaseParameters
from polish_sim.identification.estimate import Earlier, Estimate, estimate
from polish_sim.identification.information import JointSums, told_rows
from polish_sim.identification.torque_model import States, TorqueModel

Array = NDArray[np.float64]

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
