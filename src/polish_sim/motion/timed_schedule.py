"""A smoothed chain as a motion over time that the cell can play (Chain, Schedule -> TimedPath)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.schedule import Schedule, ScheduleIndex, index_schedule, progress_at, sample_schedule
from polish_sim.motion.timed_path import TimedPath, row_times


def time_schedule(chain: Chain, schedule: Schedule, marks: Array) -> TimedPath:
    """Sample a schedule densely.

    Args:
        chain: The segments, base frame, at least one.
        schedule: When they are passed.
        marks: Arc length at the chain's way points [m], rising, shape (segments + 1,): the motion's places go from
            mark to mark as its segments progress.

    Returns:
        The motion.
    """
    clock = row_times(schedule.end)
    motion = sample_schedule(chain, schedule, clock)
    places, speeds = np.empty(len(clock)), np.empty(len(clock))
    _mark(schedule, index_schedule(chain, schedule), clock, marks, places, speeds)
    quaternions = Rotation.from_matrix(motion.rotations).as_quat(scalar_first=True)
    turned = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0
    quaternions[1:] *= np.cumprod(np.where(turned, -1.0, 1.0))[:, None]
    return TimedPath(
        float(clock[1] - clock[0]),
        schedule.end,
        np.ascontiguousarray(motion.tips[:, 0]),
        np.ascontiguousarray(motion.tips[:, 1]),
        np.ascontiguousarray(quaternions),
        np.ascontiguousarray(motion.spins[:, 0]),
        np.maximum.accumulate(places),
        speeds,
        np.ones(len(clock)),
    )


def places_at(chain: Chain, schedule: Schedule, marks: Array, times: Array) -> Array:
    """Arc length a schedule has come to, never falling.

    Args:
        chain: The segments.
        schedule: When they are passed.
        marks: Arc length at the way points [m], rising, shape (segments + 1,).
        times: Rising [s], shape (n,).

    Returns:
        [m], shape (n,).
    """
    places, speeds = np.empty(len(times)), np.empty(len(times))
    _mark(schedule, index_schedule(chain, schedule), times, marks, places, speeds)
    return np.maximum.accumulate(places)


def marks_on(chain: Chain, tips: Array, rotations: Array, s: Array) -> Array:
    """Arc lengths of a chain's way points, each of which is one of the points it was made of, in the same order.

    Args:
        chain: The chain.
        tips: Points it was made of [m], shape (m, 3).
        rotations: Tool frames there, shape (m, 3, 3).
        s: Arc length there [m], shape (m,).

    Returns:
        [m], shape (segments + 1,).
    """
    rows = np.empty(len(chain.tips), np.int64)
    _match(chain.tips, chain.rotations, tips, rotations, rows)
    return s[rows]


@njit(cache=True, error_model="numpy")
def _mark(schedule: Schedule, index: ScheduleIndex, clock: Array, marks: Array, places: Array, speeds: Array) -> None:
    rates = np.empty(4)
    for i in range(len(clock)):
        first = np.searchsorted(index.all_ended, clock[i], side="right")
        stop = max(first, np.searchsorted(index.none_begun, clock[i], side="right"))
        places[i], speeds[i] = marks[first], 0.0
        for k in range(first, stop):
            progress_at(schedule, index, k, clock[i], rates)
            places[i] += rates[0] * (marks[k + 1] - marks[k])
            speeds[i] += rates[1] * (marks[k + 1] - marks[k])


@njit(cache=True)
def _match(tips: Array, rotations: Array, raw_tips: Array, raw_rotations: Array, rows: Array) -> None:
    """Write the row of the raw point each way point is."""
    row = 0
    for k in range(len(tips)):
        while row + 1 < len(raw_tips) and not _same(tips[k], rotations[k], raw_tips[row], raw_rotations[row]):
            row += 1
        rows[k] = row


@njit(cache=True)
def _same(tip: Array, R: Array, other_tip: Array, other_R: Array) -> bool:
    for i in range(3):
        if tip[i] != other_tip[i]:
            return False
        for j in range(3):
            if R[i, j] != other_R[i, j]:
                return False
    return True
