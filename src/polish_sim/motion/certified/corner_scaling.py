"""A kernel's shape scaled in size and time until limits and tolerances of tip and axis hold, proven (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_bounds import Peaks, bound_deviation, distance_from_vertex, measure_peaks
from polish_sim.motion.certified.corner_pieces import scale_pieces
from polish_sim.motion.certified.corner_task import (
    ROUNDING,
    CornerFigures,
    CornerLimits,
    CornerWeights,
    Side,
    axis_side,
    tip_side,
)

Array = NDArray[np.float64]

VERTEX_SHARE = 2.0
"""How many tolerances a corner's vertex may be missed by; binds beyond turns of 120 deg, where staying close to the
polyline alone would let the tip of a spike be cut off."""


class Fit(NamedTuple):
    """A scaled kernel, and whether it was the axis that asked for it."""

    figures: CornerFigures
    axis_binds: bool


@njit(cache=True, error_model="numpy", _nrt=False)
def fit_limits(
    tip: Side,
    axis: Side,
    limits: CornerLimits,
    figures: CornerFigures,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> Fit:
    """Scale a kernel to full jerk, as large as speeds and tolerances allow, as slow as accelerations ask for."""
    one = _asked(tip, durations, remaining, gone)
    two = _asked(axis, durations, remaining, gone)
    off_tip = share_used(tip, figures, durations, remaining, gone)
    off_axis = share_used(axis, figures, durations, remaining, gone)
    axis_binds = (
        off_axis > off_tip or two.speed > one.speed or two.acceleration > one.acceleration or two.jerk > one.jerk
    )
    along = figures.acceleration / limits.segment_acceleration
    acceleration = max(one.acceleration, two.acceleration, along) / ROUNDING
    jerk = max(one.jerk, two.jerk) / ROUNDING
    root = jerk ** (1.0 / 3.0)
    top = figures.speed / root + 0.5 * figures.acceleration**2 / limits.segment_jerk / root**4
    # Speeds grow with length^(2/3) at full jerk.
    share = max(top / limits.segment_speed, one.speed / root, two.speed / root) / ROUNDING
    length = min(share**-1.5, 1.0 / max(off_tip, off_axis))
    time = max(root * length ** (1.0 / 3.0), math.sqrt(length * acceleration))
    return Fit(scaled(figures, length, time, durations, remaining, gone), axis_binds)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _asked(side: Side, durations: Array, remaining: Array, gone: Array) -> Peaks:
    """Peaks of a kernel on one side as shares of its limits."""
    peaks, most = measure_peaks(side.pair, durations, remaining, gone), side.limits
    return Peaks(peaks.speed / most.speed, peaks.acceleration / most.acceleration, peaks.jerk / most.jerk)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def scaled(
    figures: CornerFigures, length: float, time: float, durations: Array, remaining: Array, gone: Array
) -> CornerFigures:
    """Scale pieces and figures."""
    scale_pieces(durations, remaining, gone, length, time)
    return CornerFigures(
        figures.size * length,
        figures.speed * length / time,
        figures.acceleration * length / (time * time),
        figures.duration * time,
    )


@njit(cache=True, error_model="numpy", _nrt=False)
def share_used(side: Side, figures: CornerFigures, durations: Array, remaining: Array, gone: Array) -> float:
    """Share of a side's tolerance that a kernel uses, at most; a smaller one of its kind uses less."""
    angle = 1.2 * figures.size * max(side.pair.first, side.pair.second) if side.bends else 0.0
    deviation = bound_deviation(side.pair, 3.0 * angle**3, durations, remaining, gone)
    missed = distance_from_vertex(side.pair, remaining, gone) / VERTEX_SHARE
    return max(deviation, missed) * (1.0 + angle * angle) / side.tolerance


@njit(cache=True, error_model="numpy", _nrt=False)
def fit_ends(
    weights: CornerWeights,
    limits: CornerLimits,
    figures: CornerFigures,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> CornerFigures:
    """Shrink a kernel until it stays beside its two segments, which may be short, and not just beside their lines."""
    spans = weights.spans
    length = min(spans[0], spans[1]) / figures.size if figures.size > 0.0 else 1.0
    if length < 1.0:
        figures = scaled(figures, length, length ** (1.0 / 3.0), durations, remaining, gone)
    tip, axis = tip_side(weights, limits, spans), axis_side(weights, limits, spans)
    off = max(
        share_used(tip, figures, durations, remaining, gone), share_used(axis, figures, durations, remaining, gone)
    )
    if off > 1.0:
        # What is past an end falls faster than the kernel.
        figures = scaled(figures, 1.0 / off, off ** (-1.0 / 3.0), durations, remaining, gone)
    return figures
