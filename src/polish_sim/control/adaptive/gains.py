"""What the laws of ``hybrid-adaptive`` are told before the run, as one row of numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import AdaptiveConfig
from polish_sim.control.adaptive.drawing import Abilities, FeedForwardGains, FeedGains
from polish_sim.control.adaptive.surface import LearningGains, NormalGains
from polish_sim.errors import ConfigError
from polish_sim.kernel_cache import njit

LAWS = ("touch-down", "stiffness", "inertia", "feed-forward", "feed", "learning", "normal")
"""Names of the laws; without one of them the others go on."""


class AdaptiveGains(NamedTuple):
    """Beliefs about cell and sensor, limits, and which laws are on; see ``AdaptiveConfig``."""

    stiffness: float
    """Springs of head and pad in series [N/m]."""
    damping: float
    """The head's damper as the part feels it [N s/m]."""
    damping_lag: float
    """Time in which the damper's force builds up [s]."""
    mass: float
    """What the wrist sensor carries [kg]."""
    mass_doubt: float
    """Share of the carried mass the inertia law may be wrong by [-]."""
    sensor_latency: float
    """[s]"""
    sensor_hz: float
    """Corner of the sensor's low-pass [Hz]."""
    noise: float
    """Noise of a low-passed reading for which ``observer`` is meant, rms [N]."""
    command_delay: float
    """From command to motion, until it has been measured [s]."""
    crossover: float
    """Highest crossover of the force loop [rad/s]."""
    observer: float
    """Highest corner of the force observer [rad/s]."""
    delay_share: float
    """Crossover times command delay, at most [-]."""
    speed: float
    """Highest speed of the force loop [m/s]."""
    acceleration: float
    """The robot's [m/s^2]."""
    force_rate: float
    """Fastest rise of the force [N/s]."""
    stiff_first: float
    """Stiffness assumed at first touch, as a multiple of ``stiffness`` [-]."""
    touch_down: float
    """1 if the law is on, else 0."""
    estimates: float
    """1 if the law ``stiffness`` is on, else 0."""
    inertia: float
    """1 if the law is on, else 0."""
    mass_height: float
    """Of the carried mass' centre above the tool point [m]."""


GAINS_SIZE = len(AdaptiveGains._fields)


def adaptive_gains(config: AdaptiveConfig) -> AdaptiveGains:
    """The gains a configuration asks for.

    Raises:
        ConfigError: If it names a law that does not exist.
    """
    on = laws_of(config)
    return AdaptiveGains(
        config.stiffness_n_m,
        config.damping_n_s_m,
        config.damping_lag_s,
        config.tool_mass_kg,
        config.tool_mass_doubt,
        config.sensor_latency_s,
        config.sensor_bandwidth_hz,
        config.usual_noise_n,
        config.command_delay_s,
        config.crossover_rad_s,
        config.observer_rad_s,
        config.delay_share,
        config.top_speed_m_s,
        config.acceleration_m_s2,
        config.force_rate_n_s,
        config.stiff_first,
        float("touch-down" in on),
        float("stiffness" in on),
        float("inertia" in on),
        config.tool_center_m,
    )


def laws_of(config: AdaptiveConfig) -> frozenset[str]:
    """Names of the laws that are on.

    Raises:
        ConfigError: If there is no law of that name; lists them.
    """
    named = frozenset(config.laws.replace(",", " ").split())
    unknown = sorted(named - set(LAWS))
    if unknown:
        raise ConfigError(f"controller.adaptive.laws: there is no law '{unknown[0]}'. Laws: {', '.join(LAWS)}.")
    return named


@njit(cache=True)
def gains_in(row: NDArray) -> AdaptiveGains:  # type: ignore[type-arg]
    """The gains as they stand in the context, from row (20,)."""
    return AdaptiveGains(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9],
        row[10], row[11], row[12], row[13], row[14], row[15], row[16], row[17], row[18], row[19],
    )  # fmt: skip


# The memory of ``hybrid-adaptive`` along tool z, as named views of one array.

Array = NDArray[np.float64]

LINE = 64
"""Cycles the delay lines hold."""
MEMORY_SIZE = 3 * LINE + 31

# Slots of the memory's small arrays, as ``PressMemory`` describes them.
SENSED_AT, SENSED_PATH, SENSED_OWN, SENT_AT = 0, 1, 2, 3
LAST_SPEED, MOVED, DAMPER_SPEED = 0, 1, 2
DELAY, BEHIND, SLOWED, LAST_COMMAND = 0, 1, 2, 3
WATCHED, AIR_MEAN, AIR_VARIANCE, FAST, SLOW, TOUCHES, APPROACH_SPEED, TOLD, FAST_VARIANCE = 0, 1, 2, 3, 4, 5, 6, 7, 8
WEIGHT, MEAN_PATH, MEAN_FORCE, SPREAD, CO_SPREAD = 0, 1, 2, 3, 4
AT_NO_TRAVEL, RATE, TRAVEL, STIFFNESS, LANDED, AGE = 0, 1, 2, 3, 4, 5


class PressMemory(NamedTuple):
    """All zero after a reset."""

    path_line: Array
    """Travel into the part as the sensor's filter leaves it, the last cycles [m], shape (64,)."""
    own_line: Array
    """The tool's own forces as the sensor's filter leaves them, the last cycles [N], shape (64,)."""
    sent: Array
    """Commanded speeds along tool z, the last cycles [m/s], shape (64,)."""
    line: Array
    """Place in the lines of the sensor; filtered travel [m] and own force [N]; place in ``sent``, shape (4,)."""
    motion: Array
    """Tool speed of the last cycle [m/s], whether there was one, low-passed speed of the damper [m/s], shape (3,)."""
    delay: Array
    """Command delay [s], commanded less done travel [m], slowed command [m/s], last command [m/s], shape (4,)."""
    air: Array
    """Time watched [s]; mean of the reading in the air [N], variance of its noise [N^2]; the reading at two low-passes
    [N]; whether the tool touches; fastest approach [m/s]; the target's contact before; variance of the faster
    low-passed reading [N^2], shape (9,)."""
    fit: Array
    """Weight, mean travel [m], mean force [N], spread of the travel [m^2], of both [N m], shape (5,)."""
    force: Array
    """Force at no travel [N], its rate [N/s], travel since contact [m], stiffness [N/m], how far landed [-],
    time since contact [s], shape (6,)."""


@njit(cache=True)
def memory_in(flat: Array) -> PressMemory:
    """Named views of a flat memory, shape (223,)."""
    n = 3 * LINE
    return PressMemory(
        flat[0:64],
        flat[64:128],
        flat[128:192],
        flat[n : n + 4],
        flat[n + 4 : n + 7],
        flat[n + 7 : n + 11],
        flat[n + 11 : n + 20],
        flat[n + 20 : n + 25],
        flat[n + 25 : n + 31],
    )


# Gains and memory of the laws that use the path, as they lie in the context.

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
