"""The path as data, its leads, the pressing offset, and its tool axes."""

from dataclasses import replace

import numpy as np
import pytest

from polish_sim.arrays import angles_between, into_plane, unit
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError
from polish_sim.planning import pressed
from polish_sim.planning.ground import prepare_ground
from polish_sim.planning.moves.leads import LEADS, with_leads, with_way_down
from polish_sim.planning.moves.stroke import STEEPEST, lean, smooth_axes, soften_creases
from polish_sim.planning.planner import plan_on
from polish_sim.planning.toolpath import APPROACH, LEAD_IN, PROCESS
from tests.planning.shapes import UP, region_of, shipped_plan
from tests.planning.test_moves import stroke


def test_a_path_cannot_be_changed_and_pressing_moves_its_process_points_against_the_axis():
    path = shipped_plan("sphere_100").path
    with pytest.raises(ValueError, match="read-only"):
        path.positions_work[0] = 0.0
    with pytest.raises(PlanError, match="axes_work"):
        replace(path, axes_work=path.axes_work[1:])
    path = shipped_plan("freeform").path
    down = pressed(path, 0.004)
    moved = path.positions_work - down.positions_work
    assert moved[path.process] == pytest.approx(0.004 * path.axes_work[path.process], abs=1e-15)
    assert np.abs(moved[~path.process]).max() == 0.0
    assert np.diff(down.s).min() > 0.0


@pytest.mark.parametrize("name", LEADS)
def test_every_lead_in_ends_at_the_first_point_from_above_and_behind(name):
    clearance = 0.03
    move = with_leads(stroke(0.0, 0.05), *2 * [LEADS[name]], clearance)
    lead_in = move.positions[move.segment == LEAD_IN]
    assert len(lead_in) > 1
    assert np.diff(lead_in[:, 2]).max() < 0.0
    assert lead_in[:, 0].max() <= 1e-12
    assert np.linalg.norm(lead_in[-1]) < 2e-3
    assert move.positions[0, 2] == pytest.approx(clearance)
    assert move.positions[-1, 2] == pytest.approx(clearance)
    if name == "arc":  # lands along the path
        assert -lead_in[-1, 0] > lead_in[-1, 2] / np.tan(np.radians(4.0))


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
    assert with_way_down(planned, 0.03) is planned


def leaned(part, **plan):
    """A path with lead and tilt, its surface normals and directions of feed in contact."""
    region = region_of(part)
    planned = plan_on(prepare_ground(region, PlanConfig(**plan)), PlanConfig(**plan))
    path = planned.path
    rows = np.flatnonzero(path.process)
    normals = region.surface.closest(path.positions_work[rows]).normals
    return planned, normals, unit(into_plane(np.gradient(path.positions_work[rows], axis=0), normals))


@pytest.mark.parametrize(("part", "pattern"), [("plate", "raster"), ("sphere_100", "spiral")])
def test_the_tool_leans_forward_by_the_lead_and_to_the_left_by_the_tilt(part, pattern):
    """Left of the feed, seen from outside, is normal x feed."""
    lead, tilt = np.radians(12.0), np.radians(-7.0)
    planned, normals, feed = leaned(part, pattern=pattern, lead_angle_rad=lead, tilt_angle_rad=tilt)
    axes = planned.path.axes_work[planned.path.process]
    left = np.cross(normals, feed)
    up = (axes * normals).sum(axis=1)
    assert np.arctan2((axes * feed).sum(axis=1), up) == pytest.approx(lead, abs=1e-6)
    assert np.arctan2((axes * left).sum(axis=1), up) == pytest.approx(tilt, abs=1e-6)
    # On its leads the tool keeps the lean it lands and leaves with.
    path, rows = planned.path, np.flatnonzero(planned.path.process)
    assert path.axes_work[: rows[0]] == pytest.approx(np.tile(axes[0], (rows[0], 1)))
    assert path.axes_work[rows[-1] + 1 :] == pytest.approx(np.tile(axes[-1], (len(path.s) - rows[-1] - 1, 1)))


@pytest.mark.parametrize("bound", [1e-6, np.radians(1.0), 0.7])
def test_no_axis_is_turned_further_than_the_bound_nor_into_the_part_whatever_the_path(bound):
    """Axes that lean 50 deg one way and the other: the bound of 40 deg alone would allow 90 deg off."""
    rng = np.random.default_rng(3)
    s = np.cumsum(rng.uniform(1e-4, 4e-4, 400))
    normals = unit(rng.normal(size=(400, 3)))
    axes = lean(normals, rng.normal(size=(400, 3)), 0.69, 0.69)
    smooth = smooth_axes(axes, normals, s, 0.05, bound)
    assert angles_between(axes, smooth).max() <= bound + 1e-12
    assert angles_between(smooth, normals).max() <= STEEPEST + 1e-9
    assert np.linalg.norm(smooth, axis=1) == pytest.approx(1.0, abs=1e-12)


def test_a_plan_reports_the_largest_deviation_and_keeps_its_bound():
    """On the saddle the normal turns along the path: averaged over 60 mm it stays within a degree."""
    bound = np.radians(1.0)
    planned, normals, _ = leaned("saddle", axis_smoothing_m=0.06, axis_deviation_rad=bound)
    axes = planned.path.axes_work[planned.path.process]
    deviation = planned.axis_deviation_max_rad
    assert 0.0 < deviation <= bound + 1e-12
    assert angles_between(axes, normals).max() == pytest.approx(deviation, abs=1e-6)
    turn = np.linalg.norm(np.diff(axes, axis=0), axis=1)
    assert turn.max() < np.linalg.norm(np.diff(normals, axis=0), axis=1).max()


def test_axes_are_averaged_over_a_wobble_and_turned_on_a_stretch_over_a_crease():
    s = np.linspace(0.0, 0.1, 801)
    angle = np.radians(3.0) * np.sin(2.0 * np.pi * s / 0.01)
    axes = np.stack([np.sin(angle), 0.0 * s, np.cos(angle)], axis=1)
    smooth = smooth_axes(axes, np.tile(UP, (801, 1)), s, 0.01, np.radians(10.0))
    inside = (s > 0.01) & (s < 0.09)
    assert np.abs(smooth[inside, 0]).max() < np.sin(np.radians(0.1))
    assert smooth_axes(axes, axes, s, 0.0, 0.1) is axes
    assert smooth_axes(axes, axes, s, 0.01, 0.0) is axes
    # Over a length far below the points' distance there is nothing to average, and no memory is taken for it.
    np.testing.assert_allclose(smooth_axes(axes, axes, s, 1e-300, 0.1), axes, atol=1e-4)
    s = np.linspace(0.0, 0.1, 401)
    angle = np.where(s < 0.05, 0.2, -0.2)
    normals = np.stack([np.sin(angle), 0.0 * s, np.cos(angle)], axis=1)
    axes = soften_creases(normals, s, 0.004)
    turned = np.arcsin(axes[:, 0])
    crease = 0.049875  # half-way between the points beside it
    assert turned == pytest.approx(np.interp(s, [crease - 0.004, crease + 0.004], [0.2, -0.2]), abs=3e-3)
    away = np.abs(s - 0.05) > 0.0081
    assert axes[away] == pytest.approx(normals[away], abs=1e-12)
    smooth = np.stack([np.sin(s / 0.03), 0.0 * s, np.cos(s / 0.03)], axis=1)
    assert soften_creases(smooth, s, 0.004) is smooth
