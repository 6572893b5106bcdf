"""How far a spiral has gone from each turn towards the next one (matched turns -> shares; paper 1, section
1.3).

The spiral leaves its first turn within a short band, because that turn follows the border. Each further turn
is parallel to the one before, band included, and as it may come a little nearer or stay a little further
away, the way inwards spreads from the band over the whole turn, until the spiral is Archimedean.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, evenly_to
from polish_sim.planning.curve import Curve, Nearest

# Which places of neighbouring turns lie beside each other (two nested turns -> pairs in order).

ODD = 0.1  #: Feet whose distance differs from the step-over by more than this share belong to another turn
#: Where neighbouring turns are further apart than this many step-overs, one of them runs into an arm
ARM = 2.5
SAME = 2e-3  #: Pairs this near to each other, in step-overs, are one


class Match(NamedTuple):
    """Places of two turns beside each other, both growing from seam to seam."""

    outer: Array  #: Arc length from the seam on the outer turn [m], from 0 to its length, shape (n,)
    inner: Array  #: The same on the inner turn, shape (n,)
    beside: Bools  #: Whether the two places really lie beside each other, shape (n,)


def match_turns(outer: Curve, inner: Curve, outer_seam: float, inner_seam: float, stepover: float) -> Match:
    """Pair the points of an inner turn with their nearest points on the outer one, and the other way round.

    Round a corner the outer turn has points that are nearest to none of the inner one's; they all belong to
    the inner corner. So a share of the way from each pair's outer to its inner place is again a parallel
    turn. Where the outer turn runs into an arm the inner one does not follow, or the inner one is the offset
    of yet another turn, the places between are shared out evenly and marked.

    The turns begin at arc lengths ``outer_seam`` and ``inner_seam`` [m], whose nearest point on the outer
    turn is the first. Every point of both turns is among the pairs.
    """
    feet, heads = outer.nearest(inner.positions), inner.nearest(outer.positions)
    on_outer = np.mod(np.concatenate([feet.s, outer.knots[:-1]]) - outer_seam, outer.length) / outer.length
    on_inner = np.mod(np.concatenate([inner.knots[:-1], heads.s]) - inner_seam, inner.length) / inner.length
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


def beside(outer: Curve, inner: Curve, stepover: float) -> tuple[Bools, Bools]:
    """Which points of an outer and of the next inner turn lie beside the other turn, shapes (n,) and (m,)."""
    heads = inner.nearest(outer.positions)
    return heads.distances < ARM * stepover, _one_step(outer.nearest(inner.positions), stepover)


def _one_step(feet: Nearest, stepover: float) -> Bools:
    return np.abs(feet.distances / stepover - 1.0) < ODD


def _shared_out(outer: Array, inner: Array, beside: Bools, own: Bools) -> tuple[Array, Array]:
    """Give places that lie beside none a partner between those of their neighbours; own: place is the
    inner's."""
    order = np.flatnonzero(beside)[np.argsort((outer + inner)[beside], kind="stable")]
    known_outer = np.concatenate([[0.0], np.maximum.accumulate(outer[order]), [1.0]])
    known_inner = np.concatenate([[0.0], np.maximum.accumulate(inner[order]), [1.0]])
    outer = np.where(~beside & own, np.interp(inner, known_inner, known_outer), outer)
    inner = np.where(~beside & ~own, np.interp(outer, known_outer, known_inner), inner)
    return outer, inner


#: Share of the way inwards that moves from band to whole turn, per turn; spacing changes by half of it
SPREAD = 0.08
FLATTEST = 1e-3  #: Smaller curvatures of a turn count as this one, times the step-over
SAMPLES = 16  #: Samples of the share per step-over along a turn


class Shares(NamedTuple):
    """Share of the way from one turn to the next, as a function of the place on the turn."""

    values: Array  #: At evenly spaced places from the seam to the seam again, shape (n + 1,)
    length: float  #: Length of the turn [m]

    def at(self, s: Array) -> Array:
        """Shares at arc lengths from the seam [m], 0 to the length."""
        places = np.linspace(0.0, self.length, len(self.values))
        return np.interp(s, places, self.values)

    def around(self, s: Array) -> Array:
        """Shares any number of rounds away, where they grow by one per round."""
        turns = np.floor(s / self.length)
        where = (s / self.length - turns) * (len(self.values) - 1)
        return np.interp(where, np.arange(len(self.values)), self.values) + turns


