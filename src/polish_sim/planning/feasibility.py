"""Whether region, step-over and pad fit each other (errors before planning, notes after it)."""

from __future__ import annotations

from polish_sim.config import PadConfig, PlanConfig
from polish_sim.errors import PlanError, place_in_mm
from polish_sim.geometry import Region, merge_regions
from polish_sim.planning.curves.offset_curve import CurveSet
from polish_sim.planning.curves.turns import border_curves
from polish_sim.planning.ground.footprint import footprint
from polish_sim.planning.ground.ground import Ground
from polish_sim.planning.quality.located import PathOnSurface

NARROWEST = 0.5
"""A region narrower than this share of the pad's diameter cannot carry it."""

FEW = 20
"""One vertex in so many is asked first how far it is from the border."""


def check_request(region: Region, plan: PlanConfig, pad: PadConfig) -> Region:
    """Refuse what cannot be polished sensibly, leave out components too narrow for the pad.

    Args:
        region: What is to be polished.
        plan: Step-over.
        pad: The pad.

    Returns:
        The region; with a note if components were left out.

    Raises:
        PlanError: The whole region is narrower than the pad, or the step-over wider than the pad.
    """
    components = region.components()
    widths = [float(footprint(component).widths.min()) for component in components]
    diameter = 2.0 * pad.radius_m
    if max(widths) < NARROWEST * diameter:
        width = max(widths)
        raise PlanError(
            f"the region is narrower than the pad: {width * 1e3:.3g} mm across, the pad {diameter * 1e3:.3g} mm. "
            f"Set a smaller pad (--pad-diameter {width * 1e3:.2g}) or choose another --region."
        )
    if plan.stepover_m > diameter:
        raise PlanError(
            f"a step-over of {plan.stepover_m * 1e3:.4g} mm would leave stripes: the pad measures "
            f"{diameter * 1e3:.4g} mm. Set a step-over below that; a sixth of it is usual."
        )
    wide = [part for part, width in zip(components, widths, strict=True) if width >= NARROWEST * diameter]
    if len(wide) == len(components):
        return region
    lost = region.area_m2 - sum(part.area_m2 for part in wide)
    note = (
        f"left out {len(components) - len(wide)} of {len(components)} components of the region, {lost * 1e6:.4g} mm^2 "
        f"in all: narrower than half the pad ({NARROWEST * diameter * 1e3:.3g} mm); a smaller --pad-diameter takes them"
    )
    return merge_regions(wide, region.up, (*region.notes, note))


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
        holes = "1 small hole is" if ground.holes == 1 else f"{ground.holes} small holes are"
        notes.append(f"{holes} run over by the pad (plan.bridge_m sets up to which size)")
    depth = _depth_below(ground, pad.radius_m)
    if depth is not None:
        notes.append(
            f"the region is at most {2e3 * depth:.3g} mm wide between its borders: "
            f"the pad ({2e3 * pad.radius_m:.3g} mm) hangs over"
        )
    hollow = on.curvatures[:, 1]
    worst = int(hollow.argmin())
    if hollow[worst] * pad.radius_m < -1.0:
        notes.append(
            f"hollow of {-1e3 / hollow[worst]:.3g} mm radius at {place_in_mm(on.positions[worst])}, tighter than the "
            f"pad ({1e3 * pad.radius_m:.3g} mm): the pad touches with its edge there"
        )
    return notes


def _depth_below(ground: Ground, limit: float) -> float | None:
    """How far the region's middle is from its borders if that is less than a limit [m]; None if it is not."""
    borders, points = CurveSet(border_curves(ground.mesh)), ground.mesh.vertices
    # A few places mostly do to tell that there is room.
    if borders.at_least(points[::FEW]).max() >= limit:
        return None
    depth = float(borders.nearest(points).nearest.distances.max())
    return depth if depth < limit else None
