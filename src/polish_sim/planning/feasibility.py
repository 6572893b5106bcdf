"""Whether a request can be met, and region, step-over and pad fit (errors before planning, notes after
it)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from polish_sim.arrays import longest_side
from polish_sim.errors import PlanError, check_name, place_in_mm
from polish_sim.geometry import PartMesh, Region, Surface, merge_regions
from polish_sim.geometry.mesh import LARGEST_PART, METRES_PER_UNIT, metres_per_unit
from polish_sim.geometry.mesh_file import STEP_ENDINGS
from polish_sim.geometry.regions.choice import nearest_on
from polish_sim.geometry.regions.region import check_part_words
from polish_sim.planning.curve import CurveSet
from polish_sim.planning.ground import Ground, footprint
from polish_sim.planning.moves.leads import LEADS
from polish_sim.planning.patterns import PATTERNS
from polish_sim.planning.quality.access import AVOID, TILT, Access
from polish_sim.planning.turns import border_curves

if TYPE_CHECKING:
    from polish_sim.config import PadConfig, PartConfig, PlanConfig
    from polish_sim.planning.toolpath import ToolPath

ORDERS = ("inward", "outward")
DIRECTIONS = ("climb", "conventional")

NARROWEST = 0.5
"""A region narrower than this share of the pad's diameter, seen from above, cannot carry it; a wider one is
planned, with a note where the pad hangs over."""

FAR_START = 2.0  #: A path that begins more than this many step-overs from there is noted

FEW = 20  #: One vertex in this many is measured against the border


def check_asked(part: PartConfig, plan: PlanConfig, pad: PadConfig) -> None:
    """Refuse a request no part could meet, before anything is loaded.

    Raises:
        InputError: An unknown name.
        PlanError: A step-over wider than the pad.
    """
    check_part_words(part, plan)
    check_plan_words(plan)
    check_stepover(plan, pad)


def check_plan_words(plan: PlanConfig) -> None:
    """Refuse unknown names of the plan.

    Raises:
        InputError: Unknown pattern, lead-in, order or direction.
    """
    for kind, name, known in (
        ("pattern", plan.pattern, PATTERNS),
        ("lead-in", plan.lead_in, LEADS),
        ("order", plan.order, ORDERS),
        ("direction", plan.direction, DIRECTIONS),
        ("way to avoid walls", plan.avoid, AVOID),
    ):
        check_name(kind, name, known)


def check_stepover(plan: PlanConfig, pad: PadConfig) -> None:
    """Refuse a step-over wider than the pad with a PlanError."""
    diameter = 2.0 * pad.radius_m
    if plan.stepover_m > diameter:
        raise PlanError(
            f"a step-over of {plan.stepover_m * 1e3:.4g} mm would leave stripes: the pad measures "
            f"{diameter * 1e3:.4g} mm. Set a step-over below that; a sixth of it is usual."
        )


def widest_piece(region: Region) -> float:
    """Least width of the region, seen from above, of its widest component [m]."""
    return max(footprint(component).widths.min() for component in region.components())


def check_request(region: Region, pad: PadConfig, mesh: PartMesh) -> Region:
    """Refuse what cannot be polished sensibly, leave out components too narrow for the pad.

    Raises:
        PlanError: All of the region is narrower than half the pad; names the units in which it would not be.
    """
    width, diameter, components = widest_piece(region), 2.0 * pad.radius_m, region.components()
    least = NARROWEST * diameter
    if width < least:
        raise PlanError(
            f"the region is narrower than half the pad: {width * 1e3:.3g} mm across, the pad "
            f"{diameter * 1e3:.3g} mm. "
            f"Set a smaller pad (--pad-diameter {width * 1e3:.2g}) or choose another --region."
            f"{in_another_unit(mesh, width, least)}"
        )
    wide = [part for part in components if footprint(part).widths.min() >= least]
    return region if len(wide) == len(components) else merge_regions(wide, region.up, region.notes)


def edge_distance(pad: PadConfig, force: float) -> float:
    """How far the middle of a pad has to keep from two edges at a right angle so that it does not sink off
    them [m].

    The pad sinks in until its area on the part carries the ``force`` [N]; what is as near to an edge as the
    pad is deep is pushed aside. Lengths in pad radii r: some depth t has to carry F / (k r) <= t S(e - t),
    with S(u) the share of a disc that is on the part, its middle u within both edges. The default pad under
    20 N: 0.12 r, 3 mm.
    """
    x, y = np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 201)])
    beyond = np.sort(np.minimum(x, y)[np.hypot(x, y) <= 1.0])
    sunk = force / (pad.stiffness_n_m * pad.radius_m)
    depths = np.linspace(0.0, 1.0 + 2.0 * sunk, 301)
    away = np.linspace(0.0, 1.0 + sunk, 201)
    shares = 1.0 - np.searchsorted(beyond, depths - away[:, None]) / len(beyond)
    carried = (depths * shares).max(axis=1)
    return pad.radius_m * (away[np.argmax(carried >= sunk)] if carried[-1] >= sunk else away[-1])


def too_small(mesh: PartMesh, width: float, pad: PadConfig, force: float) -> PlanError:
    """The error for a region this wide [m] on which a pad would sink off the edges."""
    return PlanError(
        f"the region, {1e3 * width:.3g} mm wide, is too small for {force:.3g} N: a pad of "
        f"{2e3 * pad.radius_m:.3g} mm would sink off an edge nearer than "
        f"{1e3 * edge_distance(pad, force):.2g} mm to its middle. Set a smaller "
        f"--contact-force.{in_another_unit(mesh, width, 4.0 * edge_distance(pad, force))}"
    )


def in_another_unit(mesh: PartMesh, width: float, wanted: float) -> str:
    """The units in which a region would be wide enough [m], and the part's size in them; empty if it is, or
    none is."""
    if width >= wanted or mesh.path.suffix.lower() in STEP_ENDINGS:
        return ""
    size = longest_side(mesh.vertices)
    scales = {unit: scale / metres_per_unit(mesh.unit) for unit, scale in METRES_PER_UNIT.items()}
    fitting = [
        f"--units {unit} makes it {size * scale * 1e3:.4g} mm"
        for unit, scale in scales.items()
        if width * scale >= wanted and size * scale <= LARGEST_PART
    ]
    if not fitting:
        return ""
    read = f"Read in {mesh.unit} the part measures {size * 1e3:.4g} mm"
    return f" Or was it drawn in another unit? {read}; {', '.join(fitting)}."


def check_start(part: Surface, plan: PlanConfig) -> None:
    """Refuse a start far off the part.

    Raises:
        PlanError: It is further off than a tenth of the part's size; names the nearest point.
    """
    if plan.start:
        nearest_on(part, np.array(plan.start), f"start {place_in_mm(plan.start)}")


def start_notes(path: ToolPath, plan: PlanConfig) -> list[str]:
    """Where the path begins if that is not within two step-overs of the start asked for."""
    if not plan.start:
        return []
    begin = path.in_contact.positions[0]
    distance = np.linalg.norm(begin - plan.start)
    if distance <= FAR_START * plan.stepover_m:
        return []
    why = "; an outward path begins in the middle" if plan.order == "outward" else ""
    return [f"the path begins at {place_in_mm(begin)}, {distance * 1e3:.3g} mm from the start asked for{why}"]


def width_between_borders(ground: Ground) -> float:
    """How wide a region is between its borders in the mean: places on a strip are a quarter of that off them
    [m]."""
    mesh = ground.mesh
    some = slice(None, None, FEW if len(ground.mesh.vertices) > 100 * FEW else 1)
    distances = CurveSet(border_curves(mesh)).nearest(mesh.vertices[some]).distances
    return 4.0 * np.average(distances, weights=mesh.vertex_areas[some])


def lean_notes(access: Access | None, plan: PlanConfig, pad: PadConfig) -> list[str]:
    """What leaning the tool gains, if that was asked for."""
    if access is None or plan.avoid != TILT:
        return []
    if access.leaning is None:
        return [
            f"leaning the tool (--avoid tilt) lets a pad of {2e3 * pad.radius_m:.3g} mm touch no more: it "
            "stands upright"
        ]
    return [
        f"{1e4 * access.gained_m2:.3g} cm^2 more are reached because the tool leans {access.leaning.note}"
    ]
