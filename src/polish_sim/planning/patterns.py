"""The patterns a region can be covered with; adding one is a file and a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from polish_sim.planning.raster import plan_raster
from polish_sim.planning.request import PatternRequest
from polish_sim.planning.run import SurfaceRun
from polish_sim.planning.spiral import plan_spiral

Pattern = Callable[[PatternRequest], list[SurfaceRun]]
"""Maps a request to runs on the surface, one lift after each."""

PATTERNS: Final[Mapping[str, Pattern]] = {"spiral": plan_spiral, "raster": plan_raster}
