"""Section [controller] of the scenario (layer 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

from polish_sim.config.adaptive import AdaptiveConfig
from polish_sim.config.baselines import BaselinesConfig
from polish_sim.config.key import key


@dataclass(frozen=True)
class ControllerConfig:
    """Gains of the shipped control laws (paper 1, eq. 5-7)."""

    name: str = key(
        "hybrid-pi",
        "hybrid-pi, hybrid-adaptive, hybrid-pi-position, position, admittance, impedance-position, force-mode or "
        "FILE.py:CLASS",
    )
    look_ahead_s: float = key(0.1, "T_a: time in which a position or angle error is taken back [s]", 0.01, 10.0)
    position_p: float = key(0.2, "kpp of eq. 6, on the velocity error [-]", 0.0, 0.95)
    position_d_s: float = key(0.0, "kpd of eq. 6, on the velocity error's derivative [s]", 0.0, 0.1)
    position_rate_p: float = key(10.0, "kpp of eq. 5, on the position error [1/s]", 0.0, 60.0)
    position_rate_d: float = key(0.1, "kpd of eq. 5, on the error's derivative [-]", 0.0, 0.95)
    orientation_p: float = key(0.2, "P of eq. 7, on the angular velocity error [-]", 0.0, 0.95)
    orientation_i_hz: float = key(0.2, "I of eq. 7 [1/s]", 0.0, 5.0)
    orientation_d_s: float = key(0.0, "D of eq. 7 [s]", 0.0, 0.1)
    force_p_m_sn: float = key(0.004, "kfp of eq. 5 [m/(s N)]", 0.0, 0.1)
    force_filter_hz: float = key(10.0, "low-pass on the measured force and moment in the loop [Hz]", 0.1, 500.0)
    force_limit_m_s: float = key(0.05, "largest speed the force loop may ask for [m/s]", 0.001, 1.0)
    force_i_m_s2n: float = key(0.012, "kfi of eq. 5 [m/(s^2 N)]", 0.0, 1.0)
    moment_p_rad_snm: float = key(
        0.1, "P of the moment loop about tool y; at 0.3 the tool's inertia rings [rad/(s N m)]", 0.0, 10.0
    )
    moment_i_rad_s2nm: float = key(0.03, "I of the moment loop about tool y [rad/(s^2 N m)]", 0.0, 10.0)
    moment_limit_rad_s: float = key(0.1, "largest turning rate the moment loop may ask for [rad/s]", 0.001, 3.0)
    moment_tilt_limit_rad: float = key(
        math.radians(2.0), "how far the moment loop may tilt the tool from the planned axis [rad]", 0.0, 0.5
    )
    adaptive: AdaptiveConfig = field(default_factory=AdaptiveConfig)
    baselines: BaselinesConfig = field(default_factory=BaselinesConfig)

    @property
    def label(self) -> str:
        """The name as titles have it: a user's file without its folders."""
        file, separator, class_name = self.name.rpartition(":")
        return f"{Path(file).name}:{class_name}" if separator else self.name
