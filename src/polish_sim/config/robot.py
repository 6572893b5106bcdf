"""Section [robot] of the scenario (layer 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class RobotConfig:
    """The velocity interface of the robot and its start."""

    command_latency_s: float = key(0.006, "from command to motion [s]", 0.0, 0.1)
    linear_acceleration_m_s2: float = key(1.2, "speedl tool acceleration [m/s^2]", 0.05, 20.0)
    angular_acceleration_rad_s2: float = key(6.0, "speedl tool angular acceleration [rad/s^2]", 0.05, 100.0)
    command_timeout_s: float = key(0.1, "a speedl command holds for this long, then the robot stops [s]", 0.002, 10.0)
    joint_speed_limit_rad_s: float = key(math.pi, "limit of every joint's speed [rad/s]", 0.01, 2 * math.pi)
    payload_error: float = key(0.0, "relative error of the payload mass the robot was told [-]", -0.9, 5.0)
