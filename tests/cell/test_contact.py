"""The pad's contact, and springs and pad along a path, against closed forms; refused settings."""

import math
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from polish_sim.cell import build_course, build_pad, limits, no_part, press_pad
from polish_sim.cell.course import nearest_earlier
from polish_sim.cell.linear_arm import joints_about, motion_matrices
from polish_sim.errors import ConfigError
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.scenario_file import override
from polish_sim.spatial import transform
from tests.cell import cells
from tests.cell.cells import DOWN, HEAD_STIFFNESS, PAD, PRESSED, below_sphere, plane, press, sphere

FLAT = cells.part_at(plane())
DEPTH = 0.001
FORCE = 20000.0 * DEPTH  # [N]
SPIN = 6000.0 * 2.0 * math.pi / 60.0  # [rad/s]
CENTER = np.array([0.0, 0.0, -DEPTH])
STILL = replace(PAD, damping_s_m=0.0)
TANGENTIAL_MASS = 4.0  # [kg]
STIFFEST = 0.49 * 0.3 / 1e-6 - 20000.0 / 3.0  # dt w of head and pad is 0.7 there [N/m]
SHARPEST = 0.3 * 20.0 * 0.001 / TANGENTIAL_MASS  # mu F dt / (v_s m) is 1 there [m/s]
SMOOTH, SLOW = "pad.friction_smoothing_m_s", "simulation.control_every=4 robot.command_timeout_s"
STIFF, FAST = "pad.damping_s_m=0 pad.stiffness_n_m", "spindle.speed_rpm=15000"
UPRIGHT = cells.TOUCH @ np.diag([1.0, -1.0, -1.0, 1.0])  # pose of a part that is touched at its origin


@pytest.mark.parametrize("points", [8, 100, 1000])
def test_the_points_stand_for_the_disc_area_centroid_and_second_moments(points):
    pad = build_pad(replace(PAD, points=points))
    assert len(pad.x) == points
    assert np.hypot(pad.x, pad.y).max() < PAD.radius_m
    np.testing.assert_allclose([pad.x.mean(), pad.y.mean()], 0.0, atol=1e-9)
    spread = np.cov(pad.x, pad.y, bias=True)
    np.testing.assert_allclose(spread, np.eye(2) * PAD.radius_m**2 / 4.0, rtol=1e-9, atol=1e-15)
    assert pad.material.stiffness * points == pytest.approx(PAD.stiffness_n_m)


def below_plane(points):
    return -points[:, 2], np.tile([0.0, 0.0, 1.0], (len(points), 1))


@pytest.mark.parametrize(
    ("field", "below", "x", "depth", "turn", "share", "off_nm"),
    [
        (plane(), below_plane, 0.0, 0.002, [1.0, 0.0, 0.0], 0.005, 0.0),
        (plane(), below_plane, 0.0, 0.002, [0.0, 3.0, 0.0], 0.005, 0.0),
        (plane(), below_plane, 0.0, 0.002, [0.0, 10.0, 0.0], 0.005, 0.0),
        (sphere(0.3), below_sphere(0.3), 0.004, cells.working_depth(0.3), [0.0, 0.0, 0.0], 0.02, 1e-4),
        (sphere(0.1), below_sphere(0.1), 0.0, cells.working_depth(0.1), [0.0, 0.0, 0.0], 0.02, 1e-4),
        (sphere(0.05), below_sphere(0.05), 0.008, cells.working_depth(0.05), [0.0, 0.0, 0.0], 0.02, 1e-4),
    ],
)
def test_on_a_tilted_plane_and_spheres_it_is_the_integral(field, below, x, depth, turn, share, off_nm):
    center, R = np.array([x, 0.0, -depth]), Rotation.from_rotvec(turn, degrees=True).as_matrix() @ DOWN
    truth, found = cells.foundation(below, center, R), press(cells.part_at(field), center, R)
    force, moment = np.linalg.norm(truth.force), np.linalg.norm(truth.torque)
    np.testing.assert_allclose(found.force, truth.force, rtol=0.0, atol=share * force)
    np.testing.assert_allclose(found.torque, truth.torque, rtol=0.0, atol=share * moment + off_nm)


