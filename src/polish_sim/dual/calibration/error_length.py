"""How large a Gaussian error in space is: the distribution of its length, from covariances.

An error with covariance C = L L^T is z L u: u a direction, all equally likely, and z a chi with three degrees of
freedom. For a given u the length is z |L u|; the rest is a mean over directions:

    P(length <= r) = mean over u of gammainc(3/2, r^2 / (2 u^T C u))
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import gammainc

from polish_sim.arrays import Array

NODES: Final = 48
"""Gauss-Legendre nodes in each angle of an eighth of the sphere: the other seven are its mirror images."""


def length_probability(covariances: Array, lengths: Array) -> Array:
    """Share of errors, covariances (n, 3, 3) [m^2] equally often, that are no longer than lengths (k,) [m]."""
    # Turned to its own axes the covariance is diagonal; directions are as likely as before.
    variances = np.linalg.eigvalsh(covariances)
    squares, weights = _directions()
    s = np.maximum(variances, 0.0) @ squares.T
    with np.errstate(divide="ignore", invalid="ignore"):
        below = gammainc(1.5, 0.5 * lengths[:, None, None] ** 2 / s)
    return np.asarray(np.mean(np.where(s > 0.0, below, 1.0) @ weights, axis=1))


def length_quantile(covariances: Array, share: float) -> float:
    """The length [m] below which a share, 0 to 1, of the errors stays; covariances as in `length_probability`."""
    # Chebyshev: no more than (1 - share) / 2 are longer than this.
    longest = float(np.sqrt(2.0 * np.trace(covariances, axis1=1, axis2=2).max() / (1.0 - share)))
    if longest == 0.0:
        return 0.0

    def beyond(length: float) -> float:
        return float(length_probability(covariances, np.array([length]))[0]) - share

    return float(brentq(beyond, 0.0, longest, xtol=1e-6 * longest))


def quadratic_tail(covariance: Array, weight: Array, limit: float) -> float:
    """How often x^T W x is above a limit > 0, x Gaussian with mean zero; covariance and W, both (n, n), W symmetric, >=
    0.

    With eigenvalues l of C W / limit it is the integral of exp(-s) / (s sqrt(prod(1 - 2 l s))) ds / (2 pi i) along a
    line that leaves 0 to its left and 1 / (2 l) to its right; bent to the right it falls like a Gaussian.
    """
    values = np.linalg.eigvals(covariance @ weight).real / limit
    if not values.max(initial=0.0) > 0.0:
        return 0.0
    first = 0.5 / float(values.max())
    bend = 0.5 / max(first, 1.0)

    def height(t: float) -> float:
        s = 0.5 * first + bend * t * t + 1j * t
        return float((np.exp(-s) / (s * np.prod(np.sqrt(1.0 - 2.0 * values * s))) * (1.0 - 2j * bend * t)).real)

    return float(quad(height, 0.0, np.sqrt(40.0 / bend), epsabs=1e-9, limit=200)[0] / np.pi)


def _directions() -> tuple[Array, Array]:
    """Squares of unit vectors' coordinates, shape (d, 3), and weights whose sum is one, shape (d,)."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    height, turn = np.meshgrid(x, 0.5 * np.pi * x, indexing="ij")
    flat = 1.0 - height**2
    squares = np.stack([flat * np.cos(turn) ** 2, flat * np.sin(turn) ** 2, height**2], axis=-1)
    return squares.reshape(-1, 3), np.outer(w, w).ravel()
