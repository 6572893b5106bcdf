"""Whether region, step-over and pad fit each other (errors before planning, notes after it)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import PadConfig, PlanConfig
from polish_sim.errors import PlanError
from polish_sim.geometry import Region
from polish_sim.planning.located import PathOnSurface
from polish_sim.planning.offset_curve import nearest_of
from polish_sim.planning.planner import Ground
from polish_sim.planning.turns import border_curves

Array = NDArray[np.float64]

NARROWEST = 0.5
"""A region narrower than this share of the pad's diameter cannot carry it."""


def check_request(region: Region, plan: PlanConfig, pad: PadConfig) -> None:
    """Refuse what cannot be polished sensibly.

    Raises:
        PlanError: The region is narrower than the pad, or the step-over wider than the pad or the region.
    """
    width = footprint_width(region)
    diameter = 2.0 * pad.radius_m
    if width < NARROWEST * diameter:
        raise PlanError(
            f"the region is narrower than the pad: {width * 1e3:.3g} mm across, the pad {diameter * 1e3:.3g} mm. "
            f"Set a smaller pad (--pad-diameter {width * 1e3:.2g}) or choose another --region."
        )
    if plan.stepover_m > diameter:
        raise PlanError(
            f"a step-over of {plan.stepover_m * 1e3:.4g} mm would leave stripes: the pad measures "
            f"{diameter * 1e3:.4g} mm. Set a step-over below that; a sixth of it is usual."
        )


def footprint_width(region: Region) -> float:
    """Smallest width of the region seen from above, over all directions [m]."""
    first = np.cross(region.up, np.eye(3)[int(np.abs(region.up).argmin())])
    first /= np.linalg.norm(first)
    second = np.cross(region.up, first)
    angle = np.linspace(0.0, np.pi, 180, endpoint=False)
    directions = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    return float(np.ptp(region.surface.vertices @ directions.T, axis=0).min())


def pad_notes(ground: Ground, on: PathOnSurface, pad: PadConfig) -> list[str]:
    """What the user should know about this pad on this region, with places in mm.

    Args:
        ground: The region.
        on: The path on it.
        pad: The pad.

    Returns:
        Notes; empty if all is well.
    """
    notes = []
    if ground.holes:
        notes.append(f"{ground.holes} small holes are run over by the pad (plan.bridge_m sets up to which size)")
    borders = border_curves(ground.mesh)
    depth = nearest_of(borders, ground.mesh.vertices).nearest.distances
    if depth.max() < pad.radius_m:
        notes.append(
            f"the region is at most {2e3 * depth.max():.3g} mm wide between its borders: "
            f"the pad ({2e3 * pad.radius_m:.3g} mm) hangs over"
        )
    hollow = on.curvatures[:, 1]
    worst = int(hollow.argmin())
    if hollow[worst] * pad.radius_m < -1.0:
        place = ", ".join(f"{value * 1e3:.1f}" for value in on.positions[worst])
        notes.append(
            f"hollow of {-1e3 / hollow[worst]:.3g} mm radius at ({place}) mm, tighter than the pad "
            f"({1e3 * pad.radius_m:.3g} mm): the pad touches with its edge there"
        )
    return notes
