"""The gains of the shipped control laws."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from polish_sim.config.key import RUN, Option, free_keys, key


@dataclass(frozen=True)
class AdaptiveConfig:
    """What hybrid-adaptive believes of cell and sensor, its limits, and which of its laws are on."""

    laws: str = key(
        "touch-down stiffness inertia feed-forward feed learning normal",
        "laws composed; leave names out to ablate",
    )
    stiffness_n_m: float = key(5000.0, "springs of head and pad in series, as drawn [N/m]", 10.0, 1e7)
    damping_n_s_m: float = key(
        33.75, "head's damper as felt on the part, c (k_pad/(k_head+k_pad))^2 [N s/m]", 0.0, 1e4
    )
    damping_lag_s: float = key(0.00225, "time in which its force builds up, c/(k_head+k_pad) [s]", 1e-5, 1.0)
    tool_mass_kg: float = key(2.0, "mass the wrist sensor carries [kg]", 0.01, 100.0)
    tool_mass_doubt: float = key(0.35, "share of its inertia that may be wrong: mass, delay [-]", 0.01, 1.0)
    sensor_latency_s: float = key(0.002, "from force to reading, believed [s]", 0.0, 0.1)
    sensor_bandwidth_hz: float = key(80.0, "low-pass of the sensor, believed [Hz]", 1.0, 500.0)
    usual_noise_n: float = key(
        0.25, "noise of a reading beyond which the observer slows down, rms [N]", 0.001, 20.0
    )
    command_delay_s: float = key(
        0.01, "from command to motion, until measured on the way down [s]", 0.001, 0.1
    )
    crossover_rad_s: float = key(40.0, "highest crossover of the force loop [rad/s]", 1.0, 500.0)
    arm_mode_hz: float = key(
        24.0,
        "vibration of the arm along the tool axis that the force loop must not excite, where the path does "
        "not say it; 0 = rigid [Hz]",
        0.0,
        200.0,
    )
    gear_waves: float = key(202.0, "periods of the gears' error in a turn of a joint, believed [-]", 1.0, 1e4)
    observer_rad_s: float = key(25.0, "highest corner of the force observer [rad/s]", 1.0, 500.0)
    delay_share: float = key(0.5, "crossover times command delay, at most [-]", 0.05, 1.5)
    top_speed_m_s: float = key(0.1, "highest speed of the force loop [m/s]", 0.001, 1.0)
    acceleration_m_s2: float = key(1.2, "acceleration the force loop counts on [m/s^2]", 0.05, 20.0)
    tool_center_m: float = key(
        0.1226, "height of the mass the sensor carries above the tool point [m]", 0.0, 1.0
    )
    stiff_first: float = key(5.0, "stiffness at first touch, as a multiple of the drawn one [-]", 1.0, 50.0)
    feed_error_n: float = key(1.0, "force error for which the feed is slowed [N]", 0.05, 50.0)
    feed_least: float = key(0.1, "share of the planned feed that is always granted [-]", 0.02, 1.0)
    angular_acceleration_rad_s2: float = key(
        6.0, "angular acceleration the feed counts on [rad/s^2]", 0.05, 100.0
    )
    learning_length_m: float = key(
        0.005, "the surface found is averaged over this length of the path [m]", 0.001, 0.1
    )
    learning_gain: float = key(0.9, "share of what one turn found that the next one expects [-]", 0.0, 1.0)
    normal_rate_1_s: float = key(
        3.0, "share of the pad's tilt on the part taken back per time [1/s]", 0.0, 20.0
    )
    normal_doubt_nm: float = key(
        0.03, "what the moment is usually wrong by, of the sensor and of the drawing [N m]", 0.0, 10.0
    )
    normal_lean_rad: float = key(
        math.radians(0.5), "how far a part usually leans; beyond it the moment counts [rad]", 1e-4, 0.5
    )
    normal_limit_rad: float = key(
        math.radians(10.0), "largest correction of the planned axis by the pad's moment [rad]", 0.0, 0.5
    )
    normal_turning_rad_s: float = key(0.3, "fastest correction of the planned axis [rad/s]", 0.001, 3.0)
    head_stiffness_n_m: float = key(
        20000.0 / 3.0, "spring between tool point and pad, as drawn [N/m]", 10.0, 1e7
    )
    pad_tilt_stiffness_nm_rad: float = key(
        3.125, "disc pressed flat against tilting, k_pad R^2 / 4, as drawn [N m/rad]", 1e-3, 1e5
    )


@dataclass(frozen=True)
class BaselinesConfig:
    """Gains of the baseline force-mode."""

    mode_gain_scaling: float = key(0.5, "gain scaling of force-mode [-]", 0.01, 2.0)
    mode_damping: float = key(0.025, "damping of force-mode: share of the speed lost per 2 ms [-]", 0.0, 1.0)
    mode_mass_kg: float = key(
        48.5, "virtual mass of force-mode at a gain scaling of 1, as measured on a UR10e [kg]", 0.1, 1000.0
    )


@dataclass(frozen=True)
class ControllerConfig:
    """Gains of the shipped control laws (paper 1, eq. 5-7)."""

    name: str = key(
        "hybrid-pi",
        "hybrid-pi, hybrid-adaptive, hybrid-pi-position, position, force-mode, "
        "FILE.py:CLASS, or a policy: FILE.npz:linear or FILE.zip:sb3, which runs code it contains",
        option=Option("--controller", RUN, "NAME"),
    )
    look_ahead_s: float = key(
        0.1, "T_a: time in which a position or angle error is taken back [s]", 0.01, 10.0
    )
    position_p: float = key(0.2, "kpp of eq. 6, on the velocity error [-]", 0.0, 0.95)
    position_d_s: float = key(0.0, "kpd of eq. 6, on the velocity error's derivative [s]", 0.0, 0.1)
    position_rate_p: float = key(10.0, "kpp of eq. 5, on the position error [1/s]", 0.0, 60.0)
    position_rate_d: float = key(0.1, "kpd of eq. 5, on the error's derivative [-]", 0.0, 0.95)
    orientation_p: float = key(0.2, "P of eq. 7, on the angular velocity error [-]", 0.0, 0.95)
    orientation_i_hz: float = key(0.2, "I of eq. 7 [1/s]", 0.0, 5.0)
    orientation_d_s: float = key(0.0, "D of eq. 7 [s]", 0.0, 0.1)
    force_p_m_sn: float = key(0.004, "kfp of eq. 5 [m/(s N)]", 0.0, 0.1)
    force_filter_hz: float = key(
        5.0, "low-pass on the measured force in its loop; at 10 Hz an elastic arm swings [Hz]", 0.1, 500.0
    )
    moment_filter_hz: float = key(
        1.0, "low-pass on the measured moment in its loop; at 10 Hz an elastic arm swings [Hz]", 0.01, 500.0
    )
    force_limit_m_s: float = key(0.05, "largest speed the force loop may ask for [m/s]", 0.001, 1.0)
    force_i_m_s2n: float = key(0.012, "kfi of eq. 5 [m/(s^2 N)]", 0.0, 1.0)
    moment_p_rad_snm: float = key(
        0.1, "P of the moment loop about tool y; at 0.3 the tool's inertia rings [rad/(s N m)]", 0.0, 10.0
    )
    moment_i_rad_s2nm: float = key(0.03, "I of the moment loop about tool y [rad/(s^2 N m)]", 0.0, 10.0)
    moment_limit_rad_s: float = key(
        0.1, "largest turning rate the moment loop may ask for [rad/s]", 0.001, 3.0
    )
    moment_tilt_limit_rad: float = key(
        math.radians(2.0), "how far the moment loop may tilt the tool from the planned axis [rad]", 0.0, 0.5
    )
    own: Mapping[str, float | str] = free_keys(
        "parameters of an own controller, FILE.py:CLASS, by their names"
    )
    adaptive: AdaptiveConfig = AdaptiveConfig()
    baselines: BaselinesConfig = BaselinesConfig()

    @property
    def label(self) -> str:
        """The name as titles have it: a user's file without its folders."""
        file, separator, class_name = self.name.rpartition(":")
        return f"{Path(file).name}:{class_name}" if separator else self.name
