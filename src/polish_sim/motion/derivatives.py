"""Functions of one variable with their derivatives, carried along exactly.

A jet is an array or a list whose first index counts derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from polish_sim.arrays import Array, crosses

Product = Callable[[Any, Any], Any]


def derivative_of(product: Product, f: Any, g: Any, m: int) -> Any:
    """The m-th derivative of a product of two jets (Leibniz)."""
    return sum(math.comb(m, k) * product(f[k], g[m - k]) for k in range(m + 1))


def jet_of(product: Product, f: Any, g: Any, orders: int = 4) -> Array:
    """The jet of a product of two."""
    return np.stack([derivative_of(product, f, g, m) for m in range(orders)])


def carried(spin: Any, vectors: Array) -> list[Array]:
    """The jet of vectors (n, 3) fixed in bodies whose angular velocity is a jet ``spin``, one order more."""
    jet = [vectors]
    for m in range(len(spin)):
        jet.append(derivative_of(crosses, spin, jet, m))
    return jet
