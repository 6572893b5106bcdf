"""A path without some of its places: the tool lifts over them, and the rest stays as it was planned."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.config import PartConfig, PlanConfig
from polish_sim.errors import PlanError
from polish_sim.planning import PlanResult, plan_part
from polish_sim.planning.moves.leave_out import leave_out
from polish_sim.planning.toolpath import stretches


@pytest.fixture(scope="module")
def plan() -> PlanResult:
    return plan_part(PartConfig(file="plate"), PlanConfig(stepover_m=0.02))


def test_a_stroke_cut_in_two_lands_and_leaves_at_the_cut_and_is_the_same_elsewhere(plan: PlanResult) -> None:
    path = plan.path
    gone = path.process & (path.s > 0.4) & (path.s < 0.5)
    left = leave_out(path, gone, plan.plan, plan.ready.air)
    assert left is not None
    np.testing.assert_array_equal(left.lost, gone)
    assert len(stretches(left.path.process)) == len(stretches(path.process)) + 1
    kept = left.path.positions_work[left.path.process]
    np.testing.assert_array_equal(kept, path.positions_work[path.process & ~gone])
    # Between the two the tool is lifted by the clearance.
    (_, last), (first, _) = stretches(left.path.process)[:2]
    between = left.path.positions_work[last : first + 1, 2]
    assert between.max() - between.min() == pytest.approx(plan.plan.clearance_m, abs=1e-6)
    # Strokes before the first that changes keep every row.
    once = left.path
    again = leave_out(once, once.process & (once.s > once.s[first] + 0.1), plan.plan, plan.ready.air)
    assert again is not None
    np.testing.assert_array_equal(again.path.s[: last + 1], once.s[: last + 1])


def test_what_is_left_of_a_stroke_is_longer_than_a_step_over_or_nothing(plan: PlanResult) -> None:
    path = plan.path
    begin = path.s[path.process][0]
    gone = path.process & (path.s > begin + 0.015)
    assert leave_out(path, gone, plan.plan, plan.ready.air) is None


def test_a_plan_from_a_place_on_lands_there_and_raises_its_force_gradually(plan: PlanResult) -> None:
    rest = plan.behind(0.5)
    process = rest.path.process
    assert rest.path.positions_work[process][0] == pytest.approx(
        plan.path.positions_work[plan.path.process & (plan.path.s >= 0.5)][0]
    )
    assert rest.path.force is not None
    assert rest.path.force[process][0] == pytest.approx(0.5 * plan.tool.force)
    assert rest.path.force[process][-1] == plan.tool.force
    with pytest.raises(PlanError, match="nothing of the path is left behind"):
        plan.behind(1e3)
