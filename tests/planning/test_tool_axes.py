"""The tool axis: lead and tilt, smoothing that keeps within its bound, turns over creases."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.config import PlanConfig
from polish_sim.planning.ground.ground import prepare_ground
from polish_sim.planning.moves.stroke import STEEPEST, angles_between, lean, smooth_axes, soften_creases
from polish_sim.planning.planner import plan_on
from tests.planning.shapes import region_of

LEAD, TILT = np.radians(12.0), np.radians(-7.0)


def leaned(part, **plan):
    """A path with lead and tilt, its surface normals and directions of feed in contact."""
    region = region_of(part)
    planned = plan_on(prepare_ground(region, PlanConfig(**plan)), PlanConfig(**plan))
    path = planned.path
    rows = np.flatnonzero(path.process)
    feed = np.gradient(path.positions_work[rows], axis=0)
    foot = region.surface.closest(path.positions_work[rows])
    feed -= foot.normals * (feed * foot.normals).sum(axis=1, keepdims=True)
    return planned, foot.normals, feed / np.linalg.norm(feed, axis=1, keepdims=True)


@pytest.mark.parametrize(("part", "pattern"), [("plate", "raster"), ("sphere_100", "spiral")])
def test_the_tool_leans_forward_by_the_lead_and_to_the_left_by_the_tilt(part, pattern):
    """Left of the feed, seen from outside, is normal x feed."""
    planned, normals, feed = leaned(part, pattern=pattern, lead_angle_rad=LEAD, tilt_angle_rad=TILT)
    axes = planned.path.axes_work[planned.path.process]
    left = np.cross(normals, feed)
    up = (axes * normals).sum(axis=1)
    assert np.arctan2((axes * feed).sum(axis=1), up) == pytest.approx(np.full(len(up), LEAD), abs=1e-6)
    assert np.arctan2((axes * left).sum(axis=1), up) == pytest.approx(np.full(len(up), TILT), abs=1e-6)


def test_on_its_leads_the_tool_keeps_the_lean_it_lands_and_leaves_with():
    planned, _, _ = leaned("sphere_100", lead_angle_rad=LEAD, lead_in="tangent")
    path, rows = planned.path, np.flatnonzero(planned.path.process)
    assert path.axes_work[: rows[0]] == pytest.approx(np.tile(path.axes_work[rows[0]], (rows[0], 1)))
    after = path.axes_work[rows[-1] + 1 :]
    assert after == pytest.approx(np.tile(path.axes_work[rows[-1]], (len(after), 1)))


def wobbling(amplitude, wave=0.01, length=0.1):
    """Axes that wobble about z along a straight path."""
    s = np.linspace(0.0, length, 801)
    angle = amplitude * np.sin(2.0 * np.pi * s / wave)
    return s, np.stack([np.sin(angle), 0.0 * s, np.cos(angle)], axis=1)


def test_a_wobble_is_averaged_out_over_its_own_length():
    s, axes = wobbling(np.radians(3.0))
    smooth = smooth_axes(axes, np.tile([0.0, 0.0, 1.0], (801, 1)), s, 0.01, np.radians(10.0))
    inside = (s > 0.01) & (s < 0.09)
    assert np.abs(smooth[inside, 0]).max() < np.sin(np.radians(0.1))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("bound", [0.0, 1e-6, np.radians(1.0), np.radians(20.0)])
def test_no_axis_is_turned_further_than_the_bound_whatever_the_path(bound, seed):
    rng = np.random.default_rng(seed)
    s = np.cumsum(rng.uniform(2e-4, 2e-3, 300))
    normals = rng.normal(size=(300, 3)) + [0.0, 0.0, 1.5]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    axes = lean(normals, rng.normal(size=(300, 3)), 0.3, -0.2)
    smooth = smooth_axes(axes, normals, s, 0.02, bound)
    assert angles_between(axes, smooth).max() <= bound + 1e-12
    assert np.linalg.norm(smooth, axis=1) == pytest.approx(np.ones(300), abs=1e-12)


def test_smoothing_never_lays_the_tool_into_the_part():
    """Axes that lean 50 deg one way and the other: the bound of 40 deg alone would allow 90 deg from the normal."""
    rng = np.random.default_rng(3)
    s = np.linspace(0.0, 0.1, 400)
    normals = rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    axes = lean(normals, rng.normal(size=(400, 3)), 0.69, 0.69)
    smooth = smooth_axes(axes, normals, s, 0.05, 0.7)
    assert angles_between(smooth, normals).max() <= STEEPEST + 1e-9


def test_without_a_length_or_a_bound_the_axes_are_left_alone():
    s, axes = wobbling(0.1)
    assert smooth_axes(axes, axes, s, 0.0, 0.1) is axes
    assert smooth_axes(axes, axes, s, 0.01, 0.0) is axes


def test_straight_and_even_axes_stay_as_they_are():
    s = np.linspace(0.0, 0.1, 101)
    axes = np.tile([0.0, 0.6, 0.8], (101, 1))
    assert smooth_axes(axes, axes, s, 0.03, 0.2) == pytest.approx(axes, abs=1e-12)


def test_a_plan_reports_the_largest_deviation_and_keeps_its_bound():
    """On the saddle the normal turns along the path: averaged over 60 mm it stays within a degree of itself."""
    bound = np.radians(1.0)
    planned, normals, _ = leaned("saddle", axis_smoothing_m=0.06, axis_deviation_rad=bound)
    axes = planned.path.axes_work[planned.path.process]
    deviation = planned.figures["axis_deviation_max_rad"]
    assert 0.0 < deviation <= bound + 1e-12
    assert angles_between(axes, normals).max() == pytest.approx(deviation, abs=1e-6)
    turn = np.linalg.norm(np.diff(axes, axis=0), axis=1)
    assert turn.max() < np.linalg.norm(np.diff(normals, axis=0), axis=1).max()


def test_without_smoothing_nothing_deviates():
    planned, _, _ = leaned("sphere_100")
    assert planned.figures["axis_deviation_max_rad"] == 0.0


def test_over_a_crease_the_axis_turns_on_a_stretch_and_is_the_normal_elsewhere():
    s = np.linspace(0.0, 0.1, 401)
    angle = np.where(s < 0.05, 0.2, -0.2)
    normals = np.stack([np.sin(angle), 0.0 * s, np.cos(angle)], axis=1)
    axes = soften_creases(normals, s, 0.004)
    turned = np.arcsin(axes[:, 0])
    crease = 0.049875  # half-way between the points beside it
    assert turned == pytest.approx(np.interp(s, [crease - 0.004, crease + 0.004], [0.2, -0.2]), abs=3e-3)
    away = np.abs(s - 0.05) > 0.0081
    assert axes[away] == pytest.approx(normals[away], abs=1e-12)


def test_on_a_smooth_part_nothing_is_softened():
    s = np.linspace(0.0, 0.1, 101)
    normals = np.stack([np.sin(s / 0.03), 0.0 * s, np.cos(s / 0.03)], axis=1)
    assert soften_creases(normals, s, 0.004) is normals
