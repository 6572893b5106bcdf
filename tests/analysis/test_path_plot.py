"""Pictures of plans and inspected paths: what is drawn where, and what the part hides."""

import numpy as np
import pytest
import trimesh
from mpl_toolkits.mplot3d import proj3d

from polish_sim.analysis.inspect_plot import plot_distributions
from polish_sim.analysis.path_plot import plot_plan
from polish_sim.analysis.style import axis_name, depth_picture, seen_in
from polish_sim.config import PartConfig, PlanConfig
from polish_sim.planning import inspect_path, plan_part


def drawn_on(flat):
    """Points of the path drawn from above or from its side [mm]."""
    return np.concatenate([line.vertices for piece in flat.collections[1:] for line in piece.get_paths()])


def test_a_path_from_above_in_space_and_in_the_distributions_lies_where_it_was_planned():
    result = plan_part(PartConfig("sphere_100"), PlanConfig(stepover_m=0.012))
    figure = plot_plan(result)
    solid, flat = figure.axes[:2]
    drawn = np.concatenate([line.vertices for line in flat.collections[1].get_paths()])
    process = result.path.positions_work[result.path.process] * 1e3
    assert drawn.min(axis=0) == pytest.approx(process[:, :2].min(axis=0))
    assert drawn.max(axis=0) == pytest.approx(process[:, :2].max(axis=0))
    assert flat.get_xlabel() == "to the right (+x) [mm]"
    assert flat.get_ylabel() == "to the back (+y) [mm]"
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["approach, lead-in", "lead-out, retract"]
    corners = np.concatenate([result.mesh.vertices, result.path.positions_work]) * 1e3
    across = np.array(proj3d.proj_transform(*corners.T, solid.get_proj())[:2])
    view = np.array([solid.viewLim.intervalx, solid.viewLim.intervaly])
    share = np.ptp(across, axis=1) / np.ptp(view, axis=1)
    assert 0.9 < share.max() <= 1.0
    assert (across.min(axis=1) >= view[:, 0]).all()
    assert (across.max(axis=1) <= view[:, 1]).all()
    # Turns of the tool axis are in the unit of the table, legends below the panels.
    found = inspect_path(result.path, PartConfig("sphere_100"), result.plan)
    figure = plot_distributions(found)
    rate = figure.axes[2]
    assert rate.get_ylabel().endswith("[deg/mm]")
    # On a sphere of 100 mm the normal turns by 1 rad in 100 mm whichever way one goes.
    drawn = rate.lines[0].get_ydata()
    assert np.median(drawn) == pytest.approx(np.degrees(1.0) / 100.0, rel=0.02)
    assert drawn.max() == pytest.approx(np.degrees(found.figures["max_axis_rate_rad_m"]) * 1e-3)
    figure.draw_without_rendering()
    assert figure.axes[0].get_ylim() == (0.0, 100.0)
    for axes in figure.axes:
        assert axes.get_legend().get_window_extent().y1 < axes.get_window_extent().y0


def test_no_side_the_part_hides_is_drawn_through_it_and_a_side_is_seen_along_its_face(tmp_path):
    trimesh.creation.box((60, 60, 60)).export(tmp_path / "box.stl")
    box = PartConfig(str(tmp_path / "box.stl"), up="z")
    solid, flat, _ = plot_plan(plan_part(box, PlanConfig(region="all", stepover_m=0.03))).axes
    # Of the top alone, which keeps off its rim; walls would lie at 30.
    assert np.abs(drawn_on(flat)).max() < 29.0
    pieces = [np.asarray(piece._segments3d) for piece in solid.collections if hasattr(piece, "_segments3d")]
    drawn = np.concatenate(pieces)
    sides = np.isclose(np.abs(drawn).max(axis=2), 30.0).all(axis=1)
    strokes = drawn[sides].mean(axis=1)
    assert (strokes.max(axis=0) > 29.9).tolist() == [True, False, True]
    assert (strokes.min(axis=0) < -29.9).tolist() == [False, True, False]
    result = plan_part(box, PlanConfig(region="point:30,0,0", stepover_m=0.02))
    _, flat, _ = plot_plan(result).axes
    process = result.path.positions_work[result.path.process] * 1e3
    assert np.ptp(drawn_on(flat), axis=0) == pytest.approx(np.ptp(process[:, [1, 2]], axis=0))
    assert flat.get_ylabel() == "up (+z) [mm]"


def test_of_a_sphere_the_half_that_faces_the_viewer_is_seen_and_long_thin_facets_hide_as_well():
    ball = trimesh.creation.icosphere(4)
    third = np.array([0.6, -0.48, 0.64])
    assert axis_name(third) == "0.6, -0.48, 0.64"
    first = np.cross([0.0, 1.0, 0.0], third)
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(third, first), third])
    picture = depth_picture(np.asarray(ball.triangles), lambda points: points @ frame.T)
    normals = np.random.default_rng(1).standard_normal((2000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    facing = normals @ third
    # What is lifted by 3% of the radius looks over the rim from 0.23 behind it.
    clear = np.abs(facing) > 0.25
    assert (seen_in(picture, normals, normals) == (facing > 0.0))[clear].all()
    low, high = np.array([0.0, 0.0, 0.0]), np.array([10.0, 0.02, 0.0])
    strip = np.array([[low, [10.0, 0.0, 0.0], high], [low, high, [0.0, 0.02, 0.0]]])
    picture = depth_picture(strip, lambda points: points)
    along = np.column_stack([np.linspace(0.01, 9.99, 999), np.full(999, 0.01), np.full(999, -1.0)])
    assert not seen_in(picture, along, np.tile([0.0, 0.0, -1.0], (999, 1))).any()
