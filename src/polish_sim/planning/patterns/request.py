"""What a pattern is asked to cover (region and plan -> pattern)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from polish_sim.config import PlanConfig
from polish_sim.geometry import Region
from polish_sim.planning.ground.triangulation import Triangulation

Report = Callable[[float], None]
"""Told the share of the work done, 0 to 1."""


class PatternRequest(NamedTuple):
    """A connected region and how it is to be covered."""

    region: Region
    """What to cover, in one piece; small holes are closed."""
    mesh: Triangulation
    """Its fine triangulation."""
    plan: PlanConfig
    """Step-over, order, direction, start and whatever else a pattern listens to."""
    report: Report
    """Called with the share done."""

    @property
    def stepover(self) -> float:
        """Distance between neighbouring turns [m]."""
        return self.plan.stepover_m
