"""Every error a user can cause or meet, each saying what is wrong, where, and what to do (layer 0)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import SupportsFloat


class PolishSimError(Exception):
    """Base of all errors the command line turns into one message and an exit code."""

    exit_code = 2


class InputError(PolishSimError):
    """A file, an argument or a folder that cannot be used as given."""


class ConfigError(PolishSimError):
    """A scenario that cannot be run: an unknown key, a wrong type or a value outside its physical limits."""


class MeshError(PolishSimError):
    """A part's mesh that cannot be read or is not a surface one could polish."""


class PlanError(PolishSimError):
    """A part and a plan request that do not fit each other."""


class ReachError(PolishSimError):
    """A path the robot cannot follow; names the first bad point."""


class SmoothingError(PolishSimError):
    """Way points or limits no smooth motion can be made of; names the place."""


class CalibrationError(PolishSimError):
    """Poses or readings that cannot tell what is to be calibrated; says what is missing."""


class IdentificationError(PolishSimError):
    """A motion or a log that cannot tell a robot's dynamics; names what stays unknown."""


class ProtectiveStop(PolishSimError):
    """The simulated robot stopped itself; what was recorded up to then is kept."""

    exit_code = 3


def unknown_name(kind: str, name: str, known: Iterable[str]) -> InputError:
    """Build the error for a name that is not in a list of known ones.

    Args:
        kind: What the name stands for, e.g. ``"controller"``.
        name: What was given.
        known: The valid names.

    Returns:
        The error, listing the valid names.
    """
    return InputError(f"unknown {kind} '{name}'. Known: {', '.join(sorted(known))}.")


def place_in_mm(point: Iterable[SupportsFloat]) -> str:
    """Write a point [m] as messages give places and options take them: ``(12.5, 0, -3.14) mm``."""
    # Adding zero turns -0.0 into 0.0.
    return "(" + ", ".join(f"{round(1e3 * float(value), 2) + 0.0:.12g}" for value in point) + ") mm"
