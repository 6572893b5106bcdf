"""Protective stops: each with its reason, at its moment, the log whole; then brakes, retract, standstill."""

import math
import re

import mujoco
import numpy as np
import pytest

from polish_sim.cell import RealPart, build_scene, guards, no_part
from polish_sim.cell.scene import Drawn
from polish_sim.cell.stroke import FEEDING
from polish_sim.geometry import load_part
from polish_sim.models import part_path
from polish_sim.motion import JOINT_LIMITS
from polish_sim.motion.rules.limits import JOINT_SPEED
from tests.cell import cells

LOST = "faults.events=sensor-dropout@contact+0.5"


@pytest.mark.parametrize(
    ("limit", "lean", "unit", "axes"),
    [("force_limit_n=12", 0.0, " N", slice(3)), ("torque_limit_nm=0.1", 0.03, " N m", slice(3, 6))],
)
def test_too_much_force_or_torque_stops_the_robot(limit, lean, unit, axes):
    """Position control goes down to where the springs carry 20 N, whatever force is wanted; a tool that leans
    by 2 deg feels k a^2 / 4 times the angle about its point."""
    part = cells.part_under(cells.tool_pose(0.0, -0.5, 0.1, (lean, 0.0, 0.0)))
    settings = f"safety.{limit}", "process.contact_force_n=10", "controller.name=position"
    run, (name, most) = cells.on_plane(*settings, part=part, wanted=10.0).run(), limit.split("=")
    assert f"safety.{name}" in str(run.stop_reason)
    said = str(run.safety.protective_stop_measured).removesuffix(unit)
    assert float(most) <= float(said) < 1.2 * float(most)
    measured = np.linalg.norm(run.log["wrench_measured_tool"][:, axes], axis=1)
    assert measured[: cells.stopped_at(run)].max() <= float(most) < measured[cells.stopped_at(run)]


def test_contact_lost_over_an_edge_stops_after_its_time():
    run = cells.on_plane("safety.contact_lost_s=0.3", "controller.name=position", slide=0.12).run()
    assert "safety.contact_lost_s" in str(run.stop_reason)
    assert run.safety.protective_stop_measured == "0.30 s"
    stopped = cells.stopped_at(run)
    touching = np.flatnonzero(run.log["wrench_measured_tool"][:stopped, 2] >= 2.0)  # a tenth of 20 N
    assert stopped - touching[-1] == pytest.approx(300, abs=2)
    assert run.trace.tcp_position_m[-1, 0] > 0.06  # the plane's edge


def test_a_pad_pressed_in_deeper_than_the_part_is_modelled_stops():
    run = cells.on_plane("pad.stiffness_n_m=2001").run()
    assert "deeper than the part is modelled" in str(run.stop_reason)
    assert run.safety.protective_stop_measured == "8.0 mm"


@pytest.mark.parametrize("grown_s", [1.0, 0.0])
def test_a_swing_that_grows_is_no_jump_and_the_same_at_once_is_one(grown_s):
    """Gears shake the arm at 24 Hz, up to what counts as a jump beyond the 15 N that are allowed."""
    state, codes, largest = cells.on_plane().state, set(), 0.0
    state.sequence.stage = FEEDING
    for t in np.arange(0.0, 3.0, 0.001):
        size = 40.0 * float(np.clip((t - 1.0) / grown_s if grown_s else t >= 1.0, 0.0, 1.0))
        state.sensor.reading[2] = 50.0 + size * math.sin(2.0 * math.pi * 24.0 * (t - 1.0))
        state.sensor.changed = t
        code = guards.check_reading(state, 0.001, t)
        codes |= {code} if t > 0.5 else set()  # before, the reading comes from nothing
        largest = max(largest, state.guards.found if t > 0.5 else 0.0)
    assert 15.0 < largest < 30.0
    assert codes == ({guards.NO_STOP} if grown_s else {guards.NO_STOP, guards.JUMP})


