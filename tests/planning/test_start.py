"""Where a path begins when it is told to."""

from dataclasses import replace

import numpy as np
import pytest

from polish_sim.config import PartConfig, PlanConfig
from polish_sim.errors import PlanError
from polish_sim.planning import plan_part

PLATE = PartConfig(file="plate")
CORNER = (-0.09, 0.09, 0.02)
COARSE = PlanConfig(stepover_m=0.016, start=CORNER)


def begin_of(result):
    return result.path.positions_work[result.path.process][0]


def told(result):
    return [note for note in result.notes if "from the start asked for" in note]


@pytest.mark.parametrize("pattern", ["spiral", "contour", "raster", "fermat"])
def test_a_path_begins_within_two_step_overs_of_its_start_or_says_where_it_begins(pattern):
    result = plan_part(PLATE, replace(COARSE, pattern=pattern))
    far = np.linalg.norm(begin_of(result) - CORNER) > 2.0 * COARSE.stepover_m
    assert bool(told(result)) == far


def test_an_outward_path_says_that_it_begins_in_the_middle():
    result = plan_part(PLATE, replace(COARSE, order="outward"))
    assert np.linalg.norm(begin_of(result)[:2]) < 0.02
    assert told(result)[0].endswith("; an outward path begins in the middle")


def test_a_start_far_off_the_part_is_refused_with_the_nearest_place():
    with pytest.raises(PlanError, match=r"is 4900 mm away from the part\. The nearest point of the part is \(100, "):
        plan_part(PLATE, replace(COARSE, start=(5.0, 0.0, 0.02)))
