"""Which places of neighbouring turns lie beside each other (two nested turns -> pairs in order)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curves.curve import Curve, Nearest

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ODD = 0.1
"""Feet whose distance differs from the step-over by more than this share belong to another turn."""
ARM = 2.5
"""Where neighbouring turns are further apart than this many step-overs, one of them runs into an arm."""
SAME = 2e-3
"""Pairs this near to each other, in step-overs, are one."""


class Match(NamedTuple):
    """Places of two turns beside each other, both growing from seam to seam."""

    outer: Array
    """Arc length from the seam on the outer turn [m], from 0 to its length, shape (n,)."""
    inner: Array
    """The same on the inner turn, shape (n,)."""
    beside: Mask
    """Whether the two places really lie beside each other, shape (n,)."""


def match_turns(outer: Curve, inner: Curve, outer_seam: float, inner_seam: float, stepover: float) -> Match:
    """Pair the points of an inner turn with their nearest points on the outer one, and the other way round.

    Round a corner the outer turn has points that are nearest to none of the inner one's; they all belong to
    the inner corner. So a share of the way from each pair's outer to its inner place is again a parallel turn.
    Where the outer turn runs into an arm the inner one does not follow, or the inner one is the offset of yet
    another turn, the places between are shared out evenly and marked.

    Args:
        outer: A turn.
        inner: The next one inside it.
        outer_seam: Where the outer turn begins, arc length [m].
        inner_seam: Where the inner turn begins [m]; its nearest point on the outer turn is that seam.
        stepover: Distance between both [m].

    Returns:
        The pairs, every point of both turns among them.
    """
    feet, heads = outer.nearest(inner.positions), inner.nearest(outer.positions)
    on_outer = _from_seam(outer, np.concatenate([feet.s, outer.knots[:-1]]), outer_seam) / outer.length
    on_inner = _from_seam(inner, np.concatenate([inner.knots[:-1], heads.s]), inner_seam) / inner.length
    # Just beside the seam one of a pair may lie before it and the other behind.
    split = np.abs(on_outer - on_inner) > 0.5
    own = np.arange(len(on_outer)) < len(feet.s)
    on_outer = np.where(split & own, np.round(on_inner), on_outer)
    on_inner = np.where(split & ~own, np.round(on_outer), on_inner)
    good = np.concatenate([_one_step(feet, stepover), heads.distances < ARM * stepover])
    on_outer, on_inner = _shared_out(on_outer, on_inner, good, own)
    order = np.argsort(on_outer + on_inner, kind="stable")
    # Of pairs in one place rounding would decide which comes first.
    order = order[np.diff((on_outer + on_inner)[order], prepend=0.0) > SAME * stepover / outer.length]
    ends = np.array([0.0, 1.0])
    return Match(
        np.insert(ends, 1, np.maximum.accumulate(on_outer[order])) * outer.length,
        np.insert(ends, 1, np.maximum.accumulate(on_inner[order])) * inner.length,
        np.insert(np.ones(2, dtype=bool), 1, good[order]),
    )


def beside(outer: Curve, inner: Curve, stepover: float) -> tuple[Mask, Mask]:
    """Which points of an outer and of the next inner turn lie beside the other turn, shapes (n,) and (m,)."""
    heads = inner.nearest(outer.positions)
    return heads.distances < ARM * stepover, _one_step(outer.nearest(inner.positions), stepover)


def _one_step(feet: Nearest, stepover: float) -> Mask:
    return np.asarray(np.abs(feet.distances / stepover - 1.0) < ODD)


def _shared_out(outer: Array, inner: Array, beside: Mask, own: Mask) -> tuple[Array, Array]:
    """Give places that lie beside none a partner between those of their neighbours; own: place is the inner's."""
    order = np.flatnonzero(beside)[np.argsort((outer + inner)[beside], kind="stable")]
    known_outer = np.concatenate([[0.0], np.maximum.accumulate(outer[order]), [1.0]])
    known_inner = np.concatenate([[0.0], np.maximum.accumulate(inner[order]), [1.0]])
    outer = np.where(~beside & own, np.interp(inner, known_inner, known_outer), outer)
    inner = np.where(~beside & ~own, np.interp(outer, known_outer, known_inner), inner)
    return outer, inner


def _from_seam(curve: Curve, s: Array, seam: float) -> Array:
    return np.asarray(np.mod(s - seam, curve.length))
