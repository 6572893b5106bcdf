"""The arms by their tables: everything the code knows of one make and not of another.

The tables are in arms.toml, sources of every number in models/README.md. A further arm of this build (three
parallel axes, a wrist whose axes do not meet) is a table there; docs/new_arm.md says what it needs.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

Six = tuple[float, float, float, float, float, float]


class ArmLink(NamedTuple):
    """A link in its own Denavit-Hartenberg frame, and the capsule it is drawn and collides as."""

    mass: float  #: [kg]
    center: tuple[float, float, float]  #: Of mass [m]
    inertia: Six  #: About it: xx, yy, zz, xy, xz, yz [kg m^2]
    capsule: Six  #: From, to [m]
    radius: float  #: Of the capsule [m]


class ArmTable(NamedTuple):
    """One make of arm."""

    label: str
    type_number: int  #: As the robot's controller reports it
    d: Six  #: Offsets along the joints' axes [m]
    a: Six  #: Lengths of the links [m]
    speed: Six  #: Largest of each joint [rad/s]
    torque: Six  #: Largest of each joint [N m]
    torque_constants: Six  #: Torque behind the gear by the motor's current [N m/A]
    stiff: Six  #: Servos' gains by angle [N m/rad]
    damped: Six  #: and by speed [N m s/rad]
    links: tuple[ArmLink, ...] = ()  #: Of joints 1 to 6; empty: those of the model file
    #: Keys of [robot.real] that differ from the defaults
    gears: Mapping[str, tuple[float, ...]] = {}


def _fixed(value: Any) -> Any:
    """Tuples for lists, within tables and lists too."""
    if isinstance(value, dict):
        return {name: _fixed(entry) for name, entry in value.items()}
    return tuple(map(_fixed, value)) if isinstance(value, list) else value


def _arm(links: Sequence[Any] = (), **fields: Any) -> ArmTable:
    return ArmTable(links=tuple(ArmLink(**link) for link in links), **fields)


_TABLES = tomllib.loads(Path(__file__).with_name("arms.toml").read_text(encoding="utf-8"))
ARMS: Mapping[str, ArmTable] = {name: _arm(**table) for name, table in _fixed(_TABLES).items()}
"""By the word of ``robot.arm``; the model file draws the first."""
IDEAL = "ideal"  #: The first one with rigid gears, exact encoders and an exact table
FIRST = next(iter(ARMS))


def arm_table(name: str) -> ArmTable:
    """The arm that a word of ``robot.arm`` names; `take_arm` refuses unknown words."""
    return ARMS.get(name, ARMS[FIRST])
