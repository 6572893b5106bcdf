"""The wrist sensor's errors one by one, the spindle it feels; the robot's velocity interface."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from polish_sim.cell import robot as interface
from polish_sim.cell import wrist_sensor
from polish_sim.cell.contact import RUN_DOWN_S, build_spindle, pull_of_imbalance, turn_spindle
from polish_sim.config import RobotConfig, SafetyConfig, SensorConfig, SpindleConfig
from polish_sim.config.cell import SENSOR_MODELS
from polish_sim.experiments import default_scenario
from polish_sim.motion import jacobian
from polish_sim.scenario_file import override
from tests.cell.cells import joints_at, on_plane, stopped_at, tool_pose

DT = 0.001
PERFECT = SensorConfig(
    force_noise_n=0.0, torque_noise_nm=0.0, force_bias_n=0.0, torque_bias_nm=0.0, force_drift_n_s=0.0,
    torque_drift_nm_s=0.0, bandwidth_hz=0.0, latency_s=0.001, force_quantum_n=0.0, torque_quantum_nm=0.0,
)  # fmt: skip
LOAD = np.array([3.0, -4.0, 25.0, 0.1, -0.2, 0.03])
WARM_UP = {"warm_up_force_n": 6.5, "warm_up_torque_nm": 0.06, "warm_up_s": 0.02}


def readings(config, exact, seconds, seed=0, dt=DT):
    """What the host reads at every step of an exact wrench ``exact(t)``, shape (n, 6)."""
    rng, found = np.random.default_rng(seed), []
    sensor = wrist_sensor.build_sensor(config, rng)
    line = wrist_sensor.build_sample_line(sensor)
    for n in range(round(seconds / dt)):
        wrist_sensor.sample_sensor(sensor, line, n * dt, exact(n * dt), rng.standard_normal(12))
        found.append(sensor.reading.copy())
    return np.array(found)


def steady(_t):
    return LOAD


def moving(t):
    return LOAD + 0.1 * math.sin(40.0 * t)


@pytest.mark.parametrize("latency_ms", [1, 2, 20])
def test_without_errors_the_reading_is_the_exact_wrench_late_by_whole_samples(latency_ms):
    """One of them is the engine's: the wrench handed in is that of the step before."""
    found = readings(replace(PERFECT, latency_s=latency_ms * 1e-3), moving, 0.2)
    late = latency_ms - 1
    np.testing.assert_array_equal(found[late:], [moving(n * DT) for n in range(len(found) - late)])
    slow = readings(replace(PERFECT, rate_hz=20.0), moving, 0.2)
    np.testing.assert_array_equal(slow, [moving(n // 50 * 50 * DT) for n in range(len(slow))])


@pytest.mark.parametrize(
    ("config", "force", "torque", "share"),
    [
        (replace(PERFECT, force_bias_n=3.0, torque_bias_nm=0.1), 3.0, 0.1, np.ones_like),
        (replace(PERFECT, **WARM_UP), 6.5, 0.06, lambda t: 1.0 - np.exp(-t / 0.02)),
    ],
    ids=["bias", "warm-up"],
)
def test_bias_and_drift_of_a_cold_sensor_are_seeded_and_within_their_size(config, force, torque, share):
    grown, sizes = share(DT * np.arange(1, 51)), []
    for seed in range(40):
        found = readings(config, steady, 0.05, seed) - LOAD
        sizes.append(found[-1] / grown[-1])
        np.testing.assert_allclose(found, np.outer(grown, sizes[-1]), atol=1e-12)
    forces, torques = np.array(sizes)[:, :3], np.array(sizes)[:, 3:]
    assert 0.94 * force < np.abs(forces).max() <= force
    assert 0.94 * torque < np.abs(torques).max() <= torque
    assert forces.std() == pytest.approx(force / math.sqrt(3.0), rel=0.15)
    np.testing.assert_array_equal(readings(config, steady, 0.05, 5)[-1] - LOAD, sizes[5] * grown[-1])


def test_a_drift_walks_at_random_and_readings_are_whole_quanta_within_the_range():
    config = replace(PERFECT, force_drift_n_s=0.2, torque_drift_nm_s=0.01, rate_hz=100.0, latency_s=0.01)
    walks = [readings(config, steady, 4.0, seed, dt=0.01)[[99, 399]] - LOAD for seed in range(50)]
    for axes, size in ((slice(0, 3), 0.2), (slice(3, 6), 0.01)):
        at_1s, at_4s = np.std(np.array(walks)[..., axes], axis=(0, 2))
        assert at_1s == pytest.approx(size, rel=0.2)
        assert at_4s == pytest.approx(2.0 * size, rel=0.2)
    found = readings(replace(PERFECT, force_quantum_n=0.05, torque_quantum_nm=0.002), moving, 0.5)
    exact = np.array([moving(n * DT) for n in range(len(found))])
    quanta = np.repeat([0.05, 0.002], 3)
    np.testing.assert_allclose(found, quanta * np.round(exact / quanta), atol=1e-9)
    narrow = replace(PERFECT, force_range_n=20.0, torque_range_nm=0.15)
    for sign in (1.0, -1.0):
        last = readings(narrow, lambda _t, sign=sign: sign * LOAD, 0.01)[-1]
        np.testing.assert_allclose(last, sign * np.array([3.0, -4.0, 20.0, 0.1, -0.15, 0.03]))


def pull_of(spindle):
    """On an upright head [N]."""
    force = np.zeros(3)
    pull_of_imbalance(spindle, np.eye(3), force)
    return force


def pulls(config, steps):
    spindle, found = build_spindle(config), []
    for _ in range(steps):
        turn_spindle(spindle, DT)
        found.append(pull_of(spindle))
    return np.array(found)


def test_g63_at_6000_per_minute_pulls_1_2_newton_once_round_in_10_ms_and_less_when_it_runs_down():
    g63 = 0.3 * 0.0063 * 2.0 * math.pi * 100.0  # m e omega^2 of 0.3 kg at G6.3 and 6000 1/min [N]
    found = pulls(SpindleConfig(), 200)
    assert pytest.approx(1.19, abs=0.005) == g63
    for silent in (SpindleConfig(speed_rpm=0.0), SpindleConfig(imbalance_m_s=0.0)):
        np.testing.assert_array_equal(pulls(silent, 20), 0.0)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), g63, rtol=1e-12)
    np.testing.assert_allclose(found[10:], found[:-10], atol=1e-12)
    np.testing.assert_allclose(found[5:], -found[:-5], atol=1e-12)
    np.testing.assert_array_equal(found[:, 2], 0.0)
    spindle = build_spindle(SpindleConfig())
    spindle.failed = True
    for speed in (0.5, 0.0):
        for _ in range(round(0.5 * RUN_DOWN_S / DT)):
            turn_spindle(spindle, DT)
        assert spindle.speed == pytest.approx(speed * spindle.commanded, abs=1e-9)
        assert np.linalg.norm(pull_of(spindle)) == pytest.approx(speed**2 * g63, abs=1e-9)


@pytest.mark.parametrize("model", ["ur5e-built-in", "axia80", "hex-125hz"])
def test_a_named_sensor_at_rest_has_its_noise_quantum_and_rate(model):
    no_offset = [
        "sensor.force_bias_n=0", "sensor.torque_bias_nm=0", "sensor.force_drift_n_s=0",
        "sensor.torque_drift_nm_s=0", "sensor.warm_up_force_n=0", "sensor.warm_up_torque_nm=0",
        "sensor.cross_talk=0",
    ]  # fmt: skip
    config = override(default_scenario("force"), [f"sensor.model={model}", *no_offset]).sensor
    shown = dict(SENSOR_MODELS[model])
    sizes = ([shown[f"force_{name}_n"], shown[f"torque_{name}_nm"]] for name in ("noise", "quantum", "range"))
    noise, quanta, full = np.repeat([*sizes], 3, axis=1)
    found, cut = readings(config, steady, 20.0), shown["bandwidth_hz"] or math.inf
    blend = 1.0 - math.exp(-2.0 * math.pi * cut / shown["rate_hz"])
    left = math.sqrt(blend / (2.0 - blend))
    np.testing.assert_allclose((found[2000:] - LOAD).std(axis=0), left * noise, rtol=0.04)
    if model == "hex-125hz":
        assert left * noise[2] == pytest.approx(0.15, rel=0.04)  # behind its filter, by the data sheet
    new = np.any(np.diff(found, axis=0) != 0.0, axis=1)
    assert new.mean() * 1000.0 == pytest.approx(shown["rate_hz"], rel=0.01)
    if quanta[0] > 0.0 and blend == 1.0:
        np.testing.assert_allclose(found / quanta, np.round(found / quanta), atol=1e-6)
    np.testing.assert_allclose(readings(config, lambda _t: 3.0 * full, 1.0)[-1], full, rtol=0.01)


def test_a_warm_up_leaves_bias_and_noise_as_they_were_and_cross_talk_is_in_shares_of_the_ranges():
    config, rng = replace(PERFECT, warm_up_force_n=6.5, warm_up_s=10.0), np.random.default_rng(1)
    sensor = wrist_sensor.build_sensor(config, rng)
    wrist_sensor.read_at_rest(sensor, LOAD[None], np.array([4.0]), 0.5, 0.5, rng)
    assert sensor.warmth == pytest.approx(1.0 - math.exp(-5.0 / 10.0))
    plain = replace(PERFECT, force_bias_n=3.0, force_noise_n=0.5)
    warming = readings(replace(plain, warm_up_force_n=1.0, warm_up_s=1.0), steady, 1.0)
    off = warming - readings(plain, steady, 1.0)
    warmth = (1.0 - np.exp(-DT * np.arange(1, 1001))) / (1.0 - math.exp(-1.0))
    np.testing.assert_allclose(off, np.outer(warmth, off[-1]), atol=1e-9)
    assert np.abs(off[-1, :3]).min() > 0.0
    config = replace(PERFECT, cross_talk=0.02, force_range_n=200.0, torque_range_nm=10.0)
    tenth, draws = np.repeat([20.0, 1.0], 3), product(range(40), range(6))
    found = [readings(config, lambda _t, k=k: np.diag(tenth)[k], 0.002, seed)[-1] for seed, k in draws]
    found = np.reshape(found, (40, 6, 6)) / tenth
    np.testing.assert_allclose(np.diagonal(found, axis1=1, axis2=2), 1.0, rtol=1e-12)
    others = found[:, ~np.eye(6, dtype=bool)]
    assert others.std() == pytest.approx(0.02, rel=0.05)
    assert abs(others.mean()) < 0.002


def pressed_hard(*settings):
    """45 N pressed with a tool of 19.6 N hanging on the sensor: 25.4 N on it, beyond a range of 22 N."""
    small = "sensor.model=ur5e-built-in", "sensor.force_range_n=22"
    return on_plane(*small, "safety.force_limit_n=80", "pad.friction=0.1", *settings, wanted=45.0).run()


def test_an_overloaded_sensor_stops_the_robot_without_its_report_the_force_runs_away():
    run = pressed_hard("sensor.rate_hz=1000")
    assert "wrist sensor overloaded" in str(run.stop_reason)
    stopped = stopped_at(run)
    load = run.log["wrench_raw_sensor"][stopped - 2 : stopped + 1].astype(float)
    shares = [wrist_sensor.share_of_range(np.repeat([22.0, 10.0], 3), row) for row in load]
    assert [share > 1.0 for share in shares] == [False, True, True]  # the sensor's sample is a step old
    assert run.safety.protective_stop_measured in {f"{100.0 * share:.0f}% of the range" for share in shares}
    run = pressed_hard("sensor.overload=0")
    assert "the surface has fallen away" in str(run.stop_reason)
    assert run.trace.normal_force_n.max() > 50.0
    assert run.log["wrench_measured_tool"][1000:, 2].max() < 22.0 + 2.0 * wrist_sensor.GRAVITY + 0.1
    # ATI, EtherCAT Axia manual, table 5.9, with 500 N along the axis, too.
    full, load = np.repeat([500.0, 20.0], 3), np.array([87.5, -151.6, -500.0, 1.0, 2.0, -17.5])
    assert wrist_sensor.share_of_range(full, load) == pytest.approx(0.350 + 0.875, abs=1e-3)
    load[:2] = load[5] = 0.0
    assert wrist_sensor.share_of_range(full, load) == pytest.approx(1.0 + math.hypot(1.0, 2.0) / 20.0)


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
        interface.limit_acceleration(robot, DT, 1.0)
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
