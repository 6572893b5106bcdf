"""Ground to measure paths on."""

from __future__ import annotations

import pytest

from polish_sim.config import PlanConfig
from polish_sim.planning.ground.ground import Ground, prepare_ground
from tests.planning.shapes import region_of


@pytest.fixture(scope="session")
def plate_ground() -> Ground:
    """The top of the plate, 0.2 x 0.2 m at z = 0.02 m."""
    return prepare_ground(region_of("plate"), PlanConfig())