def spread_shares(
    lengths: Sequence[float], matches: Sequence[Match], band: float, to_border: bool, stepover: float
) -> list[Shares]:
    """Shares of all turns of a spiral, from their ``lengths`` [m], outermost first, and the matches of
    neighbours.

    The spiral leaves its first turn within the length ``band`` [m] around the first seam; the last turn may
    follow a border too (``to_border``).
    """
    amounts = _amounts([bool(match.beside.all()) for match in matches], to_border)
    step = _first_step(_grid(lengths[0], stepover), band)
    out = [_spread(np.maximum(step.values, 0.0), amounts[0], amounts[min(1, len(matches))], lengths[0])]
    for i, match in enumerate(matches):
        # The step on this turn carried over to the next one.
        carried = step.around(np.interp(_grid(lengths[i + 1], stepover), match.inner, match.outer))
        beside = Shares(carried, lengths[i + 1])
        step = _parallel(beside, match, 1.0 - amounts[i], stepover)
        # Behind the seam the step is still that of the round before, ahead of it the next one comes.
        half = len(step.values) // 2
        values = np.concatenate([beside.values[:half], step.values[half:]])
        out.append(_spread(values, amounts[i + 1], amounts[min(i + 2, len(matches))], step.length))
    return out


def _spread(step: Array, amount: float, following: float, length: float) -> Shares:
    """A step mixed with an even drift; how much of either goes over into the next turn's."""
    phase = np.linspace(0.0, 1.0, len(step))
    mixed = (1.0 - phase) * amount + phase * following
    return Shares(mixed * (phase - 0.5) + (1.0 - mixed) * step, length)


def _amounts(even: Sequence[bool], to_border: bool) -> Array:
    """How Archimedean each turn may be, 0 to 1: not at all along borders and beside uneven turns."""
    rigid = np.zeros(len(even) + 1, dtype=bool)
    rigid[:2] = True
    rigid[-2:] |= to_border
    for i, is_even in enumerate(even):
        rigid[i : i + 2] |= not is_even
    away = np.abs(np.arange(len(rigid))[:, None] - np.flatnonzero(rigid)).min(axis=1)
    return np.minimum(SPREAD * away, 1.0)


def _grid(length: float, stepover: float) -> Array:
    return evenly_to(length, stepover / SAMPLES, 32)


def _first_step(grid: Array, band: float) -> Shares:
    """Smoothly from 0 to 1 around the seam."""
    length = grid[-1]
    u = np.clip(np.stack([grid, grid - length]) / band + 0.5, 0.0, 1.0)
    ahead, behind = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    return Shares(ahead - 1.0 + behind, length)


def _parallel(step: Shares, match: Match, height: float, stepover: float) -> Shares:
    """A step that keeps one step-over [m] from the step on the turn outside it.

    Its line is the upper envelope of circles around the outer one. Where turns get shorter inwards they bend
    about a
    middle: the circles are laid down in polar coordinates. ``height`` is the step's, in step-overs.
    """
    grid = np.linspace(0.0, step.length, len(step.values))
    beside = Shares(np.interp(grid, match.inner, match.outer) / match.outer[-1], step.length)
    longer = (
        (beside.around(grid + stepover) - beside.around(grid - stepover)) * match.outer[-1] / (2.0 * stepover)
    )
    radius = 1.0 / np.maximum(longer - 1.0, FLATTEST)  # of the turn, in step-overs
    best = step.values.copy()
    for reach in np.linspace(0.02, 0.9, 45):
        across = radius + 1.0 - np.sqrt(1.0 - reach**2)
        along = radius * np.arctan2(reach, across) * stepover
        fall = (np.hypot(across, reach) - radius) / max(height, SPREAD)
        for side in (-1.0, 1.0):
            best = np.maximum(best, step.around(grid + side * along) - fall)
    return Shares(best, step.length)
