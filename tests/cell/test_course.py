"""The course: statics of springs and pad along a path, against closed forms."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.cell import Stroke, build_course
from polish_sim.cell.course import nearest_earlier
from polish_sim.cell.linear_arm import joints_about, motion_matrices
from polish_sim.control import Course
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.spatial import transform
from tests.cell.cells import IDEAL_ARM, TOUCH, along_tool, joints_at, path_through, pressing_stroke, tool_pose
from tests.cell.fields import plane, sampled, sphere
from tests.cell.pressing import DOWN, HEAD_STIFFNESS, PAD, PRESSED, below_sphere, foundation

UPRIGHT = np.array(TOUCH) @ np.diag([1.0, -1.0, -1.0, 1.0])  # pose of a part that is touched at its origin
FULL_TILT_STIFFNESS = PAD.stiffness_n_m * PAD.radius_m**2 / 4.0  # of a disc all on the part [N m/rad]


def course_on(field, *strokes: Stroke, T_base_work=UPRIGHT, arm="robot.arm=ur5e") -> Course:
    scenario = override(default_scenario("surface"), ["plan.stepover_m=0.008", arm])
    return build_course(scenario, strokes, field, T_base_work, joints_at(TOUCH))


def pressed_with(force: float, T_base_touch: Array = TOUCH) -> Stroke:
    """A stroke of 20 mm whose poses are pressed in by D = F / k, as the plan's are."""
    pressed = along_tool(T_base_touch, z=force / 5000.0)
    table = path_through(pressed, along_tool(pressed, x=0.02))
    forces = np.full(len(table.positions), force)
    return pressing_stroke(T_base_touch)._replace(process=table, force=forces, depth=force / 5000.0)


def test_on_a_plane_springs_and_pad_in_series_say_the_depth_and_nothing_changes_along_the_path():
    course = course_on(plane(), pressing_stroke(slide=0.02))
    assert len(course.depth) * course.spacing == pytest.approx(0.02, abs=0.0015)
    np.testing.assert_allclose(course.depth, PRESSED, atol=1e-7)
    np.testing.assert_allclose(course.surplus, 0.0, atol=1e-7)
    np.testing.assert_allclose(course.stiffness, 5000.0, rtol=1e-4)
    np.testing.assert_allclose(course.moment, 0.0, atol=1e-5)
    np.testing.assert_allclose(course.tilt_stiffness, FULL_TILT_STIFFNESS, rtol=0.02)


@pytest.mark.parametrize("radius", [0.3, 0.05])
def test_on_a_sphere_it_goes_as_deep_as_the_closed_form_says(radius):
    course = course_on(sphere(radius), pressing_stroke())

    def pad_force(depth: float) -> float:
        return float(foundation(below_sphere(radius), np.array([0.0, 0.0, -depth]), DOWN).force[2])

    pad_depth = brentq(lambda d: pad_force(d) - 20.0, 1e-4, 0.01, xtol=1e-9)
    assert course.depth[0] == pytest.approx(pad_depth + 20.0 / HEAD_STIFFNESS, rel=0.01)
    h = 1e-6
    pad_slope = (pad_force(pad_depth + h) - pad_force(pad_depth - h)) / (2.0 * h)
    assert course.stiffness[0] == pytest.approx(1.0 / (1.0 / pad_slope + 1.0 / HEAD_STIFFNESS), rel=0.03)


def test_where_the_pad_hangs_half_over_a_border_it_goes_deeper_and_feels_a_moment():
    """Half the disc carries: twice the compression; the centroid of half a disc, 4 R / 3 pi."""
    low, high = (-0.06, -0.06, -0.016), (0.06, 0.06, 0.016)
    edge = sampled(lambda p: np.where(p[..., 0] < 0.0005, p[..., 2], 0.008), low, high)
    course = course_on(edge, pressing_stroke())
    assert course.depth[0] == pytest.approx(20.0 / HEAD_STIFFNESS + 2.0 * 20.0 / PAD.stiffness_n_m, rel=0.03)
    R_tool = UPRIGHT[:3, :3].T @ TOUCH[:3, :3]
    lever = R_tool.T @ [-4.0 * PAD.radius_m / (3.0 * np.pi), 0.0, 0.0]
    np.testing.assert_allclose(course.moment[0], np.cross(lever, [0.0, 0.0, 20.0])[:2], atol=0.01)


def test_rows_follow_the_plan_over_several_strokes_and_a_raster_line_neighbours_the_line_before_it():
    """On the second stroke, 40 mm further along the plan, the tool presses half as hard."""
    second = pressed_with(10.0, along_tool(TOUCH, y=0.01))._replace(start_s=0.04)
    course = course_on(plane(), pressed_with(20.0), second)
    rows = np.arange(len(course.depth)) * course.spacing
    np.testing.assert_allclose(course.depth[rows < 0.0295], PRESSED, rtol=1e-3)
    np.testing.assert_allclose(course.depth[rows > 0.0305], 0.5 * PRESSED, rtol=1e-3)
    assert course.neighbour[round(0.05 / course.spacing)] == pytest.approx(0.01 / course.spacing, abs=1)
    x = np.arange(0.0, 0.1, 0.0005)
    there = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    back = np.stack([x[::-1], 0.0 * x + 0.008, 0.0 * x], axis=1)
    rows = nearest_earlier(np.concatenate([there, back]), 0.0005, 0.012)
    assert (rows[: len(x)] == -1).all()  # places of the same strand are no neighbours
    np.testing.assert_array_equal(rows[len(x) + 60 :], np.arange(len(x))[::-1][60:])


def test_the_turning_is_that_of_the_path_and_all_else_stays_when_the_whole_cell_is_turned():
    turned = along_tool(tool_pose(0.0, -0.5, 0.1, (0.1, 0.0, 0.0)), x=0.02)
    stroke = pressing_stroke()._replace(process=path_through(TOUCH, turned))
    course = course_on(plane(), stroke)
    np.testing.assert_allclose(course.turning[10], [0.1 / stroke.process.length, 0.0, 0.0], atol=1e-3)
    turn = transform(Rotation.from_rotvec([0.2, -0.3, 0.5]).as_matrix(), np.zeros(3))
    there = course_on(sphere(0.1), pressing_stroke(slide=0.01))
    here = course_on(sphere(0.1), pressing_stroke(turn @ TOUCH, slide=0.01), T_base_work=turn @ UPRIGHT)
    np.testing.assert_allclose(here.depth, there.depth, atol=1e-7)
    np.testing.assert_allclose(here.moment, there.moment, atol=1e-4)


def test_where_one_mode_has_the_tools_axis_the_arm_swings_at_it_and_a_rigid_one_is_not_known_to():
    """Against the eigenvalues of links, rotors and springs: a tenth above the slowest."""
    about = joints_about(default_scenario("surface"), joints_at(TOUCH)[None])[0]
    moving, tool = motion_matrices(about, 0.0), np.append(about.axis @ about.jacobian[:3], np.zeros(6))
    squares, shapes = eigh(moving.stiffness + 5000.0 * np.outer(tool, tool), moving.mass)
    softness = (tool @ shapes) ** 2 / squares
    assert softness[0] > 0.9 * softness.sum()
    slowest = course_on(plane(), pressing_stroke()).arm_mode[0] / 1.1
    assert slowest == pytest.approx(np.sqrt(squares[0]), rel=0.02)
    assert not course_on(plane(), pressing_stroke(), arm=IDEAL_ARM).arm_mode.any()
