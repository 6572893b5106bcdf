"""The patterns a region can be covered with; adding one is a file and a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

from polish_sim.lazy import FunctionOnUse

if TYPE_CHECKING:
    from polish_sim.planning.patterns.run import PatternRequest, SurfaceRun


class Pattern(NamedTuple):
    """A way to cover a region, and what the planner may do with its runs."""

    #: Maps a request to runs on the surface, one lift after each
    plan: Callable[[PatternRequest], list[SurfaceRun]]
    #: Which of order, direction, start and raster_direction of `PlanConfig` it obeys
    listens: tuple[str, ...] = ()
    #: Whether each of its runs must be walked the way it is; the first given stays the first
    one_way: bool = True


def _runs(pattern: str) -> Callable[[PatternRequest], list[SurfaceRun]]:
    return FunctionOnUse(f"polish_sim.planning.patterns.{pattern}", f"{pattern}_runs")


PATTERNS: Mapping[str, Pattern] = {
    "spiral": Pattern(_runs("spiral"), listens=("order", "direction", "start")),
    "raster": Pattern(_runs("raster"), listens=("start", "raster_direction"), one_way=False),
    "contour": Pattern(_runs("contour"), listens=("order", "direction", "start")),
    "fermat": Pattern(_runs("fermat"), listens=("start",)),
}
