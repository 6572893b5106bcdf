"""How fast tool and joints may move: data with its origin."""

from __future__ import annotations

import math
from dataclasses import Field, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import ConfigError
from polish_sim.toml_text import read_toml, toml_text

MM, DEG = 1e-3, math.radians(1.0)
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


def limit(default: float, unit: str, scale: float) -> Any:
    """Declare one limit: its default in the user's unit, that unit, and its size in SI."""
    return field(default=default * scale, metadata={"unit": unit, "scale": scale})


def joint_limit(default: float, unit: str) -> Any:
    """Declare one limit of six joints: its default [rad/s..] and the user's unit."""
    return field(default=six(default), metadata={"unit": unit, "scale": math.radians(1.0)})


@dataclass(frozen=True)
class SmoothingLimits:
    """Largest speed, acceleration and jerk of tool tip, tool axis and joints; all positive, infinity allowed.

    Tip limits are Euclidean norms of its time derivatives; axis limits those of the axis' angular velocity
    without spin, o x o', and of its first and second derivative. The tool's defaults are those of paper 4's
    trial.
    """

    tip_speed: float = limit(50.0, "mm_s", MM)  #: [m/s]
    tip_acceleration: float = limit(500.0, "mm_s2", MM)  #: [m/s^2]
    tip_jerk: float = limit(10000.0, "mm_s3", MM)  #: [m/s^3]
    axis_speed: float = limit(10.0, "deg_s", DEG)  #: [rad/s]
    axis_acceleration: float = limit(100.0, "deg_s2", DEG)  #: [rad/s^2]
    axis_jerk: float = limit(2000.0, "deg_s3", DEG)  #: [rad/s^3]
    joint_speed: tuple[float, ...] = joint_limit(JOINT_SPEED, "deg_s")  #: Six values [rad/s]
    joint_acceleration: tuple[float, ...] = joint_limit(JOINT_ACCELERATION, "deg_s2")  #: Six values [rad/s^2]
    joint_jerk: tuple[float, ...] = joint_limit(JOINT_JERK, "deg_s3")  #: Six values [rad/s^3]

    def __post_init__(self) -> None:
        for spec in fields(self):
            value = getattr(self, spec.name)
            values = value if isinstance(spec.default, tuple) else (value,)
            if isinstance(spec.default, tuple) and len(values) != 6:
                raise ConfigError(
                    f"limit {spec.name} has {len(values)} values: it needs six, one a joint from base to "
                    "flange."
                )
            for j, each in enumerate(values):
                if not each > 0.0:
                    joint = f" of joint {j + 1}" if len(values) > 1 else ""
                    raise ConfigError(f"limit {spec.name}{joint} is {each:g}: every limit must be positive.")

    @cached_property
    def table(self) -> Array:
        """Speed, acceleration and jerk of tip, axis and six joints, shape (3, 8)."""
        return np.array(
            [np.hstack([getattr(self, f"{part}_{order}") for part in SECTIONS]) for order in ORDERS]
        )


def load_limits(path: Path, base: SmoothingLimits | None = None) -> SmoothingLimits:
    """Read limits: sections [tip], [axis], [joint]; one left out keeps those of ``base`` or the defaults.

    A section given must be whole: [tip] has ``speed_mm_s``, ``acceleration_mm_s2`` and ``jerk_mm_s3``; [axis]
    and [joint] have ``speed_deg_s``, ``acceleration_deg_s2``, ``jerk_deg_s3``, of the joints one number or
    six.

    Raises:
        ConfigError: The file cannot be read, or a key is unknown, missing, of the wrong type, zero or
            negative.
    """
    table = read_toml(path, "limits file", ConfigError)
    return replace(base or SmoothingLimits(), **_changes(table, str(path)))


def limits_toml(limits: SmoothingLimits) -> str:
    """Limits as the text of a file that `load_limits` reads."""
    return toml_text({section: {
        key: np.round(np.array(getattr(limits, spec.name)) / spec.metadata["scale"], 9)
        for key, spec in _keys(section).items()
    } for section in SECTIONS})  # fmt: skip


def _keys(section: str) -> dict[str, Field[Any]]:
    """Keys of a section with the fields they set: ``speed_mm_s`` -> tip_speed."""
    own = [spec for spec in fields(SmoothingLimits) if spec.name.startswith(f"{section}_")]
    return {f"{spec.name.removeprefix(f'{section}_')}_{spec.metadata['unit']}": spec for spec in own}


def _changes(table: dict[str, Any], place: str) -> dict[str, Any]:
    changes: dict[str, Any] = {}
    for section, values in table.items():
        if section not in SECTIONS or not isinstance(values, dict):
            raise ConfigError(
                f"'{section}' in '{place}' is no section of limits. Known: [tip], [axis], [joint]."
            )
        keys = _keys(section)
        for name in values:
            if name not in keys:
                raise ConfigError(f"unknown key '{section}.{name}' in '{place}'. Known: {', '.join(keys)}.")
        for name, spec in keys.items():
            if name not in values:
                raise ConfigError(f"'{section}.{name}' is missing in '{place}': a section must be whole.")
            changes[spec.name] = _si(f"{section}.{name}", values[name], spec, place)
    return changes


def _si(where: str, value: Any, spec: Field[Any], place: str) -> Any:
    scale = spec.metadata["scale"]
    if not isinstance(spec.default, tuple):
        return _positive(where, value, place) * scale
    listed = value if isinstance(value, list) else [value] * 6
    if len(listed) != 6:
        raise ConfigError(
            f"'{where}' in '{place}' must be one number or six, one a joint; got {len(listed)}."
        )
    return tuple(_positive(where, v, place) * scale for v in listed)


def _positive(where: str, value: Any, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < math.inf:
        raise ConfigError(f"'{where}' in '{place}' must be a finite, positive number, got {value!r}.")
    return float(value)


class Arm(NamedTuple):
    """The arm in use with a tool before a part."""

    T_base_work: Array  #: Pose of the frame the chain is given in, shape (4, 4)
    T_flange_tool: Array  #: The tool on the flange, shape (4, 4)
    #: Joint angles at or near the first way point, which say the arm's configuration [rad], shape (6,)
    q_start: Array
