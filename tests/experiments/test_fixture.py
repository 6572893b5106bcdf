"""A fixture in the cell: the part is placed with it, and tool and arm that touch it stop the robot."""

from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

from polish_sim.config import Scenario
from polish_sim.errors import InputError, PlanError
from polish_sim.experiments import run_experiment
from polish_sim.experiments.assembly import check_settings
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.log import RETRACT_PHASE
from polish_sim.planning import PlanResult, measure_given_path, plan_part
from polish_sim.scenario_file import merge
from polish_sim.spatial import apply
from tests.planning.test_fixture import asked, wall

NEAR_M = 0.5e-3  #: The grid's half spacing, within which the pad counts as touching


@cache
def scenario(with_fixture: bool) -> Scenario:
    part = asked(Path(mkdtemp()), wall(10.0) if with_fixture else None)
    settings = {
        "part": {"file": part.file, "fixture_file": part.fixture_file, "up": "z", "displacement_m": 0.001},
        "plan": {
            "region": "point:0,0,0",
            "pattern": "raster",
            "stepover_m": 0.03,
            "raster_direction": [1.0, 0.0, 0.0],
        },
        "process": {"feed_m_s": 0.05, "max_feed_s": 4.0},
    }
    return merge(Scenario(experiment="surface"), settings, "")


@cache
def plan(with_fixture: bool) -> PlanResult:
    of = scenario(with_fixture)
    return plan_part(of.part, of.plan, of.process, of.pad)


def test_a_part_in_a_fixture_that_hangs_below_it_is_placed_with_it_above_the_table_and_run_beside_it():
    result = plan(True)
    low = [mesh.vertices[:, 2].min() for mesh in (result.mesh, result.standing[0])]
    assert low == pytest.approx([-0.02, -0.03])
    placing = PartPlacing(scenario(True), *result.standing, result.path)
    T = placing.reach().T_base_work
    assert apply(T, result.standing[0].vertices)[:, 2].min() > -1e-3
    run = run_experiment(scenario(True), plan(True))
    assert run.stop_reason is None
    assert np.median(run.log["normal_force_n"][run.log.fed]) == pytest.approx(20.0, abs=1.0)


def test_a_path_planned_without_it_is_refused_or_stopped_at_the_wall_and_a_fixture_where_it_is_not_seen():
    of = scenario(True)
    blind = measure_given_path(plan(False).path, of.part, of.plan, of.process, of.pad)
    with pytest.raises(PlanError, match="into the fixture"):
        run_experiment(of, blind)
    run = run_experiment(merge(of, {"safety": {"tool_in_part": "allow"}}, ""), blind)
    assert run.stop_reason.startswith("pad, tool, wrist or forearm ran into the fixture")
    T = np.array(run.figures["T_base_work"])
    stopped = run.log["tcp_position_m"][run.log["phase"] < RETRACT_PHASE][-1]
    place = (stopped - T[:3, 3]) @ T[:3, :3]
    # The path begins 15 mm beside the wall, with a pad of 50 mm: it comes down on the wall, 10 mm high.
    assert place[0] == pytest.approx(0.065, abs=0.5e-3)
    assert place[2] == pytest.approx(0.010 + NEAR_M, abs=0.2e-3)
    with pytest.raises(InputError, match=r"part\.fixture_file .*'run surface'"):
        check_settings(merge(scenario(True), {"experiment": "force"}, ""))
