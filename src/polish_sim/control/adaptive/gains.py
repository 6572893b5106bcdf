"""Gains and memory of the laws of ``hybrid-adaptive``."""

from __future__ import annotations

import math
from typing import Annotated

from polish_sim.arrays import Array
from polish_sim.config import AdaptiveConfig
from polish_sim.control.hybrid import strike_gains
from polish_sim.control.loops import StrikeGains
from polish_sim.errors import ConfigError
from polish_sim.kernels import Matrix3, Record, Vector2

#: Each may be left out
LAWS = ("touch-down", "stiffness", "inertia", "feed-forward", "feed", "learning", "normal")


class AdaptiveGains(Record):
    """Beliefs about cell and sensor and limits, named as in ``AdaptiveConfig``, and which of ``LAWS`` are
    on."""

    stiffness_n_m: float  #: Springs of head and pad in series [N/m]
    damping_n_s_m: float  #: The head's damper as the part feels it [N s/m]
    damping_lag_s: float  #: Time in which the damper's force builds up [s]
    tool_mass_kg: float  #: What the wrist sensor carries [kg]
    tool_mass_doubt: float  #: Share of the carried mass the inertia law may be wrong by [-]
    sensor_latency_s: float  #: [s]
    sensor_bandwidth_hz: float  #: Corner of the sensor's low-pass [Hz]
    usual_noise_n: float  #: Noise of a low-passed reading for which the observer's corner is meant, rms [N]
    command_delay_s: float  #: From command to motion, until it has been measured [s]
    crossover_rad_s: float  #: Highest crossover of the force loop [rad/s]
    arm_mode: float  #: Vibration of the arm that the notch takes out without a course [rad/s]; 0: none
    observer_rad_s: float  #: Highest corner of the force observer [rad/s]
    delay_share: float  #: Crossover times command delay, at most [-]
    top_speed_m_s: float  #: Highest speed of the force loop [m/s]
    acceleration_m_s2: float  #: The robot's [m/s^2]
    stiff_first: float  #: Stiffness assumed at first touch, as a multiple of the drawn one [-]
    tool_center_m: float  #: Of the carried mass' centre above the tool point [m]
    feed_error_n: float  #: Budget of the force error [N]
    feed_least: float  #: Share of the planned feed that is always granted [-]
    #: Length over which the offset is averaged, and its slope taken to either side [m]
    learning_length_m: float
    learning_gain: float  #: Share of the neighbour's slope that is fed forward [-]
    normal_rate_1_s: float  #: Share of the angle seen that is taken back per time [1/s]
    normal_doubt_nm: float  #: By how much the moment off its sensor and its drawing is usually wrong [N m]
    normal_lean_rad: float  #: By how much a part usually leans [rad]
    normal_limit_rad: float  #: Largest correction of the planned axis [rad]
    normal_turning_rad_s: float  #: Largest rate of the correction [rad/s]
    head_stiffness_n_m: float  #: Spring between tool point and pad [N/m]
    pad_tilt_stiffness_nm_rad: float  #: Of the whole disc on a flat part [N m/rad]
    strike: StrikeGains
    touch_down: bool
    stiffness: bool
    inertia: bool
    feed_forward: bool
    feed: bool
    learning: bool
    normal: bool


def adaptive_gains(config: AdaptiveConfig) -> AdaptiveGains:
    """The gains a configuration asks for.

    Raises:
        ConfigError: If there is no law of a name; lists them.
    """
    on = set(config.laws.replace(",", " ").split())
    if unknown := sorted(on - set(LAWS)):
        raise ConfigError(
            f"controller.adaptive.laws: there is no law '{unknown[0]}'. Laws: {', '.join(LAWS)}."
        )
    by_name = {name: getattr(config, name) for name in AdaptiveGains.dtype.names if hasattr(config, name)}
    return AdaptiveGains(
        **by_name,
        **{name.replace("-", "_"): name in on for name in LAWS},
        arm_mode=2.0 * math.pi * config.arm_mode_hz,
        strike=strike_gains(config),
    )


# The memory of ``hybrid-adaptive`` along tool z, all zero after a reset.

LINE = 64  #: Cycles the delay lines hold
GainLine = Annotated[Array, (LINE,)]


class SensorCopy(Record):
    """A copy of the sensor's filter for what the host knows."""

    paths: GainLine  #: Travel into the part as the sensor's filter leaves it, the last cycles [m]
    forces: GainLine  #: The tool's own forces as the sensor's filter leaves them, the last cycles [N]
    at: int  #: Place in both
    path: float  #: Filtered travel [m]
    force: float  #: Filtered own force [N]


class SpeedAlongZ(Record):
    """The tool's speed along z."""

    last_speed: float  #: Of the last cycle [m/s]
    moved: bool  #: Whether there was a last cycle
    damper_speed: float  #: Low-passed speed of the head's damper [m/s]


class CommandDelay(Record):
    """From command to motion."""

    delay: float  #: [s]; 0 before the first cycle
    behind: float  #: Commanded less done travel [m]
    slowed: float  #: Low-passed command [m/s]
    last_command: float  #: [m/s]
    sent: GainLine  #: Commanded speeds, the last cycles [m/s]
    at: int  #: Place in ``sent``


class Air(Record):
    """What the reading is like in the air, and whether the tool touches."""

    watched: float  #: Time watched [s]
    mean: float  #: Of the reading [N]
    variance: float  #: Of its noise [N^2]
    fast: float  #: The reading at the faster low-pass [N]
    slow: float  #: At the slower one [N]
    fast_variance: float  #: Of the faster low-passed reading [N^2]
    approach_speed: float  #: Fastest approach [m/s]
    touches: bool
    target_contact: bool  #: The target's contact in the last cycle


class SpringFit(Record):
    """Sums of the least squares of force over travel since contact."""

    count: float  #: Of the readings
    mean_path: float  #: [m]
    mean_force: float  #: [N]
    spread: float  #: Of the travel [m^2]
    co_spread: float  #: Of both [N m]
    force_spread: float  #: Of the force [N^2]
    reached: bool  #: Whether the observed force has been the set force


class ForceObserver(Record):
    """The observed force b + k z."""

    at_no_travel: float  #: b [N]
    rate: float  #: Of b [N/s]
    travel: float  #: z since contact [m]
    stiffness: float  #: k [N/m]
    landed: float  #: How far the landing is over, 0 to 1 [-]
    age: float  #: Time since contact [s]
    slow: float  #: What the notch was given, low-passed [N]
    swing: float  #: Half of its part at the arm's vibration [N]


class PressMemory(Record):
    """Memory of the laws along tool z."""

    sensed: SensorCopy
    motion: SpeedAlongZ
    delay: CommandDelay
    air: Air
    fit: SpringFit
    force: ForceObserver


# The memory of the laws that use the path.


class LearningMemory(Record):
    """Memory of ``learn``."""

    average: float  #: Averaged offset [m]
    began: float  #: Arc length where the average began [m]; 0: it does not run
    last_row: int  #: Last row written


class NeighbourMemory(Record):
    """Memory of ``learned_rate``."""

    fading: float  #: 0 to 1 [-]
    slope: float  #: Of the neighbour turn, kept while it fades out [-]


class NormalMemory(Record):
    """Correction of the planned axis."""

    tilt: Vector2  #: About tool x and y [rad]
    moment: Vector2  #: Low-passed [N m]


class PathMemory(Record):
    """All zero after a reset."""

    learning: LearningMemory
    neighbour: NeighbourMemory
    feed_error: float  #: Averaged force error [N]
    normal: NormalMemory
    wanted: Matrix3  #: Orientation the turning loop aims at, R_base_tool
