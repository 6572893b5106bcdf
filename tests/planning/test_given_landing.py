"""A path that begins in contact gets a way down, so that the force sensor can be zeroed."""

import numpy as np
import pytest

from polish_sim.planning.moves.leads import with_way_down
from polish_sim.planning.toolpath import APPROACH, LEAD_IN, PROCESS
from tests.planning.shapes import shipped_plan


def test_the_way_down_ends_where_contact_begins_and_leaves_the_rest_alone():
    planned = shipped_plan("sphere_100").path
    bare = planned.rows(planned.process)
    path = with_way_down(bare, 0.03)
    added = len(path.s) - len(bare.s)
    assert path.segment[0] == APPROACH
    assert list(dict.fromkeys(path.segment.tolist()))[:3] == [APPROACH, LEAD_IN, PROCESS]
    assert (path.positions_work[added:] == bare.positions_work).all()
    heights = (path.positions_work[: added + 1] - bare.positions_work[0]) @ bare.axes_work[0]
    assert heights[0] == pytest.approx(0.03)
    assert heights[-1] == 0.0
    assert (np.diff(heights) < 0.0).all()


def test_a_path_that_begins_in_the_air_stays_as_it_is():
    planned = shipped_plan("sphere_100").path
    assert with_way_down(planned, 0.03) is planned
