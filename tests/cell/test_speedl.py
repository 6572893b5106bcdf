"""The robot's velocity interface: acceleration, latency, timeout, joint limits, singularities."""

import numpy as np
import pytest

from polish_sim.cell import robot as interface
from polish_sim.config import RobotConfig, SafetyConfig
from polish_sim.motion import jacobian
from tests.cell.cells import joints_at, tool_pose

DT = 0.001
TIP = np.array([0.0, 0.0, 0.22])
ROBOT = RobotConfig()
AT_WORK = joints_at(tool_pose(0.0, -0.5, 0.1))
DEFAULT = interface.build_speedl(ROBOT, SafetyConfig(), DT, AT_WORK)


def robot_with(q=AT_WORK, **changes):
    """The default interface at joint positions [rad], some of its limits changed."""
    robot = interface.build_speedl(ROBOT, SafetyConfig(), DT, q)
    for name, value in changes.items():
        robot[name] = value
    return robot


def commanded(request, steps, robot=None, silent=10**9, again=10**9):
    """Twist commanded at every step, shape (steps, 6); the host is silent from one step until another."""
    robot, found = robot or robot_with(), []
    line = interface.build_request_line(robot)
    for n in range(steps):
        heard = n if n >= again else min(n, silent)
        interface.pass_request(robot, line, request(heard), heard + 1, DT)
        interface.limit_acceleration(robot, DT)
        found.append(robot.twist.copy())
    return np.array(found)


@pytest.mark.parametrize("latency_ms", [0, 1, 25])
def test_it_goes_straight_to_the_request_after_the_latency_in_the_least_time_and_stays(latency_ms):
    wanted = np.array([0.03, -0.04, 0.0, 0.0, 0.3, 0.0])
    found = commanded(lambda _n: wanted, 200, robot_with(latency=latency_ms))
    reached = np.minimum(ROBOT.linear_acceleration_m_s2 * DT * np.arange(1, 201 - latency_ms), 0.05)
    np.testing.assert_array_equal(found[:latency_ms], 0.0)
    np.testing.assert_allclose(found[latency_ms:, :3], np.outer(reached, wanted[:3] / 0.05), atol=1e-15)


def test_no_request_exceeds_the_acceleration_limits_and_a_silent_host_is_believed_for_the_timeout():
    wild = np.random.default_rng(0).normal(scale=[0.5, 0.5, 0.5, 3.0, 3.0, 3.0], size=(500, 6))
    steps = np.diff(commanded(lambda n: wild[n], 500), axis=0, prepend=0.0) / DT
    linear, angular = np.linalg.norm(steps[:, :3], axis=1), np.linalg.norm(steps[:, 3:], axis=1)
    assert linear.max() == pytest.approx(ROBOT.linear_acceleration_m_s2, rel=1e-9)
    assert angular.max() == pytest.approx(ROBOT.angular_acceleration_rad_s2, rel=1e-9)
    speed, silent, again = 0.06, 100, 300
    found = commanded(lambda _n: np.array([speed, 0, 0, 0, 0, 0.3]), 400, None, silent, again)
    braking = np.flatnonzero(found[:, 0] < speed * (1 - 1e-9))
    begins = int(braking[braking > silent][0])
    assert begins == pytest.approx(silent + DEFAULT.latency + ROBOT.command_timeout_s / DT, abs=1.5)
    needed = round(speed / (ROBOT.linear_acceleration_m_s2 * DT))
    assert found[begins + needed - 2, 0] > 0.0
    np.testing.assert_allclose(found[begins + needed : again], 0.0, atol=1e-15)
    assert found[-1, 0] == pytest.approx(speed)


def resolved(q, twist):
    """Joint speeds for a twist at a configuration, the smallest singular value known."""
    state, J, inside = robot_with(q), jacobian(q, TIP), True
    line = interface.build_request_line(state)
    for _ in range(200):
        interface.pass_request(state, line, twist, 1, DT)
        state.twist, state.joints = twist, q
        inside = interface.resolve_joints(state, J, DT)
    return state, inside


def test_away_from_singularities_joints_give_exactly_the_twist_and_too_fast_a_one_is_slowed_not_bent():
    rng = np.random.default_rng(0)
    for q in AT_WORK + 0.3 * rng.normal(size=(5, 6)):
        twist = 0.02 * rng.normal(size=6)
        state, inside = resolved(q, twist)
        assert inside
        np.testing.assert_allclose(jacobian(q, TIP) @ state.speeds, twist, atol=1e-8)
        np.testing.assert_allclose(state.joints, q + state.speeds * DT, atol=1e-15)
    twist = np.array([2.0, -3.0, 1.0, 1.0, 0.0, 2.0])
    state, _ = resolved(AT_WORK, twist)
    assert np.abs(state.speeds).max() == pytest.approx(ROBOT.joint_speed_limit_rad_s, rel=1e-12)
    reached = jacobian(AT_WORK, TIP) @ state.speeds
    share = reached @ twist / (twist @ twist)
    assert 0.0 < share < 1.0
    np.testing.assert_allclose(reached, share * twist, atol=1e-7)


def test_the_smallest_singular_value_is_known_along_the_way_and_near_none_joint_speeds_stay_bounded():
    state, exact = robot_with(), []
    line = interface.build_request_line(state)
    for n in range(2000):
        J = jacobian(AT_WORK + np.array([0.2, 0.3, -0.4, 0.3, 1.5, 0.5]) * n / 2000, TIP)
        interface.pass_request(state, line, np.zeros(6), 1, DT)
        interface.resolve_joints(state, J, DT)
        exact.append(np.linalg.svd(J, compute_uv=False)[-1])
        if n > 200:
            assert 0.99 * min(exact[-9:]) < state.weakest < 1.01 * max(exact[-9:])
    assert min(exact) < 0.2 * max(exact)
    # Damped by half the lack of singular value, an inverse never exceeds 41 times the twist.
    q, fastest = AT_WORK.copy(), []
    for q[4] in np.linspace(0.3, -0.3, 121):
        U, S, _ = np.linalg.svd(jacobian(q, TIP))
        state, _ = resolved(q, 0.01 * U[:, 5])
        fastest.append(np.linalg.norm(state.speeds) / 0.01)
        if S[5] > DEFAULT.damping_onset:
            assert fastest[-1] == pytest.approx(1.0 / S[5], rel=1e-4)
    assert max(fastest) < 41.0
    assert fastest[60] < 1.0
