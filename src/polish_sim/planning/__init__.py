"""From a region of a part's surface to a tool path that covers it."""

from typing import TYPE_CHECKING

from polish_sim.lazy import names_on_use

if TYPE_CHECKING:
    from polish_sim.planning.inspection import (
        Inspection,
        inspect_path,
        measure_given_path,
    )
    from polish_sim.planning.part_plan import (
        PlanObserver,
        PlanResult,
        measure_path,
        plan_mesh,
        plan_part,
    )
    from polish_sim.planning.patterns import PATTERNS
    from polish_sim.planning.planner import plan_path
    from polish_sim.planning.toolpath import ToolPath, pressed
else:
    __getattr__ = names_on_use(__name__)
