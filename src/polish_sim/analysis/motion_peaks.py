"""The largest speed, acceleration and jerk of a smoothed motion, tool and joints, and where they are (layer 8c)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.joint_motion import joint_motion
from polish_sim.motion.smoothing.arm import Arm
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.sampling import Samples, sample_schedule, turning
from polish_sim.motion.smoothing.schedule import Schedule

Array = NDArray[np.float64]

ORDERS: Final = ("speed", "acceleration", "jerk")
EDGE: Final = 1e-7
"""Share of a stretch that is kept from its ends, where the jerk jumps."""
NODES, STEP_S = 5, 0.01
"""Samples in a stretch of constant tip jerk: so many at least, and one in so much time."""
MANY, FEWEST = 200_000, 2
"""In a motion of more stretches than this only their ends are looked at, and one sample in so much time."""
SHORTEST_S = 1e-9
"""A shorter stretch is left over by rounding where pieces meet, and none [s]."""
BLOCK = 100_000


class Peak(NamedTuple):
    """One largest value."""

    value: float
    """SI."""
    time: float
    """[s]."""


class MotionPeaks(NamedTuple):
    """Largest values of a motion; each a row of speed, acceleration, jerk."""

    tip: tuple[Peak, ...]
    """Norms of the tip's derivatives [m/s..]."""
    axis: tuple[Peak, ...]
    """Norms of the axis' angular velocity without spin and its derivatives [rad/s..]."""
    joints: tuple[tuple[Peak, ...], ...]
    """Of each order the six joints, without sign [rad/s..]; empty without a robot."""


class Motion(NamedTuple):
    """A motion at n times."""

    times: Array
    """[s], shape (n,)."""
    tool: Samples
    q: Array
    """Joint angles and three derivatives in time [rad/s^k], shape (4, n, 6); none without a robot: (4, n, 0)."""

    @property
    def tip_rates(self) -> Array:
        """Norms of the tip's first three derivatives [m/s..], shape (3, n)."""
        return np.linalg.norm(self.tool.tips[:, 1:], axis=2).T

    @property
    def axis_rates(self) -> Array:
        """Norms of the axis' angular velocity without spin and its derivatives [rad/s..], shape (3, n)."""
        return np.linalg.norm(turning(self.tool.axes), axis=2).T


def sample_motion(chain: Chain, schedule: Schedule, times: Array, arm: Arm | None) -> Motion:
    """Tool and joints at times.

    Args:
        chain: The segments, work frame.
        schedule: When they are passed.
        times: [s], rising, dense enough for the arm to be followed, shape (n,).
        arm: The robot; None for the tool alone.

    Returns:
        The motion, exact at every sample.

    Raises:
        ReachError: The arm cannot be there, or only singularly; names the place.
    """
    tool = sample_schedule(chain, schedule, times)
    if arm is None:
        return Motion(times, tool, np.empty((4, len(times), 0)))
    linear, angular = np.moveaxis(tool.tips[:, 1:], 1, 0), np.moveaxis(tool.spins, 1, 0)
    q = joint_motion(np.ascontiguousarray(tool.tips[:, 0]), tool.rotations, linear, angular, arm)
    return Motion(times, tool, np.stack(q))


def sample_in_blocks(chain: Chain, schedule: Schedule, times: Iterator[Array], arm: Arm | None) -> Iterator[Motion]:
    """`sample_motion` block by block, so that long motions need little memory; each begins where the last ended."""
    for block in times:
        motion = sample_motion(chain, schedule, block, arm)
        yield motion
        arm = None if arm is None else arm._replace(q_start=motion.q[0, -1].copy())


def stretch_times(schedule: Schedule) -> Iterator[Array]:
    """Times in every stretch in which the tip's jerk is constant, blocks of rising times.

    Within a stretch the tip's acceleration is linear and largest at an end; joint rates are smooth.
    """
    edges = np.unique(np.concatenate([schedule.starts, schedule.starts + schedule.durations, [0.0, schedule.end]]))
    edges = edges[(edges >= 0.0) & (edges <= schedule.end)]
    widths = np.diff(edges)
    begins, widths = edges[:-1][widths > SHORTEST_S], widths[widths > SHORTEST_S]
    least = NODES if len(widths) <= MANY else FEWEST
    counts = np.maximum(least, np.ceil(widths / STEP_S).astype(np.int64) + 1)
    filled = np.cumsum(counts)
    first = 0
    while first < len(counts):
        past = max(int(np.searchsorted(filled, (filled[first - 1] if first else 0) + BLOCK)), first + 1)
        yield _nodes(begins[first:past], widths[first:past], counts[first:past])
        first = past


def _nodes(begins: Array, widths: Array, counts: NDArray[np.int64]) -> Array:
    """Evenly spread times in each stretch, its ends all but included."""
    k = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(k)) - (np.cumsum(counts) - counts)[k]
    # Never on the edge itself, where rounding would let pieces overlap.
    edge = np.maximum(EDGE * widths, 8.0 * np.spacing(begins + widths))[k]
    return begins[k] + edge + (widths[k] - 2.0 * edge) * place / (counts[k] - 1)


def find_peaks(chain: Chain, schedule: Schedule, arm: Arm | None) -> MotionPeaks:
    """Measure a motion, at both ends of every stretch of constant tip jerk and between them.

    Args:
        chain: The segments, work frame.
        schedule: When they are passed.
        arm: The robot; None for the tool alone.

    Returns:
        The peaks.

    Raises:
        ReachError: The arm cannot be there.
    """
    columns = 2 if arm is None else 8
    best, at = np.full((3, columns), -1.0), np.zeros((3, columns))
    for motion in sample_in_blocks(chain, schedule, stretch_times(schedule), arm):
        rates = np.concatenate(
            [motion.tip_rates[:, :, None], motion.axis_rates[:, :, None], np.abs(motion.q[1:])], axis=2
        )
        row = rates.argmax(axis=1)
        value = np.take_along_axis(rates, row[:, None], axis=1)[:, 0]
        better = value > best
        best, at = np.where(better, value, best), np.where(better, motion.times[row], at)
    peaks = [[Peak(float(best[d, c]), float(at[d, c])) for c in range(columns)] for d in range(3)]
    joints = tuple(tuple(row[2:]) for row in peaks) if arm is not None else ()
    return MotionPeaks(tuple(row[0] for row in peaks), tuple(row[1] for row in peaks), joints)
