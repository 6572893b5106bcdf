"""The patterns a region can be covered with; adding one is a file and a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from polish_sim.planning.patterns.contour import contour_runs
from polish_sim.planning.patterns.fermat import fermat_runs
from polish_sim.planning.patterns.raster import raster_runs
from polish_sim.planning.patterns.run import PatternRequest, SurfaceRun
from polish_sim.planning.patterns.spiral import spiral_runs


class Pattern(NamedTuple):
    """A way to cover a region, and what the planner may do with its runs."""

    plan: Callable[[PatternRequest], list[SurfaceRun]]
    """Maps a request to runs on the surface, one lift after each."""
    listens: tuple[str, ...] = ()
    """The keys of `PlanConfig` it obeys among order, direction, start and raster_direction; others change nothing."""
    one_way: bool = True
    """Whether each of its runs must be walked the way it is; the first given stays the first."""


PATTERNS: Final[Mapping[str, Pattern]] = {
    "spiral": Pattern(spiral_runs, listens=("order", "direction", "start")),
    "raster": Pattern(raster_runs, listens=("start", "raster_direction"), one_way=False),
    "contour": Pattern(contour_runs, listens=("order", "direction", "start")),
    "fermat": Pattern(fermat_runs, listens=("start",)),
}
