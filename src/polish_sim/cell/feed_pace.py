"""How the target gains and loses speed along a path: from rest to the feed, and as the controller grants (layer 8a)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.timed_path import Pace

Array = NDArray[np.float64]

FEED_ACCELERATION = 0.05  # of the target along the path, at least [m/s^2]
LONGEST_RAMP = 0.5  # from rest to full speed along the path [s]
BUILD_UP = 0.04  # in which the acceleration along the path is built up [s]
FALL = 4.0  # times as fast as it rises the rate of the motion may fall
TRAVEL_SPEED = 0.05  # between two strokes, in free space [m/s]

TRAVEL_PACE = Pace(TRAVEL_SPEED, 0.5, 5.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def feed_acceleration(feed: float) -> float:
    """Acceleration of the target along the path [m/s^2] for a feed [m/s]."""
    return max(FEED_ACCELERATION, feed / LONGEST_RAMP)


def feed_pace(feed: float) -> Pace:
    """How a path is followed at a feed [m/s] where nothing else limits it: gently from rest to rest."""
    acceleration = feed_acceleration(feed)
    return Pace(feed, acceleration, acceleration / BUILD_UP)


@njit(cache=True, error_model="numpy", forceinline=True)
def stopping_time(feed: float, rate: float) -> float:
    """How long it takes to bring a motion at a feed [m/s] from a rate [-] to rest [s]."""
    return rate * feed / (FALL * feed_acceleration(feed)) + BUILD_UP


@njit(cache=True, error_model="numpy", forceinline=True)
def change_rate(clock: Array, wanted: float, feed: float, dt: float) -> None:
    """Lead the rate of a motion towards the ``wanted`` one; its first and second derivative stay limited."""
    rise = feed_acceleration(feed) / feed
    build_up = FALL * rise / BUILD_UP  # [1/s^2]
    short = wanted - clock[1]
    step = build_up * dt
    # The change from which a constant deceleration ends at the wanted rate.
    change = min(math.sqrt(0.25 * step * step + 2.0 * build_up * abs(short)) - 0.5 * step, abs(short) / dt)
    change = min(change, rise) if short > 0.0 else -min(change, FALL * rise)
    clock[2] += min(max(change - clock[2], -step), step)
    clock[1] += clock[2] * dt
    if clock[1] <= 0.0 or clock[1] >= 1.0:
        clock[1], clock[2] = min(max(clock[1], 0.0), 1.0), 0.0
