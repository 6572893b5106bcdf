"""Functions of one variable with their derivatives, carried along exactly (layer 6).

A jet is an array whose first index counts derivatives: ``f[k]`` is the k-th one at n places, shape (orders, n, ...).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def scale(f: Array, g: Array) -> Array:
    """f times a scalar g: f (orders, n, 3), g (orders, n)."""
    return _leibniz(f, g[..., None], np.multiply)


def dot(f: Array, g: Array) -> Array:
    """Scalar product of vectors, shape (orders, n)."""
    return _leibniz(f, g, lambda a, b: np.einsum("ni,ni->n", a, b))


def cross(f: Array, g: Array) -> Array:
    """Vector product, shape (orders, n, 3)."""
    return _leibniz(f, g, np.cross)


def inverse_root(s: Array) -> Array:
    """1 / sqrt(s) of a positive scalar, shape (orders, n); from 2 s g' = -g s'."""
    g = np.empty_like(s)
    g[0] = 1.0 / np.sqrt(s[0])
    for m in range(len(s) - 1):
        known = sum(math.comb(m, k) * (-0.5 * g[m - k] * s[k + 1]) for k in range(m + 1))
        known -= sum(math.comb(m, k) * s[k] * g[m + 1 - k] for k in range(1, m + 1))
        g[m + 1] = known / s[0]
    return g


def normalized(f: Array) -> Array:
    """f over its length."""
    return scale(f, inverse_root(dot(f, f)))


def _leibniz(f: Array, g: Array, product: Callable[[Array, Array], Array]) -> Array:
    orders = range(min(len(f), len(g)))
    return np.stack([sum(math.comb(m, k) * product(f[k], g[m - k]) for k in range(m + 1)) for m in orders])  # type: ignore[misc]
