"""Section [plan] of the scenario (layer 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from polish_sim.config.key import key

MOST_LEAN_RAD = math.radians(40.0)
"""Further over the pad touches with its edge only."""


@dataclass(frozen=True)
class PlanConfig:
    """How the tool path covers the region."""

    file: str = key("", "a finished path to run: plan folder, path.json, CSV or APT file; empty = plan anew")
    pattern: str = key("spiral", "spiral, raster, contour or fermat")
    region: str = key(
        "auto",
        "auto, top, all, point:X,Y,Z, box:X0,Y0,Z0,X1,Y1,Z1, polygon:X,Y,Z;X,Y,Z;..., polygon:FILE or faces:FILE (mm)",
    )
    feature_angle_rad: float = key(
        math.radians(30.0),
        "edges that bend by more than this bound a smooth face [rad]",
        math.radians(1.0),
        math.radians(175.0),
    )
    edge_margin_m: float = key(0.0, "how far the region keeps from its edges, along the surface [m]", 0.0, 0.5)
    stepover_m: float = key(0.008, "distance between neighbouring turns [m]", 0.0002, 1.0)
    bridge_m: float = key(0.02, "holes up to this diameter are run over by the pad [m]", 0.0, 0.5)
    order: str = key("inward", "spiral, contour: inward or outward")
    direction: str = key("conventional", "spiral, contour: conventional (what is not done yet on the left) or climb")
    start: tuple[float, ...] = key(
        (),
        "the path begins as near this point as pattern and order allow: x, y, z in the work frame [m]; empty = chosen",
        length=3,
    )
    raster_direction: tuple[float, ...] = key(
        (), "direction of the raster's lines: x, y, z in the work frame; empty = along the region's long axis", length=3
    )
    clearance_m: float = key(0.03, "height of the first and last point above the part [m]", 0.001, 0.5)
    lead_in: str = key("normal", "how the tool lands: normal, tangent or arc")
    lead_angle_rad: float = key(
        0.0, "the tool leans this far forward, along the feed [rad]", -MOST_LEAN_RAD, MOST_LEAN_RAD
    )
    tilt_angle_rad: float = key(
        0.0, "the tool leans this far to the left of the feed [rad]", -MOST_LEAN_RAD, MOST_LEAN_RAD
    )
    axis_smoothing_m: float = key(0.0, "the tool axis is averaged over this length of the path, 0 = not [m]", 0.0, 1.0)
    axis_deviation_rad: float = key(
        math.radians(5.0), "averaging turns the tool axis by no more than this [rad]", 0.0, MOST_LEAN_RAD
    )
