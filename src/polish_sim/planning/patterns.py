"""The patterns a region can be covered with; adding one is a file and a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from polish_sim.geometry import Region
from polish_sim.planning.raster import plan_raster
from polish_sim.planning.run import SurfaceRun
from polish_sim.planning.spiral import plan_spiral
from polish_sim.planning.triangulation import Triangulation

Report = Callable[[float], None]
Pattern = Callable[[Region, Triangulation, float, Report], list[SurfaceRun]]
"""Maps region, fine triangulation, step-over [m] and a progress callback to runs on the surface."""

PATTERNS: Final[Mapping[str, Pattern]] = {"spiral": plan_spiral, "raster": plan_raster}
