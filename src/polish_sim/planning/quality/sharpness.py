"""How suddenly a path turns: its sharpest corner in the surface, and the rate of its tool axis (path -> figures)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.quality.located import PathOnSurface
from polish_sim.planning.toolpath import arc_length

Array = NDArray[np.float64]

CORNER_M = 1e-3
"""A corner's angle is the one between the chords of this length before and after it [m]."""
RATE_M = 1e-3
"""The axis rate is the turn over this length of the path [m]: shorter ones would show the digits of a file."""


class Peak(NamedTuple):
    """A largest value and where it is."""

    value: float
    position: Array
    """[m], shape (3,)."""


class AxisRate(NamedTuple):
    """Turn of the tool axis per length along the path."""

    s: Array
    """Arc length in contact, run after run [m], shape (n,)."""
    rate: Array
    """[rad/m], shape (n,)."""
    peak: Peak


def sharpest_corner(runs: Sequence[Curve]) -> Peak:
    """Largest change of direction within the surface, at the scale of 1 mm.

    Args:
        runs: Each run in contact, an open curve.

    Returns:
        Angle [rad] and place; zero for paths shorter than 2 mm.
    """
    best = Peak(0.0, runs[0].positions[0])
    for curve in runs:
        inside = (curve.knots >= CORNER_M) & (curve.knots <= curve.length - CORNER_M)
        if not inside.any():
            continue
        s, normals, here = curve.knots[inside], curve.normals[inside], curve.positions[inside]
        before, after = here - curve.at(s - CORNER_M)[0], curve.at(s + CORNER_M)[0] - here
        before, after = (v - (v * normals).sum(axis=1)[:, None] * normals for v in (before, after))
        turn = np.arctan2(np.linalg.norm(np.cross(before, after), axis=1), (before * after).sum(axis=1))
        k = int(turn.argmax())
        if turn[k] > best.value:
            best = Peak(float(turn[k]), here[k])
    return best


def measure_axis_rate(on: PathOnSurface) -> AxisRate:
    """Turn of the tool axis over each millimetre of the path in contact.

    Args:
        on: The path.

    Returns:
        The rate along the path, and its peak.
    """
    along, rates, places = [], [], []
    begin = 0.0
    for rows in on.stretches:
        s = arc_length(on.positions[rows])
        span = min(RATE_M, float(s[-1]))
        # From every waypoint ahead, and from the last places a whole span fits.
        first = np.append(s[s < s[-1] - span], s[-1] - span)
        axes = Curve(on.positions[rows], on.axes[rows], False)
        before, after = axes.at(first)[1], axes.at(first + span)[1]
        turn = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(after - before, axis=1), 0.0, 1.0))
        along.append(begin + first + 0.5 * span)
        rates.append(turn / span)
        places.append(axes.at(first + 0.5 * span)[0])
        begin += float(s[-1])
    rate, where = np.concatenate(rates), np.concatenate(places)
    k = int(rate.argmax())
    return AxisRate(np.concatenate(along), rate, Peak(float(rate[k]), where[k]))
