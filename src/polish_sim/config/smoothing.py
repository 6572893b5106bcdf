"""Section [smoothing] of the scenario (layer 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class SmoothingConfig:
    """How way points become a motion."""

    rule: str = key(
        "spline",
        "surface: spline, certified, joint-jerk, joint-acceleration, or none: at the feed whatever it takes; "
        "smooth plays the three in the middle",
    )
    tolerance_m: float = key(1e-4, "how far the tool may be from the path, 0 = exact (not with spline) [m]", 0.0, 0.01)
    axis_tolerance_rad: float = key(
        math.radians(0.2), "how far the tool axis may be from its way, 0 = exact (not with spline) [rad]", 0.0, 0.2
    )
    limits_file: str = key("", "TOML file of limits, see 'smooth --limits'; empty = the experiment's own")