def in_the_air(*poses, feed, settings=(), **how):
    """A cell whose tool moves through poses, touching nothing with the pad."""
    scenario = cells.ideal("arc", cells.EVERY_STEP, *settings)
    return cells.cell_for(scenario, cells.free_stroke(*poses, feed=feed), **how)


def past_a_wall(field, y, z):
    """The tool moves along x towards a wall that begins at x = 80 mm."""
    part = RealPart(field, field, np.eye(3), np.array([0.0, y, z]))
    return in_the_air(cells.tool_pose(0.0, -0.5, 0.2), cells.tool_pose(0.1, -0.5, 0.2), feed=0.02, part=part)


def test_a_joint_at_the_end_of_its_range_or_a_nearly_singular_arm_stops_the_robot():
    """The tool turns about its axis through more than the last joint has left; or the arm is stretched."""
    turns = [cells.tool_pose(0.001 * i, -0.5, 0.2, (0.0, 0.0, 0.127 * i)) for i in range(60)]
    turned = in_the_air(*turns, feed=0.005).run()
    assert "the end of its range" in str(turned.stop_reason)
    assert turned.log["q_rad"][-1, 5] == pytest.approx(JOINT_LIMITS[5, 0], abs=0.01)
    stretched = in_the_air(cells.tool_pose(0.0, -0.6, 0.3), cells.tool_pose(0.0, -1.0, 0.3), feed=0.1).run()
    assert "safety.singular_value_limit" in str(stretched.stop_reason)
    assert np.abs(stretched.log["qd_rad_s"]).max() < JOINT_SPEED


def test_what_touches_a_shaft_or_housing_is_seen_whether_part_or_table():
    """At a low wall before the housing is over it: between pad and housing is the shaft of 9 mm radius."""
    assert past_a_wall(cells.wall(0.08), -0.2, 0.0).run().stop_reason is None
    low = past_a_wall(cells.wall(0.08, height=0.032), -0.5, 0.224).run()
    assert low.log["tcp_position_m"][cells.stopped_at(low), 0] == pytest.approx(0.08 - 0.009, abs=0.002)
    cell = past_a_wall(cells.wall(0.08), -0.5, 0.0)
    run = cell.run()
    assert low.stop_reason == run.stop_reason == guards.REASONS[guards.CRASH]
    mujoco.mj_kinematics(cell.model, cell.data)
    housing = cells.meshes_of(cell.model, "tool_mount")
    deepest = max(cells.drawn_vertices(cell.model, cell.data, k)[:, 0].max() for k in housing) - 0.08
    assert -0.001 < deepest < 0.005
    part, runs = no_part()._replace(position=np.array([-0.3, -0.6, 0.1])), []
    model = build_scene(cells.ideal("arc", cells.EVERY_STEP), Drawn(load_part(part_path("plate")), part))
    for look_every_s in (5.0, 0.003):
        cell = in_the_air(*(cells.tool_pose(0.2, -0.5, z) for z in (0.05, -0.2)), feed=0.05, model=model)
        runs.append(cell.run(cells.EachStep(lambda _model, _data: None, look_every_s)))
    assert {"table", "tool_collision"} <= set(re.findall(r"\w+", str(runs[0].stop_reason)))
    housing_end = 0.22 - (0.115 + 0.040)  # of the collision capsule above the tool point [m]
    assert runs[0].trace.tcp_position_m[-1, 2] == pytest.approx(-housing_end, abs=0.001)
    assert runs[1].steps == runs[0].steps  # whoever looks on


def test_a_simulation_that_blows_up_is_stopped_as_unstable():
    def poison(_model, data):
        if data.time > 0.3:
            data.qvel[0] = math.inf

    run = in_the_air(cells.tool_pose(0.0, -0.5, 0.2), feed=0.05).run(cells.EachStep(poison))
    assert "unstable" in str(run.stop_reason)
    assert run.steps < 310


