"""What keeps the pad out of the walls beside a region (where it runs into them -> a note that says what to set)."""

from __future__ import annotations

import numpy as np

from polish_sim.config import PadConfig, PlanConfig
from polish_sim.planning.curves.offset_curve import CurveSet
from polish_sim.planning.curves.turns import border_curves
from polish_sim.planning.ground.ground import Ground
from polish_sim.planning.quality.figures import Quality
from polish_sim.planning.quality.pad_in_part import PadInPart, pad_in_part_warning

SPREAD = 0.1
"""Share of a step-over by which the outermost turn may come nearer to the border with another margin."""


def wall_notes(ground: Ground, quality: Quality, plan: PlanConfig, pad: PadConfig) -> list[str]:
    """Tell where the pad runs into the part along the path, and what would cure it.

    Args:
        ground: The region.
        quality: What was measured of the path.
        plan: Its edge margin.
        pad: The pad.

    Returns:
        A note; none if the pad keeps clear.
    """
    warning = pad_in_part_warning(quality.figures)
    if not warning:
        return []
    margin = _curing_margin(ground, quality.pad_in_part, plan, pad)
    if margin is None:
        return [f"{warning}: set a smaller --pad-diameter, or a --region further from what stands there"]
    return [f"{warning}: set --edge-margin {margin * 1e3:.4g} or a smaller --pad-diameter"]


def _curing_margin(ground: Ground, found: PadInPart, plan: PlanConfig, pad: PadConfig) -> float | None:
    """Edge margin, in whole mm, that takes the path far enough from walls at the region's borders [m].

    None where the pad runs into something away from the borders, or nothing of the region would be left.
    """
    borders = CurveSet(border_curves(ground.mesh))
    away = borders.nearest(found.positions).nearest.distances
    if away.max() > pad.radius_m:
        return None
    wanted = plan.edge_margin_m + float(found.reaches.max()) + SPREAD * plan.stepover_m
    margin = 1e-3 * float(np.ceil(1e3 * wanted - 1e-6))
    deepest = float(borders.nearest(ground.mesh.vertices).nearest.distances.max())
    return margin if margin - plan.edge_margin_m < deepest - 0.5 * plan.stepover_m else None
