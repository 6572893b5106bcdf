"""The served robot's motions, force mode and safety on the cell's physics, against their names."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.motion import forward, jacobian
from polish_sim.spatial import from_pose
from polish_sim.ur.kinematics import joint_speeds, pose_of, tool_at
from polish_sim.ur.physics import TICK_S, _lifted
from polish_sim.ur.robot import NORMAL, PROTECTIVE

DOWN = np.array([0, 0, 1, 0, 0, 0])
LIMITS = np.array([0.01, 0.01, 0.005, 0.1, 0.1, 0.1])


def go(robot, until, most_s=20.0):
    for tick in range(round(most_s / TICK_S)):
        if until():
            return tick * TICK_S
        robot.step()
        assert robot.safety == NORMAL, robot.stop_reason
    raise AssertionError(f"not within {most_s} s")


def watch(robot, see):
    """What is seen at every tick of a move."""
    seen = []
    go(robot, lambda: seen.append(see()) or robot.move_done())
    return seen


def stand(robot, seconds):
    for _ in range(round(seconds / TICK_S)):
        robot.step()


def moved(robot, *way):
    """The pose a way [m] from where the robot is sent."""
    return robot.target_tcp_pose + np.array([*way, 0.0, 0.0, 0.0])


def moving(*speed):
    return np.array([*speed, 0.0, 0.0, 0.0])


def press(robot, force=20.0, kind=2):
    robot.force_mode(robot.target_tcp_pose, DOWN, force * DOWN, kind, LIMITS)


def push(robot):
    return float(-robot.tcp_force[:3] @ Rotation.from_rotvec(robot.actual_tcp_pose[3:]).as_matrix()[:, 2])


def test_poses_and_jacobian_are_those_of_the_reference():
    rng = np.random.default_rng(500)
    odd = ([0.0, 0.0, 0.0], [1e-10, 0.0, 0.0], [0.0, 3.14159, 0.0], [-3.0, 0.4, 0.0])
    for turn in (*rng.normal(size=(50, 3)), *odd):
        T = from_pose(np.concatenate([rng.normal(size=3), turn]))
        assert from_pose(pose_of(T)) == pytest.approx(T, abs=1e-9)
        assert np.linalg.norm(pose_of(T)[3:]) <= np.pi + 1e-9
        q = rng.uniform(-3.0, 3.0, 6)
        at, J = tool_at(q, T)
        assert at == pytest.approx(forward(q) @ T, abs=1e-12)
        assert pytest.approx(jacobian(q, T[:3, 3]), abs=1e-12) == J
        if np.linalg.svd(J, compute_uv=False)[-1] > 0.03:
            twist = rng.normal(size=6)
            assert J @ joint_speeds(J, twist) == pytest.approx(twist, abs=1e-6)


def test_a_line_is_straight_and_as_quick_as_asked(robot):
    first = robot.target_tcp_pose.copy()
    goal = moved(robot, 0.06, 0.08, 0.02)
    robot.movel(goal, 0.5, 0.05, 0.0, 0.0)
    way = (goal - first)[:3]
    length = float(np.linalg.norm(way))
    places = watch(robot, lambda: robot.target_tcp_pose[:3].copy())
    off = np.cross(np.array(places) - first[:3], way / length)
    assert TICK_S * (len(places) - 1) == pytest.approx(length / 0.05 + 0.05 / 0.5, abs=0.01)
    assert np.linalg.norm(off, axis=1).max() < 1e-6
    stand(robot, 0.5)
    assert robot.steady()
    assert robot.actual_tcp_pose[:3] == pytest.approx(goal[:3], abs=5e-4)


def test_streamed_goals_act_after_the_arm_s_latency_and_a_stop_is_waited_for(robot):
    late = round(robot.cell.scenario.robot.command_latency_s / TICK_S)
    robot.speedl(moving(0.0, 0.0, 0.02), 0.5)
    speeds = []
    for _ in range(late + 60):
        robot.step()
        speeds.append(float(robot.target_tcp_speed[2]))
    assert late == 3
    assert np.flatnonzero(np.array(speeds) > 1e-9)[0] == late
    assert speeds[-1] == pytest.approx(0.02, abs=1e-6)
    robot.stopl(0.5)
    assert not robot.move_done()
    assert go(robot, robot.move_done) == pytest.approx(0.02 / 0.5 + late * TICK_S, abs=2.1 * TICK_S)
    assert np.abs(robot.target_qd).max() < 1e-6
    robot.movel(moved(robot, 0.0, 0.05, 0.0), 0.5, 0.05, 0.0, 0.0)
    stand(robot, 0.3)
    before = robot.target_qd.copy()
    robot.speedj(before, 1.0)  # continues as it was until the goal acts
    stand(robot, 0.05)
    assert robot.target_qd == pytest.approx(before, abs=0.02)


def test_the_speed_slider_stretches_a_move_and_a_blend_goes_by_its_corner(robot):
    first = robot.target_tcp_pose.copy()
    corner, goal = moved(robot, 0.05, 0.0, 0.0), moved(robot, 0.05, 0.05, 0.0)
    robot.set_speed_fraction(0.5)
    robot.movel(corner, 0.5, 0.05, 0.0, 0.0)
    assert go(robot, robot.move_done) == pytest.approx(2.0 * (0.05 / 0.05 + 0.05 / 0.5), abs=0.02)
    robot.set_speed_fraction(1.0)
    robot.movel(first, 0.5, 0.05, 0.0, 0.0)
    go(robot, robot.move_done)
    near = []
    for end, blend in ((corner, 0.01), (goal, 0.0)):
        robot.movel(end, 0.5, 0.05, 0.0, blend)
        near += watch(robot, lambda: np.linalg.norm(robot.target_tcp_pose[:3] - corner[:3]))
    assert 1e-4 < min(near) < 0.01
    assert robot.target_tcp_pose[:3] == pytest.approx(goal[:3], abs=1e-6)


@pytest.mark.parametrize("kind", [2, 3])
def test_force_mode_holds_a_force_that_the_joints_feel_by_its_lever(robot, kind):
    stand(robot, 0.5)
    robot.zero_ftsensor()
    press(robot, 40.0, kind)
    go(robot, lambda: push(robot) > 38.0)
    stand(robot, 2.0)
    held, torques = [], []
    for _ in range(250):
        robot.step()
        held.append(float(robot.cell.state.wrench[2]))
        torques.append(robot.free_torques.copy())
    assert np.mean(held) == pytest.approx(40.0, abs=1.0)
    assert np.ptp(held) < 4.0
    felt, arm = np.mean(torques, axis=0), robot.cell.real_arm
    assert np.abs(felt).max() > 20.0
    for _ in range(2):  # about the tool, and about another tool point
        by_lever = tool_at(robot.actual_q, from_pose(robot.tcp_offset))[1].T @ robot.tcp_force
        assert np.all(np.abs(felt + by_lever) < arm.coulomb + 1.0)  # at rest friction is not known
        robot.set_tcp(robot.tcp_offset + [0.1, 0.2, 0.3, 0.0, 0.0, 0.0])
        robot.step()
    robot.end_force_mode()
    stand(robot, 0.5)
    assert robot.compliance is None
    assert np.abs(robot.target_qd).max() < 1e-9


def test_force_mode_in_free_air_keeps_its_speed_limit_and_the_other_axes(robot):
    robot.zero_ftsensor()
    first = robot.actual_tcp_pose.copy()
    robot.force_mode(np.zeros(6), DOWN, 10.0 * DOWN, 2, LIMITS)
    stand(robot, 2.0)
    way = robot.actual_tcp_pose - first
    assert 0.001 < way[2] <= 0.005 * 2.0 + 1e-3
    assert np.abs(way[[0, 1]]).max() < 1e-3
    assert abs(robot.actual_tcp_speed[2]) < 0.0055


def test_a_stop_asked_for_or_at_the_end_of_a_joint_s_range_or_for_a_far_servo_goal_holds_the_arm(robot):
    robot.movel(moved(robot, 0.0, 0.1, 0.0), 0.5, 0.1, 0.0, 0.0)
    stand(robot, 0.3)
    robot.protective_stop()
    stand(robot, 0.5)
    stood = robot.actual_tcp_pose.copy()
    stand(robot, 0.2)
    assert robot.safety == PROTECTIVE
    assert robot.actual_tcp_pose == pytest.approx(stood, abs=1e-3)
    robot.unlock()
    robot.movel(moved(robot, 0.0, 0.01, 0.0), 0.5, 0.1, 0.0, 0.0)
    go(robot, robot.move_done)
    robot.speedj(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 3.0]), 20.0)
    stand(robot, 2.5)
    assert (robot.safety, "end of its range" in robot.stop_reason) == (PROTECTIVE, True)
    robot.unlock()
    stood = robot.actual_q.copy()
    robot.servoj(robot.target_q - 1.5, lookahead_time=0.03)
    stand(robot, 0.1)
    assert (robot.safety, "too fast" in robot.stop_reason) == (PROTECTIVE, True)
    assert robot.actual_q == pytest.approx(stood, abs=1e-3)  # what is too fast is not followed


def test_an_arm_that_hit_the_part_may_leave_it_unlocked_and_is_watched_again(robot):
    place = robot.cell.state.motion.place
    place[2] += 0.06  # the part is around the tool's shaft
    stand(robot, 0.1)
    assert robot.safety == PROTECTIVE
    robot.unlock()
    stand(robot, 0.2)
    assert robot.safety == NORMAL
    place[2] -= 0.06
    stand(robot, 0.2)
    place[2] += 0.06
    stand(robot, 0.1)
    assert robot.safety == PROTECTIVE


def test_joints_feel_nothing_in_free_air_and_no_torque_beyond_gravity_lets_the_arm_stand(robot):
    stand(robot, 0.5)
    weight = robot.joint_torques.copy()
    assert np.abs(weight).max() > 30.0
    assert np.abs(robot.free_torques).max() < 1.0
    robot.movej(robot.target_q + [0.3, -0.2, 0.2, 0.3, 0.0, 0.5], 1.0, 0.5, 0.0, 0.0)
    stand(robot, 0.4)
    assert np.abs(robot.actual_qd).max() > 0.3
    assert np.abs(robot.free_torques).max() < 0.2 * np.abs(robot.joint_torques).max()
    go(robot, robot.move_done)
    stand(robot, 0.5)
    first = robot.actual_q.copy()
    for _ in range(250):
        robot.direct_torque(np.zeros(6), False, None, None)
        robot.step()
    assert np.abs(robot.actual_q - first).max() < 0.01
    for _ in range(250):
        robot.direct_torque(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 6.0]), True, None, None)
        robot.step()
    assert robot.actual_qd[5] > 0.2
    assert np.abs(robot.actual_q - first)[:5].max() < 0.02
    robot.movej(robot.target_q, 1.0, 0.5, 0.0, 0.0)
    stand(robot, 0.2)
    assert robot.safety == NORMAL


def test_a_contact_is_seen_from_its_direction_until_force_stops_the_arm(robot):
    stand(robot, 0.5)
    robot.zero_ftsensor()
    down, any_way, aside = np.array([0.0, 0.0, -1.0]), np.zeros(3), np.array([1.0, 0.0, 0.0])
    robot.speedl(moving(0.0, 0.0, -0.02), 0.5)
    go(robot, lambda: float(robot.cell.state.wrench[2]) > 0.5)
    q, begun = robot.actual_q.copy(), robot.ticks
    assert robot.tool_contact(down) == robot.tool_contact(any_way) == 0
    go(robot, lambda: robot.tool_contact(down) > 0)
    assert robot.ticks - begun > 15  # 0.6 mm at 20 mm/s
    back = robot.tool_contact(down)
    height, before = (tool_at(each, np.eye(4))[0][2, 3] for each in (q, robot.q_history(back)))
    assert before == pytest.approx(height, abs=4e-4)
    stand(robot, 0.06)
    assert robot.tool_contact(down) == back + 30
    assert robot.tool_contact(any_way) >= back + 30
    assert robot.tool_contact(-down) == robot.tool_contact(aside) == 0
    while robot.safety == NORMAL and robot.ticks - begun < 5000:
        robot.step()
    assert (robot.safety, "force" in robot.stop_reason) == (PROTECTIVE, True)
    assert float(robot.cell.state.wrench[2]) < 90.0
    robot.unlock()  # it may leave
    robot.speedl(moving(0.0, 0.0, 0.02), 0.5)
    stand(robot, 0.5)
    assert (robot.safety, robot.rig.near_limit()) == (NORMAL, False)


def test_a_client_s_sensor_is_what_force_mode_feels(robot):
    stand(robot, 0.5)
    assert robot.steady()
    robot.ft_input(True)
    robot.external = np.array([0.0, 0.0, 12.0, 0.0, 0.0, 0.0])
    stand(robot, 0.01)
    assert robot.tcp_force.tolist() == [0.0, 0.0, 12.0, 0.0, 0.0, 0.0]
    robot.force_mode(np.zeros(6), DOWN, -12.0 * DOWN, 2, LIMITS)
    stand(robot, 1.0)
    assert robot.actual_tcp_speed[2] == pytest.approx(0.0, abs=1e-3)  # as much as is asked for
    assert not robot.steady()
    first = robot.actual_tcp_pose[2]
    robot.external[2] = 20.0
    stand(robot, 1.0)
    assert robot.actual_tcp_pose[2] > first + 0.002  # pushed up by 8 N more
    robot.ft_input(False)
    robot.end_force_mode()
    stand(robot, 0.5)
    assert robot.steady()


def test_a_long_gap_is_a_lift_and_a_short_one_lost_contact():
    touching = np.concatenate([np.arange(0.0, 1.0, 0.1), np.arange(1.5, 2.0, 0.1), np.arange(4.0, 5.0, 0.1)])
    seated = np.array([0.5, 0.9, 1.6, 1.9, 4.5, 4.6])
    assert _lifted(seated, touching).tolist() == [False, False, False, True, False]


def test_coriolis_torques_are_those_of_the_mass_matrix_and_inverse_kinematics_give_the_pose_back(robot):
    rng = np.random.default_rng(500)
    q, qd, h = robot.actual_q, rng.uniform(-1.0, 1.0, 6), 1e-5

    def slope(way):
        ahead, behind = (robot.mass_matrix(q + step * way, False) for step in (h, -h))
        return np.asarray((ahead - behind) / (2.0 * h))

    # From Lagrange: c = dM/dt qd - 1/2 d(qd' M qd)/dq.
    known = slope(qd) @ qd - 0.5 * np.array([qd @ slope(way) @ qd for way in np.eye(6)])
    assert robot.coriolis(q, qd) == pytest.approx(known, abs=1e-5)
    assert np.abs(known).max() > 0.05
    assert robot.coriolis(q, np.zeros(6)) == pytest.approx(np.zeros(6), abs=1e-12)
    q = robot.inverse_kin(robot.actual_tcp_pose, robot.actual_q, tcp=robot.tcp_offset)
    assert q == pytest.approx(robot.actual_q, abs=1e-9)
    assert robot.inverse_kin(np.array([3.0, 0, 0, 0, 0, 0]), robot.actual_q, tcp=robot.tcp_offset) is None


def test_a_register_of_integers_holds_32_bits(robot):
    with pytest.raises(ValueError, match="32-bit"):
        robot.write("output_int_register", 0, 1e10)
