"""Options that stand together in several commands, as dataclasses, and how a command takes a whole group of them."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

from polish_sim.cli import option_types as o

T = TypeVar("T")

_KIND = inspect.Parameter.KEYWORD_ONLY  # all are: options may stand in any order


@dataclass(frozen=True)
class RegionOptions:
    """How a part's file is read, and which region of it is meant."""

    units: o.Units = None
    up: o.Up = None
    region: o.Region = None
    feature_angle: o.FeatureAngle = None
    edge_margin: o.EdgeMargin = None


@dataclass(frozen=True)
class PatternOptions:
    """How a path is planned over the region, how the tool lands on it and leans."""

    pattern: o.Pattern = None
    stepover: o.Stepover = None
    overlap: o.Overlap = None
    order: o.Order = None
    direction: o.Direction = None
    start: o.Start = None
    raster_direction: o.RasterDirection = None
    lead_in: o.LeadIn = None
    lead_angle: o.LeadAngle = None
    tilt_angle: o.TiltAngle = None
    axis_smoothing: o.AxisSmoothing = None
    axis_deviation: o.AxisDeviation = None


@dataclass(frozen=True)
class ToolOptions:
    """Pad, force and feed."""

    pad_diameter: o.PadDiameter = None
    contact_force: o.ContactForce = None
    feed: o.Feed = None


@dataclass(frozen=True)
class MasterOptions:
    """How the master of two robots moves the part."""

    master_speed: o.MasterSpeed = None
    master_turn: o.MasterTurn = None
    master_path: o.MasterPath = None


@dataclass(frozen=True)
class ConfigOptions:
    """Keys of the scenario that have no option of their own."""

    config: o.Config = None
    set_: o.Set = None


@dataclass(frozen=True)
class OutputOptions:
    """Where the results go."""

    out: o.Out = None
    overwrite: o.Overwrite = False


def takes_groups(command: Callable[..., T]) -> Callable[..., T]:
    """Let a command take groups of options: what is a dataclass in its signature is that class's fields to the user.

    Args:
        command: A function of options and of groups of them; no two of the names are the same.

    Returns:
        The same command as Typer reads it, one parameter an option, in the order they are declared.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
    flat: list[inspect.Parameter] = []
    for parameter in inspect.signature(command).parameters.values():
        if parameter.name in groups:
            flat += _options_of(groups[parameter.name])
        else:
            flat.append(parameter.replace(kind=_KIND, annotation=hints[parameter.name]))

    @functools.wraps(command)
    def flattened(**given: Any) -> T:
        for name, kind in groups.items():
            own = {f.name for f in fields(kind)} & given.keys()
            given[name] = kind(**{option: given.pop(option) for option in own})
        return command(**given)

    flattened.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    flattened.__annotations__ = {parameter.name: parameter.annotation for parameter in flat}
    return flattened


def _options_of(group: type) -> list[inspect.Parameter]:
    """The fields of a group, each of which has a default."""
    hints = get_type_hints(group, include_extras=True)
    return [inspect.Parameter(f.name, _KIND, default=f.default, annotation=hints[f.name]) for f in fields(group)]
