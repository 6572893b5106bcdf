"""How far a motion strays from its way points at given times (Chain, Schedule, raw Chain -> curves; layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.deviation import raw_places
from polish_sim.motion.smoothing.polyline import axis_distance, tip_distance
from polish_sim.motion.smoothing.sampling import ScheduleIndex, index_schedule, sample_schedule
from polish_sim.motion.smoothing.schedule import Schedule

Array = NDArray[np.float64]


class DeviationCurve(NamedTuple):
    """Deviations at n times."""

    tip: Array
    """Distance of the tip from the polyline [m], shape (n,)."""
    axis: Array
    """Angle of the tool axis to its arcs [rad], shape (n,)."""


def deviation_curve(chain: Chain, schedule: Schedule, raw: Chain, times: Array) -> DeviationCurve:
    """Measure a motion against the stretch of the way points it is on at each time.

    Args:
        chain: The segments the schedule passes; each way point one of the raw chain's, in order.
        schedule: When they are passed.
        raw: The way points as given.
        times: [s], shape (n,).

    Returns:
        The deviations.
    """
    seen = sample_schedule(chain, schedule, times)
    curve = DeviationCurve(np.zeros(len(times)), np.zeros(len(times)))
    tips, axes = np.ascontiguousarray(seen.tips[:, 0]), np.ascontiguousarray(seen.axes[:, 0])
    _fill(index_schedule(chain, schedule), raw, raw_places(chain, raw), times, tips, axes, curve)
    return curve


@njit(cache=True, error_model="numpy")
def _fill(
    index: ScheduleIndex,
    raw: Chain,
    places: NDArray[np.int64],
    times: Array,
    tips: Array,
    axes: Array,
    curve: DeviationCurve,
) -> None:
    for i in range(times.shape[0]):
        early = np.searchsorted(index.all_ended, times[i], side="right")
        late = np.searchsorted(index.none_begun, times[i], side="right")
        if late > early:
            curve.tip[i] = tip_distance(raw, places[early], places[late], tips[i])
            curve.axis[i] = axis_distance(raw, places[early], places[late], axes[i])
