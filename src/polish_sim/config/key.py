"""How a key of the scenario is declared: default, meaning, unit and range, and its option on the command
line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Any, NamedTuple

from polish_sim.errors import LARGEST


class Unit(NamedTuple):
    """A unit of the command line."""

    name: str
    si: float  #: What one of it is in SI, or in the unit of the key
    words: Mapping[str, float] = {}  #: Words that stand for a value [SI]


MM = Unit("mm", 1e-3)
DEG = Unit("deg", math.pi / 180.0)
MM_S = Unit("mm/s", 1e-3)
FEED = Unit("mm/s", 1e-3, {"auto": 0.01})  #: The feed to reach; a proof slows it where it has to
DEG_S = Unit("deg/s", math.pi / 180.0)
SECOND = Unit("s", 1.0)
NEWTON = Unit("N", 1.0)
PER_MINUTE = Unit("1/min", 1.0)
HERTZ_OR_FULL = Unit("Hz", 1.0, {"full": 0.0})
DIAMETER = Unit("mm", 0.5e-3)  #: A diameter in mm, where the key is a radius
DIRECTION = Unit("", 1.0)
POSE = (MM, MM, MM, DEG, DEG, DEG)
PANELS = (
    "Part and region",
    "Path",
    "Landing and tool axis",
    "Tool and process",
    "Hand guiding",
    "Two robots",
    "Sensor and poses",
    "Run",
    "Config",
    "Output",
)
"""Panels of the help, in their order."""
PART, PATH, AXIS, TOOL, HAND, PAIR, SENSOR, RUN, CONFIG, OUTPUT = PANELS


class Option(NamedTuple):
    """An option of the command line."""

    name: str
    panel: str
    metavar: str
    unit: Unit | tuple[Unit, ...] | None = None  #: What each number is written in; None for text and counts
    help: str = ""  #: Where the meaning of the key does not say enough
    repeat: bool = False  #: Whether it may be given several times; a text then


def key(
    default: Any,
    text: str,
    low: float = -LARGEST,
    high: float = LARGEST,
    length: int = 0,
    option: Option | None = None,
    presets: Mapping[str, Mapping[str, Any]] | None = None,
    words: tuple[str, ...] = (),
) -> Any:
    """Declare a field: default, meaning with the unit in brackets, range, length of a list, option on the
    command line; ``words`` or ``presets``: those it takes, of presets each with other keys of the section, or
    of sections in it, and values that it stands for."""
    metadata = {
        "text": text,
        "low": low,
        "high": high,
        "length": length,
        "option": option,
        "presets": presets or {word: {} for word in words},
    }
    return field(default=default, metadata=metadata)


def free_keys(text: str) -> Any:
    """Declare a section whose keys a user names: numbers, words and switches."""
    return field(default_factory=dict, hash=False, metadata={"text": text, "option": None, "presets": {}})
