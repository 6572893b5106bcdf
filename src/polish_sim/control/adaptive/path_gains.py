"""Gains and memory of the laws that use the path, as they lie in the context (layer 7)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.config import AdaptiveConfig
from polish_sim.control.adaptive.feed import Abilities, FeedGains
from polish_sim.control.adaptive.feed_forward import FeedForwardGains
from polish_sim.control.adaptive.gains import laws_of
from polish_sim.control.adaptive.learning import LearningGains
from polish_sim.control.adaptive.normal import NormalGains

Array = NDArray[np.float64]

FEED_AVERAGE_S = 0.1  # of the force error that slows the feed [s]
FADE_S = 0.1  # of what a neighbour turn knows [s]
PATH_GAINS_SIZE = 17
PATH_MEMORY_SIZE = 32


class PathGains(NamedTuple):
    """Gains of the four laws."""

    forward: FeedForwardGains
    feed: FeedGains
    learning: LearningGains
    normal: NormalGains


class PathMemory(NamedTuple):
    """All zero after a reset."""

    learning: Array
    """Averaged offset [m], where it began [m], last row written, shape (3,)."""
    neighbour: Array
    """Fading [-] and slope [-] of the neighbour turn, shape (2,)."""
    feed: Array
    """Averaged force error [N], shape (1,)."""
    normal: Array
    """Correction about tool x and y [rad] and its rates [rad/s], shape (4,)."""
    wanted: Array
    """Orientation the turning loop aims at, R_base_tool, shape (3, 3)."""
    nothing: Array
    """Zeros, shape (3,)."""


def path_gains(config: AdaptiveConfig) -> Array:
    """The gains a configuration asks for, shape (17,).

    Raises:
        ConfigError: If it names a law that does not exist.
    """
    on = laws_of(config)
    return np.array([
        *FeedForwardGains(config.command_delay_s, float("feed-forward" in on)),
        *FeedGains(config.feed_error_n, FEED_AVERAGE_S, config.feed_least, float("feed" in on)),
        *LearningGains(config.learning_length_m, 0.0, FADE_S, config.learning_gain, float("learning" in on)),
        *NormalGains(
            config.normal_rate_1_s, config.normal_limit_rad, config.normal_turning_rad_s, config.head_stiffness_n_m,
            config.pad_tilt_stiffness_nm_rad, float("normal" in on),
        ),
    ])  # fmt: skip


def abilities(config: AdaptiveConfig) -> Abilities:
    """What the feed law counts on."""
    return Abilities(
        config.feed_error_n, config.crossover_rad_s, config.acceleration_m_s2, config.angular_acceleration_rad_s2
    )


@njit(cache=True)
def path_gains_in(row: Array) -> PathGains:
    """The gains as they stand in the context."""
    return PathGains(
        FeedForwardGains(row[0], row[1]),
        FeedGains(row[2], row[3], row[4], row[5]),
        LearningGains(row[6], row[7], row[8], row[9], row[10]),
        NormalGains(row[11], row[12], row[13], row[14], row[15], row[16]),
    )


@njit(cache=True)
def path_memory_in(flat: Array) -> PathMemory:
    """Named views of the memory, shape (32,)."""
    return PathMemory(flat[0:3], flat[3:5], flat[5:6], flat[6:10], flat[10:19].reshape((3, 3)), flat[19:22])
