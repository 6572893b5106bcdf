"""Acceleration and jerk along a curve as linear functions of b = u'^2 (Bounded, Squares -> rows; layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.spline.bounded import SLOWEST_TURN, Bounded
from polish_sim.motion.spline.program import Rows
from polish_sim.motion.spline.squares import Squares, around

Array = NDArray[np.float64]

NEAR = 0.9
"""Share of a limit from which a row is asked for."""


class Terms(NamedTuple):
    """A quantity's acceleration at every knot, or its jerk over u' at one end of every span."""

    factors: Array
    """Of three control values about a centre, k + 1 for row k, over the limit, shape (m, 3, d)."""
    ways: Array
    """The quantity's own direction there, zero where it stands still, shape (m, d)."""
    squares: Array | None
    """Factors of b there, of jerks; None: acceleration, shape (m, 3)."""


class Cuts(NamedTuple):
    """Directions in which terms are to stay below 1 (over u', if they are jerks)."""

    numbers: NDArray[np.int64]
    """Of the terms, shape (m,)."""
    factors: Array
    """Shape (m, 3)."""
    squares: Array | None
    """As of the terms, of all of them."""


def terms_of(law: Squares, quantity: Bounded) -> tuple[Terms, Terms, Terms]:
    """Acceleration at the knots, jerk where spans begin and where they end; rates are given at the knots."""
    x1, x2, x3 = quantity.rates
    acceleration = _outer(law.values, x2) + 0.5 * _outer(law.slopes, x1)
    begin = _outer(law.values[:-1], x3[:-1]) + 1.5 * _outer(law.slopes[:-1], x2[:-1])
    end = _outer(law.end_values, x3[1:]) + 1.5 * _outer(law.end_slopes, x2[1:])
    begin += 0.5 * _outer(law.bends, x1[:-1])
    end += 0.5 * _outer(law.bends, x1[1:])
    sizes = np.linalg.norm(x1, axis=1, keepdims=True)
    ways = np.where(sizes > SLOWEST_TURN, x1 / np.maximum(sizes, SLOWEST_TURN), 0.0)
    return (
        Terms(acceleration / quantity.limits[1], ways, None),
        Terms(begin / quantity.limits[2], ways[:-1], law.values[:-1]),
        Terms(end / quantity.limits[2], ways[1:], law.end_values),
    )


def along_the_way(terms: Terms) -> Cuts:
    """Both signs of the quantity's own direction, wherever it moves."""
    moving = np.flatnonzero(terms.ways.any(axis=1))
    return _both_signs(terms, moving, terms.ways[moving])


def beyond(terms: Terms, controls: Array) -> tuple[float, Cuts]:
    """The largest value over the limit, and cuts where it is nearly one or more."""
    vectors = np.stack([around(terms.factors[:, :, d], controls) for d in range(terms.factors.shape[2])], axis=1)
    sizes = np.linalg.norm(vectors, axis=1)
    over = sizes if terms.squares is None else sizes * np.sqrt(around(terms.squares, controls))
    near = np.flatnonzero(over > NEAR)
    return float(over.max()), _both_signs(terms, near, vectors[near] / sizes[near, None])


def rows_of(cuts: Cuts, controls: Array, size: Array, fixed: NDArray[np.bool_]) -> Rows:
    """Cuts as rows of unknowns, control values over their ``size``.

    Args:
        cuts: What is asked for.
        controls: Near these, jerks are made linear, shape (n + 1,).
        size: Of the unknowns, shape (n + 1,).
        fixed: Unknowns that keep their size: no factors are left of them, shape (n + 1,).
    """
    at, factors, ends = cuts.numbers, cuts.factors, np.ones(len(cuts.numbers))
    if cuts.squares is not None:
        # 1 / sqrt(b) is at least 1.5 near^-0.5 - 0.5 b near^-1.5.
        near = around(cuts.squares, controls)[at]
        factors = factors + 0.5 * near[:, None] ** -1.5 * cuts.squares[at]
        ends = 1.5 * near**-0.5
    around_it = at[:, None] + np.arange(3)
    sizes, known = (np.append(values, 0.0)[around_it] for values in (size, fixed * 1.0))
    scaled = factors * sizes / ends[:, None]
    return Rows(at + 1, scaled * (1.0 - known), 1.0 - np.sum(scaled * known, axis=1))


def _outer(stencils: Array, rates: Array) -> Array:
    return stencils[:, :, None] * rates[:, None, :]


def _both_signs(terms: Terms, numbers: NDArray[np.int64], ways: Array) -> Cuts:
    along = np.einsum("nkd,nd->nk", terms.factors[numbers], ways)
    return Cuts(np.concatenate([numbers, numbers]), np.concatenate([along, -along]), terms.squares)
