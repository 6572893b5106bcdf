"""Poses for the calibration of a payload: gravity along well spread directions of the sensor, easy to
reach."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise, starmap
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.calibration.payload import condition_of, payload_regressor
from polish_sim.errors import CalibrationError
from polish_sim.motion import forward

PAN, LIFT, ELBOW, WRIST_2 = 1.3, -1.59, 1.51, -0.5 * math.pi  #: Joints that stay [rad]: 0.7 m above the table
TOOL_DOWN = -0.5 * math.pi - LIFT - ELBOW  #: Wrist 1, tool straight down [rad]; by pi less: straight up
WRIST_SPEED = 0.6  #: Mean speed of the joint with the longest way between two poses, at most [rad/s]
#: At most [rad/s^2]: 0.42 m from the wrist the tool keeps below the robot's 1.2 m/s^2
WRIST_ACCELERATION = 1.5
LEAST_POSES = 4


class PosePlan(NamedTuple):
    """Where the robot stands still to read its sensor."""

    q: Array  #: Joint angles [rad], shape (n, 6)
    R_base_sensor: Array  #: Orientation of the sensor, shape (n, 3, 3)
    condition: float  #: Condition number of the poses; 1.22 is the best possible

    @property
    def move_times(self) -> Array:
        """Time for the way to each pose from the one before [s], shape (n,); 0 to the first."""
        return np.array([0.0, *starmap(move_time, pairwise(self.q))])


def move_time(q_from: Array, q_to: Array) -> float:
    """Time for the way between two poses [s], see ``move``."""
    longest = np.abs(q_to - q_from).max()
    return max(longest / WRIST_SPEED, math.pi * math.sqrt(0.5 * longest / WRIST_ACCELERATION))


def move(q_from: Array, q_to: Array, share: Array) -> Array:
    """Joint angles (k, 6) [rad] from one pose (6,) to another along half a cosine, at shares of the time
    (k,)."""
    return q_from + 0.5 * (1.0 - np.cos(math.pi * share))[:, None] * (q_to - q_from)


@cache
def plan_payload_poses(count: int) -> PosePlan:
    """Spread the up direction of four or more poses evenly over the whole sphere of the sensor.

    Wrist 1 tilts the tool from straight down, out and up; wrist 3 turns it about its axis. The other joints
    stay, so that the arm keeps clear of itself, of the table and of singularities. The tool points down in
    the first pose, each next one is close to the last. Fewer than four poses: CalibrationError.
    """
    if count < LEAST_POSES:
        raise CalibrationError(
            f"{count} poses are too few to calibrate a payload: give {LEAST_POSES} or more."
        )
    # Points of a golden spiral, equal area each.
    index = np.arange(count)
    tilt = np.arccos(1.0 - (2.0 * index + 1.0) / count)
    azimuth = np.mod(index * math.pi * (3.0 - math.sqrt(5.0)) + math.pi, 2.0 * math.pi) - math.pi
    order = _short_way(np.column_stack([tilt, azimuth]))
    q = np.tile([PAN, LIFT, ELBOW, TOOL_DOWN, WRIST_2, 0.0], (count, 1))
    q[:, 3] -= tilt[order]
    q[:, 5] = azimuth[order]
    R = np.ascontiguousarray(forward(q)[:, :3, :3])
    for array in (q, R):
        array.flags.writeable = False
    return PosePlan(q, R, condition_of(payload_regressor(R[:, 2, :], None, 1.0)))


def _short_way(places: Array) -> Indices:
    """Order in which to visit joint angles (n, 2): from the first always to the nearest not yet seen."""
    order = [0]
    left = list(range(1, len(places)))
    while left:
        ways = np.abs(places[left] - places[order[-1]]).max(axis=1)
        order.append(left.pop(int(np.argmin(ways))))
    return np.array(order)
