"""A simulated robot on a plate."""

from collections.abc import Callable

import pytest

from polish_sim.experiments import default_scenario
from polish_sim.experiments.assembly import build_cell
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.surface import prepare_surface
from polish_sim.scenario_file import override
from polish_sim.ur.robot import SimulatedRobot
from tests.cli.conftest import polish_sim

__all__ = ["polish_sim"]


@pytest.fixture(scope="session")
def build() -> Callable[[], SimulatedRobot]:
    scenario = override(default_scenario("surface"), ["part.file=plate", "plan.stepover_m=0.03"])
    place = prepare_surface(*planned(scenario))

    def make() -> SimulatedRobot:
        return SimulatedRobot(build_cell(scenario, place))

    make().step()  # compiles before anything has to be in time
    return make


@pytest.fixture
def robot(build: Callable[[], SimulatedRobot]) -> SimulatedRobot:
    return build()
