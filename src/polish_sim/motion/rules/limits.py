"""How fast tool and joints may move: data with its origin."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import LARGEST, ConfigError, check_name, named_place
from polish_sim.scenario_file import checked_value, is_number, leaves
from polish_sim.toml_text import read_toml, toml_text

MM, DEG = 1e-3, math.radians(1.0)
LEAST = 1e-9  #: Smallest limit a file may set, in its unit
JOINT_SPEED = math.radians(180.0)  #: Every joint of the default arm, as its maker publishes it [rad/s]
JOINT_ACCELERATION = 5.0
"""[rad/s^2]. The maker publishes torques, no accelerations. This is the value the maker's own
public ROS driver gives to motion planners for all six joints and calls conservative."""
#: [rad/s^3]; none is published. Reaches the acceleration in 0.05 s, as paper 4's tool does
JOINT_JERK = 100.0


def six(value: float) -> tuple[float, ...]:
    """The same limit for all six joints."""
    return (value,) * 6


SECTIONS = ("tip", "axis", "joint")
"""Sections of the TOML file, whose values have the units users of robots think in."""
ORDERS = ("speed", "acceleration", "jerk")


def limit(default: Any, unit: str, scale: float) -> Any:
    """Declare one limit: its default [SI], the unit of the file and its size in SI."""
    text = "every limit must be positive"
    return field(
        default=default,
        metadata={"unit": unit, "scale": scale, "length": 6, "low": LEAST, "high": LARGEST, "text": text},
    )


@dataclass(frozen=True)
class SmoothingLimits:
    """Largest speed, acceleration and jerk of tool tip, tool axis and joints; all positive, infinity allowed.

    Tip limits are Euclidean norms of its time derivatives; axis limits those of the axis' angular velocity
    without spin, o x o', and of its first and second derivative. The tool's defaults are those of paper 4's
    trial.
    """

    tip_speed: float = limit(50.0 * MM, "mm_s", MM)  #: [m/s]
    tip_acceleration: float = limit(500.0 * MM, "mm_s2", MM)  #: [m/s^2]
    tip_jerk: float = limit(10000.0 * MM, "mm_s3", MM)  #: [m/s^3]
    axis_speed: float = limit(10.0 * DEG, "deg_s", DEG)  #: [rad/s]
    axis_acceleration: float = limit(100.0 * DEG, "deg_s2", DEG)  #: [rad/s^2]
    axis_jerk: float = limit(2000.0 * DEG, "deg_s3", DEG)  #: [rad/s^3]
    joint_speed: tuple[float, ...] = limit(six(JOINT_SPEED), "deg_s", DEG)  #: Six values [rad/s]
    #: Six values [rad/s^2]
    joint_acceleration: tuple[float, ...] = limit(six(JOINT_ACCELERATION), "deg_s2", DEG)
    joint_jerk: tuple[float, ...] = limit(six(JOINT_JERK), "deg_s3", DEG)  #: Six values [rad/s^3]

    def __post_init__(self) -> None:
        for spec in fields(self):
            value, usual = np.array(getattr(self, spec.name)), np.array(spec.default)
            if value.shape != usual.shape or not (value > 0.0).all():
                raise ConfigError(
                    f"limit {spec.name} is {value}: give one above zero, of the joints six, base to flange."
                )

    @cached_property
    def table(self) -> Array:
        """Speed, acceleration and jerk of tip, axis and six joints, shape (3, 8)."""
        return np.array(
            [np.hstack([getattr(self, f"{part}_{order}") for part in SECTIONS]) for order in ORDERS]
        )


KEYS = {f"{spec.name.replace('_', '.', 1)}_{spec.metadata['unit']}": spec for spec in fields(SmoothingLimits)}
"""Keys of the TOML file, as ``tip.speed_mm_s``, with the fields they set."""


def load_limits(path: Path, base: SmoothingLimits | None = None) -> SmoothingLimits:
    """Read limits: sections [tip], [axis], [joint] with the keys of `KEYS`; what is left out is that of
    ``base`` or the default. Of joints a limit is one number or six.

    Raises:
        PolishSimError: The file cannot be read, or a key is unknown, of the wrong type, zero or negative.
    """
    table = read_toml(path, "limits file", ConfigError)
    changes: dict[str, Any] = {}
    with named_place(f"'{path}'"):
        for name, value in leaves(table):
            check_name("limit", name, KEYS)
            spec = KEYS[name]
            scale, many = spec.metadata["scale"], isinstance(spec.default, tuple)
            given = six(value) if many and is_number(value) else value
            found = checked_value(name, given, spec.default, spec)
            changes[spec.name] = tuple(scale * each for each in found) if many else scale * found
    return replace(base or SmoothingLimits(), **changes)


def limits_toml(limits: SmoothingLimits) -> str:
    """Limits as the text of a file that `load_limits` reads."""
    table: dict[str, dict[str, Array]] = {section: {} for section in SECTIONS}
    for name, spec in KEYS.items():
        section, _, key = name.partition(".")
        table[section][key] = np.round(np.array(getattr(limits, spec.name)) / spec.metadata["scale"], 9)
    return toml_text(table)


class Arm(NamedTuple):
    """The arm in use with a tool before a part."""

    T_base_work: Array  #: Pose of the frame the chain is given in, shape (4, 4)
    T_flange_tool: Array  #: The tool on the flange, shape (4, 4)
    #: Joint angles at or near the first way point, which say the arm's configuration [rad], shape (6,)
    q_start: Array