def test_each_guard_keeps_the_largest_share_of_its_limit_and_its_place():
    cell = cells.on_plane("process.hold_s=1")
    run = cell.run()
    assert run.stop_reason is None
    shares, log = guards.guard_shares(cell.state.guards), run.log
    force = np.linalg.norm(log["wrench_measured_tool"][:, :3], axis=1)
    assert shares["force"].share == pytest.approx(force.max() / cell.scenario.safety.force_limit_n)
    assert shares["force"].at_m == pytest.approx(log["path_s_m"][force.argmax()])
    assert 0.0 < shares["near a singularity"].share < 1.0
    assert shares["sensor overloaded"].share == 0.0  # the sensor has no such limit
    guards.forget_shares(cell.state.guards)
    assert all(share == (0.0, 0.0) for share in guards.guard_shares(cell.state.guards).values())


@pytest.mark.parametrize(
    ("latency", "speed", "off", "rest"), [(0.004, 0.05, 0.05, 5e-3), (0.011, 0.02, 0.15, 1e-2)]
)
def test_after_a_stop_the_tool_goes_back(latency, speed, off, rest):
    """Pressed with 20 N on a plane when the sensor's reading is lost, half a second after contact."""
    settings = f"safety.stop_latency_s={latency}", f"safety.retract_speed_m_s={speed}"
    run = cells.on_plane(LOST, *settings, hold=2.0).run()
    after = slice(cells.stopped_at(run), None)
    way, force = run.trace.tcp_position_m[after], run.trace.normal_force_n[after]
    assert way[-1, 2] - way[0, 2] == pytest.approx(0.030, abs=0.002)
    assert np.linalg.norm((way - way[0])[:, :2], axis=1).max() < 2e-4
    assert run.safety.retracted is True
    assert run.safety.retract_m == pytest.approx(0.030, abs=0.002)
    assert run.safety.stop_delay_s == pytest.approx(latency, abs=1e-9)
    assert force.max() < force[0] + 0.3
    assert np.diff(force[: np.argmax(force == 0.0)]).max() < 0.05
    assert force[-1] == 0.0
    assert run.trace.tcp_speed_m_s[after].max() == pytest.approx(speed, rel=off)
    assert run.trace.tcp_speed_m_s[-1] < rest


@pytest.mark.parametrize(("speed", "deceleration"), [(0.1, 1.0), (0.05, 4.0)])
def test_the_braking_distance_is_v_squared_over_2a(speed, deceleration):
    """In free space, braked on the way; before the brakes the robot continues for the stop's latency."""
    poses = cells.tool_pose(0.0, -0.5, 0.2), cells.tool_pose(0.2, -0.5, 0.2)
    settings = "faults.events=controller-nan@1.4", f"safety.stop_deceleration_m_s2={deceleration}"
    run = in_the_air(*poses, feed=speed, settings=settings).run()
    way = run.trace.tcp_position_m[cells.stopped_at(run) :]
    gone = float(np.linalg.norm(way[-1] - way[0]))
    assert gone == pytest.approx(speed * 0.004 + speed**2 / (2.0 * deceleration), rel=0.1, abs=3e-4)
    assert run.safety.retracted is None  # nothing to retract from


def test_a_retract_that_meets_a_joints_end_goes_as_far_as_it_can():
    """The shoulder or elbow range is cut to what the retract of 30 mm would need half of."""
    cell = cells.on_plane(LOST, hold=2.0)
    pressed, lifted = (cells.joints_at(cells.tool_pose(0.0, -0.5, z)) for z in (0.096, 0.112))
    joint = int(np.argmax(np.abs(lifted - pressed)))
    limits = cell.state.speedl.highest if lifted[joint] > pressed[joint] else cell.state.speedl.lowest
    limits[joint] = lifted[joint]
    run = cell.run()
    assert str(run.stop_reason).startswith("wrist sensor reading missing:")
    assert run.safety.retracted is False
    assert run.safety.retract_m == pytest.approx(0.016, abs=0.003)
    assert run.trace.normal_force_n[-1] == 0.0
    assert np.all((run.log["q_rad"] > JOINT_LIMITS[:, 0]) & (run.log["q_rad"] < JOINT_LIMITS[:, 1]))
