"""Checks of a plan request before anything is loaded: known names, and a step-over that fits the pad."""

from __future__ import annotations

from typing import Final

from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.errors import PlanError, unknown_name
from polish_sim.geometry.mesh import check_unit
from polish_sim.geometry.orientation import check_up
from polish_sim.geometry.regions.region import check_choice
from polish_sim.models import part_path
from polish_sim.planning.moves.leads import LEADS
from polish_sim.planning.patterns import PATTERNS
from polish_sim.planning.quality.access import AVOID

ORDERS: Final = ("inward", "outward")
DIRECTIONS: Final = ("climb", "conventional")


def check_asked(part: PartConfig, plan: PlanConfig, pad: PadConfig) -> None:
    """Refuse a request no part could meet, before anything is loaded.

    Raises:
        InputError: An unknown name.
        PlanError: A step-over wider than the pad.
    """
    check_part_words(part, plan)
    check_plan_words(plan)
    check_stepover(plan, pad)


def check_part_words(part: PartConfig, plan: PlanConfig) -> None:
    """Refuse unknown names of part, unit, side and region before the part is loaded.

    Raises:
        InputError: Naming what is valid.
    """
    part_path(part.file)
    check_unit(part.unit)
    check_up(part.up)
    check_choice(plan.region)


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
        if name not in known:
            raise unknown_name(kind, name, known)


def check_stepover(plan: PlanConfig, pad: PadConfig) -> None:
    """Refuse a step-over wider than the pad with a PlanError."""
    diameter = 2.0 * pad.radius_m
    if plan.stepover_m > diameter:
        raise PlanError(
            f"a step-over of {plan.stepover_m * 1e3:.4g} mm would leave stripes: the pad measures "
            f"{diameter * 1e3:.4g} mm. Set a step-over below that; a sixth of it is usual."
        )