def test_on_a_plane_the_force_is_k_d_harder_by_a_times_the_speed_and_the_part_never_pulls():
    for depth in (0.0, 1e-5, 0.001, 0.006):
        found = press(FLAT, np.array([0.003, -0.002, -depth]))
        np.testing.assert_allclose(found.force, [0.0, 0.0, 20000.0 * depth], rtol=1e-5, atol=1e-4)
        np.testing.assert_allclose(found.torque, 0.0, atol=1e-4)
    for part, height in ((FLAT, 1e-5), (FLAT, 0.5), (no_part(), -0.01)):
        found = press(part, np.array([0.0, 0.0, height]), config=PAD, velocity=(0.1, 0.0, -0.1), spin=600.0)
        np.testing.assert_array_equal(np.concatenate(found), 0.0)
    # Turning at w about x, the point at y moves down at w y: the damped moment is a k d w A a^2 / 4.
    smooth, rate = replace(PAD, friction=0.0), 2.0
    for speed in (-1.0, -0.2, 0.0, 0.2):
        found = press(FLAT, CENTER, config=smooth, velocity=(0, 0, -speed))
        assert found.force[2] == pytest.approx(FORCE * max(1.0 + 3.0 * speed, 0.0), rel=1e-5, abs=1e-12)
    rolling = press(FLAT, CENTER, config=smooth, turning=(rate, 0.0, 0.0))
    assert rolling.force[2] == pytest.approx(FORCE, rel=1e-5)
    expected = -3.0 * FORCE * rate * PAD.radius_m**2 / 4.0
    np.testing.assert_allclose(rolling.torque, [expected, 0.0, 0.0], rtol=1e-4, atol=1e-7)


def test_a_spinning_disc_feels_two_thirds_of_mu_f_r_and_little_against_its_feed_and_does_not_press():
    """Points slide round faster than along: the drag against a feed v is mu F v / (w R)."""
    for sense in (1.0, -1.0):
        found = press(FLAT, CENTER, config=STILL, spin=sense * SPIN)
        expected = -sense * 2.0 / 3.0 * STILL.friction * FORCE * STILL.radius_m
        assert found.torque @ DOWN[:, 2] == pytest.approx(expected, rel=0.01)
        np.testing.assert_allclose(found.force, [0.0, 0.0, FORCE], atol=1e-3)
    turned = press(FLAT, CENTER, config=STILL, turning=tuple(SPIN * DOWN[:, 2]))
    spun = press(FLAT, CENTER, config=STILL, spin=SPIN)
    np.testing.assert_allclose(turned.torque, spun.torque, rtol=1e-12, atol=1e-12)
    feed = 0.2
    fed = press(FLAT, CENTER, config=replace(STILL, points=2000), velocity=(feed, 0.0, 0.0), spin=SPIN)
    assert fed.force[0] == pytest.approx(-STILL.friction * FORCE * feed / (SPIN * STILL.radius_m), rel=0.02)
    R = Rotation.from_rotvec([0.05, 0.02, 0.0]).as_matrix() @ DOWN
    still, spun = (press(FLAT, CENTER, R, replace(PAD, friction=0.0), spin=spin) for spin in (0.0, SPIN))
    np.testing.assert_array_equal(np.concatenate(spun), np.concatenate(still))


