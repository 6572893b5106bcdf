"""The square of the parameter's speed as a quadratic spline of the parameter (knots -> stencils; layer 6).

b(u) has one control value more than knots. At a knot b and its slope depend on two of them, on a span between knots the
second derivative, which is constant there, on three: control values i - 1, i and i + 1 around a centre i.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Squares(NamedTuple):
    """How b and its derivatives follow from n + 1 control values with n knots."""

    knots: Array
    """[m], rising, shape (n,)."""
    values: Array
    """Of b at the knots; row k is about centre k + 1, as are the slopes, shape (n, 3)."""
    slopes: Array
    """Of b_u at the knots [1/m], shape (n, 3)."""
    bends: Array
    """Of b_uu on the spans; row k is about centre k + 1 [1/m^2], shape (n - 1, 3)."""
    end_values: Array
    """Of b at the end of every span, about its centre, shape (n - 1, 3)."""
    end_slopes: Array
    """Of b_u there [1/m], shape (n - 1, 3)."""


def squares_on(knots: Array) -> Squares:
    """The spline on knots (n,) [m], n at least 3."""
    spans = np.diff(knots)
    before, after = np.concatenate([[0.0], spans]), np.concatenate([spans, [0.0]])
    whole = before + after
    none = np.zeros_like(whole)
    values = np.stack([after / whole, before / whole, none], axis=1)
    slopes = np.stack([-2.0 / whole, 2.0 / whole, none], axis=1)
    end_values, end_slopes = np.roll(values[1:], 1, axis=1), np.roll(slopes[1:], 1, axis=1)
    return Squares(knots, values, slopes, (end_slopes - slopes[:-1]) / spans[:, None], end_values, end_slopes)


def control_values(squares: Squares, b: Array) -> Array:
    """Control values of a spline near values b at the knots (n,), shape (n + 1,)."""
    return np.concatenate([b[:1], 0.5 * (b[:-1] + b[1:]), b[-1:]])


def around(stencils: Array, controls: Array) -> Array:
    """What the stencils (m, 3) give of control values, row k about centre k + 1, shape (m,)."""
    padded = np.concatenate([controls, [0.0]])
    m = len(stencils)
    return np.asarray(sum(stencils[:, k] * padded[k : k + m] for k in range(3)))
