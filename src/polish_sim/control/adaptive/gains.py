"""What the laws of ``hybrid-adaptive`` are told before the run, as one row of numbers (layer 7)."""

from __future__ import annotations

from typing import NamedTuple

from numba import njit
from numpy.typing import NDArray

from polish_sim.config import AdaptiveConfig
from polish_sim.errors import ConfigError

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
