"""How fast tool and joints may move: data with its origin (layer 6)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import ConfigError

Array = NDArray[np.float64]
MM, DEG = 1e-3, math.radians(1.0)

JOINT_SPEED = math.radians(180.0)
"""UR5e, every joint, as the maker publishes it [rad/s]."""
JOINT_ACCELERATION = 5.0
"""UR5e [rad/s^2]. The maker publishes torques (150 and 28 N m), no accelerations. This is the value the maker's own
public ROS driver gives to motion planners for all six joints and calls conservative."""
JOINT_JERK = 100.0
"""UR5e [rad/s^3]. Nobody publishes one. Chosen: the acceleration is reached in 0.05 s, as the tool's is in paper 4."""


def six(value: float) -> tuple[float, ...]:
    """The same limit for all six joints."""
    return (value,) * 6


class LimitValues(NamedTuple):
    """`SmoothingLimits` as compiled kernels take them: plain numbers and arrays, SI."""

    tip_speed: float
    tip_acceleration: float
    tip_jerk: float
    axis_speed: float
    axis_acceleration: float
    axis_jerk: float
    joint: Array
    """Speed, acceleration and jerk of the six joints, shape (3, 6)."""


def limit(default: float, unit: str, scale: float) -> Any:
    """Declare one limit: its default in the user's unit, that unit, and its size in SI."""
    return field(default=default * scale, metadata={"unit": unit, "scale": scale})


def joint_limit(default: float, unit: str) -> Any:
    """Declare one limit of six joints: its default [rad/s..] and the user's unit."""
    return field(default=six(default), metadata={"unit": unit, "scale": math.radians(1.0)})


@dataclass(frozen=True)
class SmoothingLimits:
    """Largest speed, acceleration and jerk of tool tip, tool axis and joints; all positive, infinity allowed.

    Tip limits are Euclidean norms of its time derivatives; axis limits those of the axis' angular velocity without
    spin, o x o', and of its first and second derivative. The tool's defaults are those of paper 4's trial.
    """

    tip_speed: float = limit(50.0, "mm_s", MM)
    """[m/s]."""
    tip_acceleration: float = limit(500.0, "mm_s2", MM)
    """[m/s^2]."""
    tip_jerk: float = limit(10000.0, "mm_s3", MM)
    """[m/s^3]."""
    axis_speed: float = limit(10.0, "deg_s", DEG)
    """[rad/s]."""
    axis_acceleration: float = limit(100.0, "deg_s2", DEG)
    """[rad/s^2]."""
    axis_jerk: float = limit(2000.0, "deg_s3", DEG)
    """[rad/s^3]."""
    joint_speed: tuple[float, ...] = joint_limit(JOINT_SPEED, "deg_s")
    """Six values [rad/s]."""
    joint_acceleration: tuple[float, ...] = joint_limit(JOINT_ACCELERATION, "deg_s2")
    """Six values [rad/s^2]."""
    joint_jerk: tuple[float, ...] = joint_limit(JOINT_JERK, "deg_s3")
    """Six values [rad/s^3]."""

    def __post_init__(self) -> None:
        for spec in fields(self):
            value = getattr(self, spec.name)
            if isinstance(spec.default, tuple):
                _check_six(spec.name, value)
            elif not value > 0.0:
                raise ConfigError(f"limit {spec.name} is {value:g}: every limit must be positive.")

    def values(self) -> LimitValues:
        """The same for compiled kernels."""
        joint = np.array([self.joint_speed, self.joint_acceleration, self.joint_jerk], dtype=float)
        return LimitValues(
            float(self.tip_speed),
            float(self.tip_acceleration),
            float(self.tip_jerk),
            float(self.axis_speed),
            float(self.axis_acceleration),
            float(self.axis_jerk),
            joint,
        )


def _check_six(name: str, values: tuple[float, ...]) -> None:
    if len(values) != 6:
        raise ConfigError(f"limit {name} has {len(values)} values: it needs six, one a joint from base to flange.")
    for j, value in enumerate(values):
        if not value > 0.0:
            raise ConfigError(f"limit {name} of joint {j + 1} is {value:g}: every limit must be positive.")
