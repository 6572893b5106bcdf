"""How the master may move the part: against the feed, along files and lines, by strokes in the air."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.analysis.run_record import RunRecord
from polish_sim.config import Scenario
from polish_sim.dual import master
from polish_sim.dual.carrier import RAMP_PEAK
from polish_sim.dual.checks import MotionCheck, check_master, check_motion
from polish_sim.dual.master import about_axis, along_line
from polish_sim.dual.placement import sampled
from polish_sim.dual.plots import plot_dual
from polish_sim.dual.strokes import air_limits, pair_strokes
from polish_sim.dual.task import prepare_dual
from polish_sim.errors import InputError, ReachError
from polish_sim.experiments import run_experiment
from polish_sim.experiments.part_setup import PlacedTool
from polish_sim.log import RETRACT_PHASE
from polish_sim.motion import forward
from polish_sim.motion.rules.limits import JOINT_ACCELERATION
from polish_sim.spatial import from_pose, inverse, place_of, transform, wxyz
from tests.dual.test_dual import AWAY, EXACT, dual, task_and_run, two_stretches
from tests.planning.shapes import path_through

FEED, RADIUS = 0.05, 0.08
ABOVE = (*AWAY, *EXACT)
SHORT = (*ABOVE, "process.max_feed_s=2")
AGAINST = ("dual.master_speed_m_s=0", f"dual.master_turn_rad_s={-FEED / RADIUS}")
BEGUN_S, TARED_S = 0.8, 0.399
START = from_pose([-0.5, 0.1, 0.3, 0.3, -0.2, 0.5])
TIMES = np.linspace(0.0, 4.0, 81)
VELOCITY = np.array([0.02, -0.01, 0.005])


def poses_of(run, column):
    return forward(run.log[column])


def test_a_hub_turned_against_the_feed_lets_the_tool_stand_still_and_its_wrist_has_room():
    run = run_experiment(dual(*ABOVE, *AGAINST, "process.max_feed_s=2.5"))
    trace = run.trace
    fed = np.flatnonzero(trace.fed)
    time = trace.time_s[fed]
    even = fed[(time > time[0] + BEGUN_S) & (time < time[-1] - 0.4)]
    assert np.ptp(trace.tcp_position_m[even], axis=0).max() < 1e-4
    on_part = np.linalg.norm(np.gradient(trace.tool_on_part_m[even], trace.time_s[even], axis=0), axis=1)
    assert on_part.mean() == pytest.approx(FEED, rel=1e-3)
    follower = np.ptp(poses_of(run, "q_rad")[run.log.fed], axis=0)
    assert np.abs(follower[:3, :3]).max() < 0.05
    # Its time ramps up as the feed does, in 0.54 s, of which half is lost: even then the tool hardly moves.
    assert run.figures["master_turn_rad"] == pytest.approx(FEED / RADIUS * (2.5 - 0.27), rel=0.01)
    assert np.ptp(trace.tcp_position_m[fed[:2000]], axis=0).max() < 5e-4
    assert run.figures["relative_error_rms_m"] < 6e-5
    pressed = ("process.feed_m_s=0.01", f"dual.master_turn_rad_s={-0.01 / RADIUS}", "dual.master_speed_m_s=0")
    q = prepare_dual(dual(*pressed)).master.q
    assert np.ptp(q[:, 5]) > 2.0 * math.pi
    assert np.abs(q[:, 5]).max() < 2.0 * math.pi


def between(task, run):
    """Part and tool as they came, where the check looked for them up to the last feed, (n, 4, 4)."""
    visits = task.work.visits
    planned_parts, planned_tools = sampled(task.work, task.reach.T_master_work, task.reach.spin)
    there = slice(int(np.flatnonzero(visits.stroke >= 0)[-1]) + 1)
    rows = np.searchsorted(run.log["time_s"], visits.time[there] + TARED_S)
    true = task.frames.true
    parts = poses_of(run, "master_q_rad")[rows] @ true.T_flange_gripper @ true.T_gripper_work
    tools = poses_of(run, "q_rad")[rows] @ true.T_flange_tool
    return inverse(planned_parts[there]) @ parts, inverse(planned_tools[there]) @ tools


def test_two_stretches_above_a_moving_part_are_followed_as_the_check_looked_at_them():
    moving = ("dual.master_turn_rad_s=0.1", "dual.master_speed_m_s=0.01", "simulation.log_rate_hz=0")
    task, run = task_and_run(dual(*ABOVE, *moving), two_stretches())
    assert len(task.strokes) == 2
    assert run.stop_reason is None
    assert run.figures["path_done"] == 1.0
    assert run.figures["relative_error_rms_m"] < 6e-5
    lifted = run.trace.tool_on_part_m[run.trace.phase == RETRACT_PHASE][:, 2]
    assert lifted.max() == pytest.approx(0.038 + 0.005 + run.scenario.plan.clearance_m, abs=1e-3)
    for off in between(task, run):
        assert np.linalg.norm(off[:, :3, 3], axis=1).max() < 1.8e-4
        assert Rotation.from_matrix(off[:, :3, :3]).magnitude().max() < 0.01
    figure = plot_dual(RunRecord("dual", run.scenario, run.figures, run.log, run.path))
    drawn = np.asarray(figure.axes[0].lines[0].get_ydata(), dtype=np.float64)
    fed = run.log.fed
    on = np.flatnonzero(fed)
    np.testing.assert_array_equal(np.isnan(drawn), ~fed)
    assert np.isnan(drawn[on[0] : on[-1]]).any()


@pytest.fixture(scope="module")
def short():
    return prepare_dual(dual(*SHORT))


def test_moments_out_of_reach_and_accelerations_at_once_between_those_tried_are_found(short):
    check = MotionCheck(short.work, short.reach, short.work.visits, Scenario().robot)
    check_motion(check, short.master, lambda _master, _follower: "")
    with pytest.raises(ReachError, match="tool and part would touch on the way"):
        check_motion(check, short.master, lambda _master, _follower: "tool and part")
    axes, middle = short.work.visits.axes.copy(), len(short.work.visits.s) // 2
    axes[middle] = Rotation.from_rotvec([0.0, 1.4, 0.0]).apply(axes[middle])
    tilted = check._replace(visits=check.visits._replace(axes=axes))
    with pytest.raises(ReachError, match="follower"):
        check_motion(tilted, short.master, lambda _master, _follower: "")
    times = short.master.spacing * np.arange(len(short.master.q))
    most, share = JOINT_ACCELERATION, 0.7
    # The first joint takes 0.7 of what it can all the time, and 0.7 of it to be released.
    speed = share * most / RAMP_PEAK
    qd = np.zeros_like(short.master.q)
    qd[:, 0] = speed + share * most * (times - times[0])
    slow = check._replace(robot=replace(check.robot, joint_speed_limit_rad_s=1e3))
    with pytest.raises(ReachError, match=r"joint 1 of the master .*from rest"):
        check_master(slow, short.master._replace(qd=qd))
    even = np.zeros_like(qd)
    even[:, 0] = speed
    check_master(slow, short.master._replace(qd=even))


def write_motion(file, times, poses, flange=False):
    name = "flange_" if flange else ""
    head = f"time_s,{name}x_mm,{name}y_mm,{name}z_mm,qw,qx,qy,qz"
    table = np.column_stack([times, 1e3 * poses[:, :3, 3], wxyz(poses[:, :3, :3])])
    np.savetxt(file, table, "%.9g", ",", header=head, comments="")
    return f"dual.master_path={file}"


@pytest.fixture(scope="module")
def turning():
    setting = ("dual.master_turn_rad_s=0.2", "dual.master_speed_m_s=0.02")
    return prepare_dual(dual(*SHORT, *setting))


@pytest.mark.parametrize("flange", [False, True])
def test_a_file_of_a_motion_is_followed_like_the_motion_itself(turning, tmp_path, flange):
    times = 7.0 + np.linspace(0.0, 3.0, 31)
    poses = turning.work.way(turning.reach.T_master_work, times - times[0])
    given = turning.frames.believed.master_flange(poses) if flange else poses
    again = prepare_dual(dual(*SHORT, write_motion(tmp_path / "way.csv", times, given, flange)))
    moments = np.linspace(0.0, 3.0, 100)
    asked, read = (one.work.way(one.reach.T_master_work, moments) for one in (turning, again))
    np.testing.assert_allclose(read, asked, atol=2e-6)
    assert again.work.way.lasts == 3.0
    end, stays = again.work.way(again.reach.T_master_work, np.array([3.0, 4.0]))
    np.testing.assert_array_equal(stays, end)
    rows = again.master.spacing * np.arange(len(again.master.q))
    played = forward(again.master.q) @ again.frames.believed.T_flange_gripper
    np.testing.assert_allclose(played, again.work.way(again.reach.T_master_work, rows), atol=1e-9)


EVERY = np.arange(31)
WRONG = {  # row by row: times [s], displacement [m], angle about z [rad]
    "short": (0.05 * EVERY, 0.0, 0.0, InputError, r"1\.50 s, .* 2\.00 s: 0\.50 s "),
    "a time twice": (0.1 * (EVERY - (EVERY == 5)), 0.0, 0.0, InputError, r"csv', line 7: time_s .* 0\.4"),
    "a jump": (0.1 * EVERY, 0.3 * (EVERY == 7), 0.0, InputError, r"line 9: the part would jump by 300 mm"),
    "far away": (0.1 * EVERY, 2.0, 0.0, ReachError, r"first pose, 0\.00 s .*line 2"),
    "jolting": (0.1 * EVERY, 0.003 * (EVERY % 2), 0.0, ReachError, r"line 2\).* more time would not help"),
    "spinning": (0.1 * EVERY, 0.0, 0.06 * EVERY, ReachError, r"joint 6 .* 3[45] deg/s .* line \d+\): 29"),
    "shaking": (0.1 * EVERY, 0.004 * np.sin(EVERY), 0.0, ReachError, r" 4\d\d mm/s\^2 .* line \d+\): .* 300"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_motion_that_cannot_be_done_is_refused(tmp_path, short, name):
    times, shift, angle, kind, said = WRONG[name]
    turn = Rotation.from_euler("z", np.broadcast_to(angle, 31)[:, None]).as_matrix()
    poses = short.work.way(short.reach.T_master_work, 0.1 * EVERY) @ transform(turn, np.zeros(3))
    poses[:, 0, 3] += shift
    slow = ("robot.joint_speed_limit_rad_s=0.5", "robot.linear_acceleration_m_s2=0.3")
    with pytest.raises(kind, match=said):
        prepare_dual(dual(*SHORT, *slow, write_motion(tmp_path / "way.csv", times, poses)))


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("time_s,x_m,y_m,z_m,qw,qx,qy,qz", "has one pose"),
        ("x_m,y_m,z_m,qw,qx,qy,qz", "lacks the column time_s"),
        ("time_s,x_m,y_m,z_m", "says nowhere how the part stood"),
        ("time_s,flange_x_m,y_m,z_m,qw,qx,qy,qz", "lacks the columns flange_y_m, flange_z_m"),
        ("time_s,x_mm,y_mm,z_mm,flange_x_mm,qw,qx,qy,qz", r"part is \(x_mm\) and where"),
    ],
)
def test_a_file_that_is_no_motion_is_refused(tmp_path, head, said):
    file = tmp_path / "way.csv"
    row = ["1" if name == "qw" else "0" for name in head.split(",")]
    file.write_text(f"{head}\n{','.join(row)}\n", encoding="utf-8")
    with pytest.raises(InputError, match=said):
        master.read_master_path(file)


def test_ways_turn_back_gently_and_turns_leave_their_axis_in_place():
    leg, times = 5.0, np.linspace(0.0, 60.0, 60_001)
    line, *others = along_line(VELOCITY, leg)(times).T / VELOCITY[:, None]
    for other in others:
        np.testing.assert_allclose(other, line, atol=1e-12)
    np.testing.assert_allclose(line[times <= leg], times[times <= leg], atol=1e-12)
    assert line.min() >= -1.0 / RAMP_PEAK - 1e-9
    assert line.max() <= leg + 1.0 / RAMP_PEAK + 1e-9
    rate = np.diff(line) / 1e-3
    change = np.diff(rate) / 1e-3
    assert np.abs(rate).max() <= 1.0 + 1e-9
    assert np.abs(rate[::100]).min() < 0.1 < np.mean(np.abs(rate) > 0.999)
    assert np.abs(change).max() <= RAMP_PEAK + 1e-4
    # The acceleration has no step: two and more derivatives are continuous.
    assert np.abs(np.diff(change)).max() < 0.01 * RAMP_PEAK
    axis, center = np.array([0.6, 0.0, 0.8]), np.array([0.03, -0.02, 0.04])
    poses = master.PartWay(along_line(np.zeros(3), 5.0), about_axis(axis, center, 0.5))(START, TIMES)
    for place in (center, center + 0.1 * axis):
        there = place_of(poses, place)
        np.testing.assert_allclose(there, np.broadcast_to(there[0], there.shape), atol=1e-15)
    turned = Rotation.from_matrix((inverse(START) @ poses)[:, :3, :3]).as_rotvec()
    np.testing.assert_allclose(turned, 0.5 * TIMES[:, None] * axis, atol=1e-12)


def motion_of_square(*changes):
    """Along three sides of 100 mm, a point every millimetre."""
    way = np.linspace(0.0, 3.0, 301)
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]])
    path = path_through(np.stack([np.interp(way, np.arange(4.0), column) for column in corners.T], axis=1))
    placed = PlacedTool(np.eye(4), np.tile(np.diag([1.0, -1.0, -1.0]), (len(path.s), 1, 1)), None)
    (stroke,) = pair_strokes(dual(*AWAY, *changes), path, placed)
    return stroke.motion


def test_above_the_part_corners_are_slowed_for_and_passed_within_the_tolerance():
    motion, corner = motion_of_square(), np.array([0.1, 0.0, 0.0])
    change = np.linalg.norm(np.gradient(motion.velocities, motion.spacing, axis=0), axis=1)
    assert change.max() <= 1.02 * air_limits(FEED).tip_acceleration
    missed = np.linalg.norm(motion.positions - corner, axis=1).min()
    assert 0.0 < missed <= 1.01 * dual().smoothing.tolerance_m
    assert motion.speeds.max() == pytest.approx(FEED, rel=1e-3)


@pytest.mark.parametrize("standoff", [0.0, 0.005])
def test_what_is_not_come_to_before_the_feed_ends_is_not_planned(standoff):
    motion = motion_of_square("process.max_feed_s=1", f"dual.standoff_m={standoff}")
    assert 1.0 * FEED + 0.02 < motion.places[-1] < 2.0 * FEED + 0.003
    # As far as it is fed it is the motion along all of the path.
    whole = motion_of_square(f"dual.standoff_m={standoff}")
    rows = round(1.0 / whole.spacing)
    times = np.arange(rows) * whole.spacing
    cut = np.interp(times, np.arange(len(motion.places)) * motion.spacing, motion.places)
    np.testing.assert_allclose(cut, whole.places[:rows], atol=2e-4)
