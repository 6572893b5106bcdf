"""Several stretches in contact become several strokes: travel through the air, a way down, the stretch, a lift."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from polish_sim.cell import Stroke
from polish_sim.config import PartConfig, PlanConfig, Scenario
from polish_sim.experiments.part_setup import polishing_strokes
from polish_sim.experiments.placement import Reach
from polish_sim.planning import PlanResult, plan_part
from polish_sim.spatial import transform

LIFT = PlanConfig().clearance_m
PLACE = np.array([0.0, -0.5, 0.08])
REACH = Reach(transform(np.eye(3), PLACE), 0.0, np.array([1.2, -1.6, 1.9, -1.9, -1.6, 0.0]), 1.0)


@pytest.fixture(scope="module")
def islands(tmp_path_factory: pytest.TempPathFactory) -> PlanResult:
    """Two square islands 120 mm apart on a base, covered by a spiral each."""
    moved = trimesh.transformations.translation_matrix
    base = trimesh.creation.box((200.0, 100.0, 10.0), moved([0, 0, -5]))
    pads = [trimesh.creation.box((60.0, 60.0, 20.0), moved([x, 0, 5])) for x in (-60.0, 60.0)]
    file: Path = tmp_path_factory.mktemp("islands") / "islands.stl"
    trimesh.boolean.union([base, *pads], engine="manifold").export(file)
    plan = PlanConfig(region="box:-100,-50,14,100,50,16", stepover_m=0.02, bridge_m=0.0)
    return plan_part(PartConfig(str(file), up="z"), plan)


def strokes(plan: PlanResult, force: np.ndarray | None = None) -> list[Stroke]:
    return polishing_strokes(Scenario(), replace(plan.path, force=force), REACH, 0.0, LIFT)


def test_each_island_is_a_stroke_and_the_tool_comes_down_only_over_it(islands: PlanResult) -> None:
    first, second = strokes(islands)
    assert first.lead_in.length == pytest.approx(LIFT, abs=1e-3)
    assert second.lead_in.length == pytest.approx(LIFT, abs=1e-3)
    assert first.travel.duration == 0.0
    assert second.travel.places[-1] > 0.1


def test_the_travel_begins_where_the_lift_ends_and_ends_where_the_way_down_begins(islands: PlanResult) -> None:
    first, second = strokes(islands)
    lifted = first.process.positions[-1] + [0.0, 0.0, LIFT + first.depth]
    assert second.travel.positions[0] == pytest.approx(lifted, abs=1e-9)
    assert second.travel.positions[-1] == pytest.approx(second.lead_in.positions[0], abs=1e-9)
    assert second.travel.positions[:, 2].min() >= PLACE[2] + 0.015 + 0.7 * LIFT


def test_a_path_that_presses_harder_at_its_end_is_lifted_to_the_same_height(islands: PlanResult) -> None:
    force = np.interp(islands.path.s, [0.0, islands.path.s[-1]], [10.0, 60.0])
    for stroke in strokes(islands, force):
        end = stroke.process.positions[-1, 2] + stroke.lift + stroke.depth
        assert end == pytest.approx(PLACE[2] + 0.015 + LIFT, abs=1e-6)
