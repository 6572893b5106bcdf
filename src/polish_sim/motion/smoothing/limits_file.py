"""Limits of tool and joints as a TOML file, in the units users of robots think in (layer 6)."""

from __future__ import annotations

import math
import tomllib
from dataclasses import Field, fields, replace
from pathlib import Path
from typing import Any

from polish_sim.errors import ConfigError
from polish_sim.motion.smoothing.limits import SmoothingLimits

SECTIONS = ("tip", "axis", "joint")


def load_limits(path: Path, base: SmoothingLimits | None = None) -> SmoothingLimits:
    """Read limits: sections [tip], [axis], [joint]; one left out keeps its defaults, one given must be whole.

    Args:
        path: The file, e.g. with ``[tip]`` and ``speed_mm_s = 50``, ``acceleration_mm_s2``, ``jerk_mm_s3``; [axis] and
            [joint] have ``speed_deg_s``, ``acceleration_deg_s2``, ``jerk_deg_s3``, of the joints one number or six.
        base: Limits of sections the file leaves out; the defaults if not given.

    Returns:
        The limits.

    Raises:
        ConfigError: The file cannot be read, or a key is unknown, missing, of the wrong type, zero or negative.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read the limits file '{path}': {error.strerror}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"'{path}' is not valid TOML: {error}.") from error
    return replace(base or SmoothingLimits(), **_changes(table, str(path)))


def limits_toml(limits: SmoothingLimits) -> str:
    """Write limits as the file `load_limits` reads."""
    lines: list[str] = []
    for section in SECTIONS:
        lines.append(f"[{section}]")
        for key, spec in _keys(section).items():
            value = getattr(limits, spec.name)
            scale = spec.metadata["scale"]
            listed = isinstance(value, tuple)
            text = "[" + ", ".join(f"{v / scale:.10g}" for v in value) + "]" if listed else f"{value / scale:.10g}"
            lines.append(f"{key} = {text}")
        lines.append("")
    return "\n".join(lines)


def _keys(section: str) -> dict[str, Field[Any]]:
    """Keys of a section with the fields they set: ``speed_mm_s`` -> tip_speed."""
    own = [spec for spec in fields(SmoothingLimits) if spec.name.startswith(f"{section}_")]
    return {f"{spec.name.removeprefix(f'{section}_')}_{spec.metadata['unit']}": spec for spec in own}


def _changes(table: dict[str, Any], place: str) -> dict[str, Any]:
    changes: dict[str, Any] = {}
    for section, values in table.items():
        if section not in SECTIONS or not isinstance(values, dict):
            raise ConfigError(f"'{section}' in '{place}' is no section of limits. Known: [tip], [axis], [joint].")
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
        raise ConfigError(f"'{where}' in '{place}' must be one number or six, one a joint; got {len(listed)}.")
    return tuple(_positive(where, v, place) * scale for v in listed)


def _positive(where: str, value: Any, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < math.inf:
        raise ConfigError(f"'{where}' in '{place}' must be a finite, positive number, got {value!r}.")
    return float(value)