@pytest.mark.parametrize("speed", [0.0, 1e-4, 0.005, 0.02, 1.0])
def test_a_sliding_disc_is_held_back_by_mu_f_which_grows_smoothly_with_the_speed(speed):
    direction = np.array([math.cos(3.5), math.sin(3.5), 0.0])
    found = press(FLAT, CENTER, config=STILL, velocity=tuple(speed * direction))
    developed = speed / math.hypot(speed, STILL.friction_smoothing_m_s)
    drag = -STILL.friction * FORCE * developed * direction
    np.testing.assert_allclose(found.force, drag + [0.0, 0.0, FORCE], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(found.torque, 0.0, atol=1e-4)


WEIGHT = """
<mujoco>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="weight" pos="0 0 {height}">
      <freejoint/>
      <inertial pos="0 0 0.02" mass="{mass}" diaginertia="0.002 0.002 0.003"/>
      <site name="pad" euler="180 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(("mass", "height"), [(0.3, 0.002), (0.3, 0.02), (2.0, 0.01)])
def test_a_dropped_weight_bounces_ever_lower_and_is_carried(mass, height):
    model = mujoco.MjModel.from_xml_string(WEIGHT.format(mass=mass, height=height))
    data, pad = mujoco.MjData(model), build_pad(PAD)
    force, torque, rows = np.zeros(3), np.zeros(3), []
    for _ in range(1500):
        mujoco.mj_step1(model, data)
        center, velocity = data.site("pad").xpos.copy(), np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, 0, velocity, 0)
        turning, linear = velocity[:3].copy(), velocity[3:].copy()
        R_base_pad = np.ascontiguousarray(data.site("pad").xmat.reshape(3, 3))
        press_pad(pad, FLAT, 0.0, R_base_pad, center, linear, turning, force, torque)
        lever = center - data.body("weight").xipos
        data.body("weight").xfrc_applied = np.concatenate([force, torque + np.cross(lever, force)])
        rows.append((center[2], force[2]))
        mujoco.mj_step2(model, data)
    h, pressed = np.array(rows).T
    tops = h[1:-1][(h[1:-1] >= h[:-2]) & (h[1:-1] > h[2:]) & (pressed[1:-1] == 0.0)]
    heights = np.append(height, tops)
    assert np.all(heights[1:] <= 1.001 * heights[:-1])
    assert pressed[-1] == pytest.approx(mass * 9.81, rel=1e-3)


def accepted(*changes):
    scenario = cells.ideal("force", "safety.force_limit_n=30", *changes)
    force = scenario.process.contact_force_n
    limits.check_contact_settings(scenario, force)
    limits.check_friction(scenario.pad, force, TANGENTIAL_MASS, scenario.simulation.timestep_s)
    limits.check_rates(scenario)


@pytest.mark.parametrize(
    ("refused", "named", "within"),
    [
        ("pad.damping_s_m=10.3", "pad.damping_s_m", "pad.damping_s_m=9.7"),
        ("safety.force_limit_n=23", "safety.force_limit_n", "safety.force_limit_n=25"),
        (f"{STIFF}={1.01 * STIFFEST}", "pad.stiffness_n_m", f"{STIFF}={0.99 * STIFFEST}"),
        ("head.mass_kg=0.05 pad.damping_s_m=0", "too stiff", ""),
        (f"{SMOOTH}={0.99 * SHARPEST}", SMOOTH, f"{SMOOTH}={1.01 * SHARPEST}"),
        ("pad.stiffness_n_m=1999", "pad.stiffness_n_m", "pad.stiffness_n_m=2001"),
        ("sensor.rate_hz=2000", "sensor.rate_hz", "sensor.rate_hz=2000 simulation.timestep_s=0.0005"),
        # A slow sensor is not to be taken for a frozen one.
        ("sensor.rate_hz=40", "safety.sensor_timeout_s", "sensor.rate_hz=40 safety.sensor_timeout_s=0.05"),
        # A command must outlive the control cycle.
        (f"{SLOW}=0.006", "robot.command_timeout_s", f"{SLOW}=0.008"),
        # A spindle is to be seen five times a turn.
        (FAST, "Lower it to 12000", "spindle.speed_rpm=12000"),
        (FAST, "spindle.speed_rpm", f"{FAST} spindle.imbalance_m_s=0"),
        (FAST, "spindle.speed_rpm", f"{FAST} simulation.timestep_s=0.0005"),
    ],
)
def test_beyond_a_limit_it_is_refused_and_within_accepted(refused, named, within):
    with pytest.raises(ConfigError, match=re.escape(named)):
        accepted(*refused.split())
    accepted(*within.split())


def test_an_experiment_refuses_them_before_it_moves_and_models_the_part_as_deep_as_a_soft_pad_goes():
    for key, value in (("pad.damping_s_m", 20), (SMOOTH, 1e-5), ("sensor.rate_hz", 40)):
        with pytest.raises(ConfigError, match=key):
            run_experiment(cells.ideal("force", f"{key}={value}"))
    usual = cells.ideal("force").process
    assert limits.modelled_depth(usual, 20.0, 20e3) == 0.008  # 8 x 20 N / 20 kN/m
    raised = replace(usual, changes="force_n=60@3")  # half of it counts
    assert limits.modelled_depth(raised, 20.0, 20e3) == pytest.approx(0.012)


def course_on(field, *strokes, T_base_work=UPRIGHT, arm="robot.arm=ur5e"):
    scenario = override(default_scenario("surface"), ["plan.stepover_m=0.008", arm])
    return build_course(scenario, strokes, field, T_base_work, cells.joints_at(cells.TOUCH))


def pressed_with(force, T_base_touch=cells.TOUCH):
    """A stroke of 20 mm whose poses are pressed in by D = F / k, as the plan's are."""
    pressed = cells.along_tool(T_base_touch, z=force / 5000.0)
    table = cells.path_through(pressed, cells.along_tool(pressed, x=0.02))
    forces = np.full(len(table.positions), force)
    return cells.pressing_stroke(T_base_touch)._replace(process=table, force=forces, depth=force / 5000.0)


@pytest.mark.parametrize("radius", [0.3, 0.05])
def test_on_a_sphere_it_goes_as_deep_as_the_closed_form_says(radius):
    course = course_on(sphere(radius), cells.pressing_stroke())

    def pad_force(depth):
        return float(cells.foundation(below_sphere(radius), np.array([0.0, 0.0, -depth]), DOWN).force[2])

    pad_depth = brentq(lambda d: pad_force(d) - 20.0, 1e-4, 0.01, xtol=1e-9)
    assert course.depth[0] == pytest.approx(pad_depth + 20.0 / HEAD_STIFFNESS, rel=0.01)
    h = 1e-6
    pad_slope = (pad_force(pad_depth + h) - pad_force(pad_depth - h)) / (2.0 * h)
    assert course.stiffness[0] == pytest.approx(1.0 / (1.0 / pad_slope + 1.0 / HEAD_STIFFNESS), rel=0.03)


def test_springs_and_pad_in_series_say_the_depth_on_a_plane_and_half_over_its_border():
    course = course_on(plane(), cells.pressing_stroke(slide=0.02))
    assert len(course.depth) * course.spacing == pytest.approx(0.02, abs=0.0015)
    np.testing.assert_allclose(course.depth, PRESSED, atol=1e-7)
    np.testing.assert_allclose(course.surplus, 0.0, atol=1e-7)
    np.testing.assert_allclose(course.stiffness, 5000.0, rtol=1e-4)
    np.testing.assert_allclose(course.moment, 0.0, atol=1e-5)
    whole_disc = PAD.stiffness_n_m * PAD.radius_m**2 / 4.0  # [N m/rad]
    np.testing.assert_allclose(course.tilt_stiffness, whole_disc, rtol=0.02)
    # Half the disc carries: twice the compression; the centroid of half a disc, 4 R / 3 pi.
    low, high = (-0.06, -0.06, -0.016), (0.06, 0.06, 0.016)
    edge = cells.sampled(lambda p: np.where(p[..., 0] < 0.0005, p[..., 2], 0.008), low, high)
    course = course_on(edge, cells.pressing_stroke())
    assert course.depth[0] == pytest.approx(20.0 / HEAD_STIFFNESS + 2.0 * 20.0 / PAD.stiffness_n_m, rel=0.03)
    R_tool = UPRIGHT[:3, :3].T @ cells.TOUCH[:3, :3]
    lever = R_tool.T @ [-4.0 * PAD.radius_m / (3.0 * np.pi), 0.0, 0.0]
    np.testing.assert_allclose(course.moment[0], np.cross(lever, [0.0, 0.0, 20.0])[:2], atol=0.01)


def test_rows_of_a_course_follow_the_plan_its_strands_and_turning_in_a_turned_cell_too():
    """On the second stroke, 40 mm further along the plan, the tool presses half as hard."""
    second = pressed_with(10.0, cells.along_tool(cells.TOUCH, y=0.01))._replace(start_s=0.04)
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
    turned = cells.along_tool(cells.tool_pose(0.0, -0.5, 0.1, (0.1, 0.0, 0.0)), x=0.02)
    stroke = cells.pressing_stroke()._replace(process=cells.path_through(cells.TOUCH, turned))
    course = course_on(plane(), stroke)
    np.testing.assert_allclose(course.turning[10], [0.1 / stroke.process.length, 0.0, 0.0], atol=1e-3)
    turn = transform(Rotation.from_rotvec([0.2, -0.3, 0.5]).as_matrix(), np.zeros(3))
    there = course_on(sphere(0.1), cells.pressing_stroke(slide=0.01))
    stroke = cells.pressing_stroke(turn @ cells.TOUCH, slide=0.01)
    here = course_on(sphere(0.1), stroke, T_base_work=turn @ UPRIGHT)
    np.testing.assert_allclose(here.depth, there.depth, atol=1e-7)
    np.testing.assert_allclose(here.moment, there.moment, atol=1e-4)


def test_where_one_mode_has_the_tools_axis_the_arm_swings_at_it_and_a_rigid_one_is_not_known_to():
    """Against the eigenvalues of links, rotors and springs: a tenth above the slowest."""
    about = joints_about(default_scenario("surface"), cells.joints_at(cells.TOUCH)[None])[0]
    moving, tool = motion_matrices(about), np.append(about.axis @ about.jacobian[:3], np.zeros(6))
    squares, shapes = eigh(moving.stiffness + 5000.0 * np.outer(tool, tool), moving.mass)
    softness = (tool @ shapes) ** 2 / squares
    assert softness[0] > 0.9 * softness.sum()
    slowest = course_on(plane(), cells.pressing_stroke()).arm_mode[0] / 1.1
    assert slowest == pytest.approx(np.sqrt(squares[0]), rel=0.02)
    assert not course_on(plane(), cells.pressing_stroke(), arm=cells.IDEAL_ARM).arm_mode.any()
