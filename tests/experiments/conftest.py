"""Runs shared by the tests of the experiments: short feeds, each simulated once."""

import pytest

from polish_sim.config import Scenario
from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.planning import PlanResult, plan_part
from polish_sim.scenario_file import override
from tests.kept import keep

FREEFORM = ["plan.stepover_m=0.016", "plan.edge_margin_m=0.04", "process.max_feed_s=8"]


@pytest.fixture(scope="session")
def freeform() -> RunResult:
    """Eight seconds of feed on the freeform part, every error on."""
    scenario = override(default_scenario("surface"), FREEFORM)
    run: RunResult = keep(("run", scenario), lambda: run_experiment(scenario))
    return run


@pytest.fixture(scope="session")
def cap() -> tuple[Scenario, PlanResult]:
    """Two seconds of feed on the small sphere cap: a scenario and its plan, quick to run again."""
    scenario = override(default_scenario("surface"), ["part.file=sphere_50", "process.max_feed_s=2"])
    return scenario, plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad)
