"""A path as its file has it, and what to do about words nobody knows (readers -> commands)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from polish_sim.errors import InputError
from polish_sim.exchange.checks import Place
from polish_sim.planning.toolpath import ToolPath

Unknown = Callable[[InputError], None]
"""Told of what a reader does not know and could leave out; raises it, or notes it and lets the reader go on."""


class WayPoints(NamedTuple):
    """A path read from a file: points may repeat, and the tool may turn where it stands."""

    path: ToolPath
    """The points; arc length does not fall, but may stay."""
    file: Path
    place: Place
    """Where in the file a point stands."""
    assumed: str = ""
    """What the file does not say and is taken for granted, as a sentence; empty if nothing."""


def refuse_unknown(error: InputError) -> None:
    """Refuse what is unknown.

    Raises:
        InputError: Always.
    """
    raise error
