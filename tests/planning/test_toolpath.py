"""The path as data, its leads and the pressing offset."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.errors import PlanError
from polish_sim.planning import SEGMENTS, pressed
from polish_sim.planning.moves.leads import LEADS, Move, with_leads, with_way_down
from polish_sim.planning.toolpath import APPROACH, LEAD_IN, LEAD_OUT, PROCESS, RETRACT, ToolPath
from tests.planning.shapes import UP, shipped_plan

CLEARANCE = 0.03


def straight(count=50):
    x = np.linspace(0.0, 0.05, count)
    positions = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    return Move(positions, np.tile(UP, (count, 1)), PROCESS, np.zeros(count, dtype=np.int64))


def test_a_path_cannot_be_changed_after_it_was_made():
    path = shipped_plan("sphere_100").path
    with pytest.raises(ValueError, match="read-only"):
        path.positions_work[0] = 0.0


def test_columns_of_different_length_are_refused():
    path = shipped_plan("sphere_100").path
    with pytest.raises(PlanError, match="axes_work"):
        ToolPath(path.positions_work, path.axes_work[1:], path.s, path.pass_index, path.segment, path.curvature)


def test_pressing_moves_the_process_points_and_only_them_against_the_axis():
    path = shipped_plan("freeform").path
    down = pressed(path, 0.004)
    moved = path.positions_work - down.positions_work
    assert moved[path.process] == pytest.approx(0.004 * path.axes_work[path.process], abs=1e-15)
    assert np.abs(moved[~path.process]).max() == 0.0
    assert np.diff(down.s).min() > 0.0


def test_segments_come_in_order_once_each():
    segment = shipped_plan("freeform").path.segment
    changes = segment[np.concatenate([[True], np.diff(segment) != 0])]
    assert [SEGMENTS[code] for code in changes] == ["approach", "lead_in", "process", "lead_out", "retract"]


def test_the_tool_comes_and_goes_along_the_normal_at_the_clearance():
    path = shipped_plan("freeform").path
    process = np.flatnonzero(path.segment == PROCESS)
    for end, outside, air in ((process[0], 0, (APPROACH, LEAD_IN)), (process[-1], -1, (LEAD_OUT, RETRACT))):
        rows = np.isin(path.segment, air)
        lifted = path.positions_work[rows] - path.positions_work[end]
        height = lifted @ path.axes_work[end]
        assert lifted == pytest.approx(height[:, None] * path.axes_work[end], abs=1e-12)
        assert height.min() > 0.0
        assert height[outside] == pytest.approx(CLEARANCE, abs=1e-12)


@pytest.mark.parametrize("name", LEADS)
def test_every_lead_in_ends_at_the_first_point_from_above_and_behind(name):
    moves = with_leads(straight(), LEADS[name], CLEARANCE)
    lead_in = moves[1].positions
    assert moves[1].segment == LEAD_IN
    assert np.diff(lead_in[:, 2]).max() < 0.0
    assert lead_in[:, 0].max() <= 1e-12
    assert np.linalg.norm(lead_in[-1]) < 2e-3
    assert moves[0].positions[0, 2] == pytest.approx(CLEARANCE)
    assert moves[-1].positions[-1, 2] == pytest.approx(CLEARANCE)


def test_the_arc_lands_along_the_path():
    lead_in = with_leads(straight(), LEADS["arc"], CLEARANCE)[1].positions
    landing = straight().positions[0] - lead_in[-1]
    assert np.degrees(np.arctan2(-landing[2], landing[0])) < 4.0


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
