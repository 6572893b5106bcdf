"""The loops against their closed forms, and which axis answers to what; force-mode beside hybrid-pi."""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.control import CONTROLLERS, loops
from tests.control import signals

STIFFNESS = 5000.0  # of head and pad in series [N/m]
FORCE = 20.0  # [N]


def test_ten_seconds_in_the_air_do_not_wind_the_integral_up_and_a_loaded_one_unwinds_at_the_limit():
    gains, state = loops.PiGains(0.004, 0.012, 0.05, 1e9), loops.PiMemory()
    for _ in range(10_000):
        assert loops.force_pi(FORCE, 0.0, 1e9, gains, 0.001, state) == gains.limit
    assert state.integral == 0.0
    state = loops.PiMemory(20.0)
    assert loops.force_pi(FORCE, FORCE + 5.0, 1e9, gains, 0.001, state) == gains.limit
    assert state.integral == pytest.approx(20.0 - 5.0 * 0.001)


@pytest.mark.parametrize(("dt", "corner_hz"), [(1e-4, 80.0), (0.02, 1.0)])
def test_the_low_pass_answers_a_step_exactly_and_starts_at_the_first_reading(dt, corner_hz):
    first = loops.force_pi(FORCE, 18.0, 1e9, loops.PiGains(0.004, 0.0, 1.0, corner_hz), dt, loops.PiMemory())
    assert first == pytest.approx(0.004 * 2.0)
    output = 0.0
    for n in range(1, 200):
        output = loops.low_pass_step(output, 1.0, corner_hz, dt)
        assert output == pytest.approx(1.0 - math.exp(-2.0 * math.pi * corner_hz * n * dt), abs=1e-12)
    assert np.isfinite(loops.low_pass_step(0.0, 1.0, 1e9, 1.0))


def felt(stiffness, tool=0.02, part=0.0, state=None):
    """Shares of the gains while tool and part come together at these speeds [m/s], to 1.2 times the force."""
    state = loops.FeltMemory() if state is None else state
    shares, force, measured, dt = [], 0.0, 0.0, 0.001
    while force < 1.2 * FORCE:
        force += stiffness * (tool + part) * dt
        measured = loops.low_pass_step(measured, force, 5.0, dt)
        shares.append(loops.felt_share(FORCE, measured, tool, 1.5 * STIFFNESS, 5.0, dt, state))
    return np.array(shares)


@pytest.mark.parametrize("times", [0.2, 1.4, 2.0, 8.0])
def test_on_stiffer_springs_the_gains_fall_to_one_and_a_half_times_the_drawn_crossover(times):
    shares = felt(times * STIFFNESS, tool=0.005 if times > 1.5 else 0.02)
    assert shares[0] == 1.0
    if times > 1.5:
        assert shares[-1] * times == pytest.approx(1.5, rel=0.02)
    else:
        assert (shares == 1.0).all()


def test_a_part_that_comes_towards_a_tool_at_rest_leaves_the_least_share_and_after_landing_all():
    assert felt(STIFFNESS, tool=0.0, part=0.02)[-1] == loops.LEAST_SHARE
    state = loops.FeltMemory()
    felt(STIFFNESS, state=state)
    while not state.landed:
        loops.felt_share(FORCE, 1.01 * FORCE, 0.0, 1.5 * STIFFNESS, 5.0, 0.001, state)
    assert loops.felt_share(FORCE, 1.5 * FORCE, 0.0, 1.5 * STIFFNESS, 5.0, 0.001, state) == 1.0


def test_equations_6_and_7_add_the_pid_of_the_velocity_error():
    gains, dt = loops.VelocityGains(0.1, p=0.2, d=0.01, i=0.5), 0.001
    state, out = loops.VelocityMemory(), np.zeros(3)
    wanted, *actual = np.random.default_rng(3).normal(size=(3, 3))
    one, two = (wanted - velocity for velocity in actual)
    loops.velocity_pid(wanted, actual[0], gains, dt, state, out)
    np.testing.assert_allclose(out, wanted + 0.2 * one + 0.5 * one * dt, rtol=1e-12)
    loops.velocity_pid(wanted, actual[1], gains, dt, state, out)
    derivative = np.array([loops.low_pass_step(0.0, rate, 10.0, dt) for rate in (two - one) / dt])
    expected = wanted + 0.2 * two + 0.5 * (one + two) * dt + 0.01 * derivative
    np.testing.assert_allclose(out, expected, rtol=1e-12)


def error_between(R_actual, R_wanted):
    out = np.zeros(3)
    loops.rotation_error(np.ascontiguousarray(R_actual), np.ascontiguousarray(R_wanted), out)
    return out


def random_axes(n, seed=0):
    axes = np.random.default_rng(seed).normal(size=(n, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def test_rotation_errors_turn_frames_and_axes_the_short_way_and_bring_any_two_frames_together():
    frames, axes, worst = Rotation.random(50, random_state=0).as_matrix(), random_axes(50), []
    for angle in (0.2, 0.1):
        turned = Rotation.from_rotvec(angle * axes).as_matrix() @ frames
        found = np.array([error_between(*pair) for pair in zip(frames, turned, strict=True)])
        worst.append(np.linalg.norm(found - angle * axes, axis=1).max())
    assert worst[1] < 0.1**3
    assert worst[0] / worst[1] == pytest.approx(8.0, rel=0.1)
    R = Rotation.random(random_state=4).as_matrix()
    for turn in np.outer([1e-9, 0.3, 3.1], R.T).reshape(-1, 3):
        found = error_between(R, Rotation.from_rotvec(turn).as_matrix() @ R)
        np.testing.assert_allclose(found, turn, rtol=1e-6, atol=1e-15)
    for first, second in zip(random_axes(50), random_axes(50, seed=1), strict=True):
        spare, out, half = np.cross(first, second), np.zeros(3), np.zeros(3)
        loops.add_axis_rotation(first, second, np.zeros(3), out)
        np.testing.assert_allclose(Rotation.from_rotvec(out).apply(first), second, atol=1e-12)
        assert np.linalg.norm(out) == pytest.approx(math.acos(first @ second), abs=1e-7)
        loops.add_axis_rotation(first, -first, spare / np.linalg.norm(spare), half)
        assert np.linalg.norm(half) == pytest.approx(math.pi)
        assert abs(half @ first) < 1e-12
        np.testing.assert_allclose(Rotation.from_rotvec(half).apply(first), -first, atol=1e-12)
    half_turns = [Rotation.from_rotvec(math.pi * axis).as_matrix() for axis in [*np.eye(3), *random_axes(5)]]
    for R in (*Rotation.random(20, random_state=2).as_matrix(), *half_turns):
        for _ in range(600):
            R = Rotation.from_rotvec(0.1 * error_between(R, np.eye(3))).as_matrix() @ R
        assert Rotation.from_matrix(R).magnitude() < 1e-6


def drawn(seed, contact=1.0):
    """A random measurement and a target near it."""
    rng = np.random.default_rng(seed)
    m = signals.measurement_from(rng)
    return m, signals.target_near(m, rng, contact)


def in_tool(m, twist):
    """Linear and angular part of a twist in tool axes."""
    return m.rotation.T @ twist[:3], m.rotation.T @ twist[3:6]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("hybrid", "law"), [("hybrid-pi", 6), ("hybrid-pi-position", 5)])
def test_in_contact_force_replaces_z_and_nothing_else_of_the_velocity(seed, hybrid, law):
    (m, t), config = drawn(seed), signals.CONFIG
    linear, _ = in_tool(m, signals.controller(hybrid).step(m, t))
    error, feed, speed = t.position - m.position, t.twist[:3], m.twist[:3]
    wanted = feed + error / config.look_ahead_s
    by_law = {
        6: wanted + config.position_p * (wanted - speed),
        5: feed + config.position_rate_p * error + config.position_rate_d * (feed - speed),
    }[law]
    np.testing.assert_allclose(linear[:2], (m.rotation.T @ by_law)[:2], atol=1e-12)
    force_error = 20.0 - m.wrench[2]
    rate = config.force_p_m_sn * force_error + config.force_i_m_s2n * force_error * 0.001
    # No faster than it can stop gently on springs four times as stiff as drawn before they press with 25 N:
    # readings are up to 4 ms late behind a low-pass of 80 Hz, motions 10 ms, and a cycle lasts 1 ms.
    unseen = (0.004 + 0.5 / (math.pi * 80.0) + 0.01 + 0.001) * max(float(m.rotation[:, 2] @ speed), 0.0)
    room = (25.0 - m.wrench[2]) / (4.0 * 5000.0) - unseen
    highest = math.sqrt(2.0 * 0.25 * 0.8 * 1.2 * max(room, 0.0))
    limited = min(max(rate, -config.force_limit_m_s), config.force_limit_m_s, highest)
    assert linear[2] == pytest.approx(limited, abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_in_contact_the_moment_replaces_the_turn_about_y_and_nothing_else(seed):
    m, t = drawn(seed)
    t.rotation[:] = Rotation.from_rotvec([0.003, -0.002, 0.004]).as_matrix() @ m.rotation
    _, angular = in_tool(m, signals.controller("hybrid-pi").step(m, t))
    _, free = in_tool(m, signals.controller("position").step(m, t))
    np.testing.assert_allclose(angular[[0, 2]], free[[0, 2]], atol=1e-12)
    planned = float(m.rotation[:, 1] @ t.twist[3:])
    rate = -(signals.CONFIG.moment_p_rad_snm + signals.CONFIG.moment_i_rad_s2nm * 0.001) * float(m.wrench[4])
    limited = min(max(rate, -signals.CONFIG.moment_limit_rad_s), signals.CONFIG.moment_limit_rad_s)
    assert angular[1] == pytest.approx(planned + limited, abs=1e-12)


def test_in_free_space_the_hybrid_is_the_position_law_and_force_mode_differs_along_tool_z_alone():
    m, t = drawn(0, contact=0.0)
    hybrid, position = (signals.controller(name).step(m, t) for name in ("hybrid-pi", "position"))
    np.testing.assert_array_equal(hybrid, position)
    m, t = drawn(0)
    quiet = signals.controller("position").step(m, t)
    m.wrench[:] += 100.0
    np.testing.assert_array_equal(signals.controller("position").step(m, t), quiet)
    for contact in (0.0, 1.0):
        m, t = drawn(0, contact)
        ours, hybrid = (signals.controller(name).step(m, t) for name in ("force-mode", "hybrid-pi"))
        across = np.eye(3) - np.outer(m.rotation[:, 2], m.rotation[:, 2]) * contact
        np.testing.assert_allclose(across @ ours[:3], across @ hybrid[:3], atol=1e-12)
        np.testing.assert_array_equal(ours[3:], hybrid[3:])


def leaning(made, steps, moment):
    """Angles about tool y [rad] of a tool at rest in contact that turns as commanded under a moment [N m]."""
    m, t, angles = signals.measurement_at_rest(), signals.target_to_press(contact=1.0), [0.0]
    for _ in range(steps):
        m.rotation[:] = Rotation.from_rotvec([0.0, angles[-1], 0.0]).as_matrix()
        m.wrench[4] = moment(angles[-1])
        angles.append(angles[-1] + signals.DT * made.step(m, t)[4])
    return angles


@pytest.mark.parametrize(("p", "i"), [(0.1, 0.0), (0.2, 0.5)])
def test_the_moment_loop_levels_a_pad_as_its_second_order_response_and_never_beyond_its_limit(p, i):
    """With moment k (angle - lean): e'' + k p e' + k i e = 0 from e = lean, e' = -k p lean."""
    stiffness, lean = 3.0, -0.01
    gains = {"moment_p_rad_snm": p, "moment_i_rad_s2nm": i, "moment_filter_hz": 1e9}
    made = signals.controller("hybrid-pi", replace(signals.CONFIG, **gains))
    angles = leaning(made, 5000, lambda angle: stiffness * (angle - lean))
    root = cmath.sqrt((stiffness * p) ** 2 - 4.0 * stiffness * i)
    r1, r2 = 0.5 * (-stiffness * p + root), 0.5 * (-stiffness * p - root)
    time = signals.DT * np.arange(len(angles))
    error = lean * ((r1 * np.exp(r1 * time) - r2 * np.exp(r2 * time)) / (r1 - r2)).real
    np.testing.assert_allclose(angles, lean - error, atol=0.005 * abs(lean))
    # A moment no tilt relieves: the pad hangs over an edge.
    angles = leaning(signals.controller("hybrid-pi"), 4000, lambda _angle: -5.0)
    assert max(angles) < signals.CONFIG.moment_tilt_limit_rad + 1e-6
    assert angles[-1] == pytest.approx(math.radians(2.0), rel=1e-3)


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_reset_forgets_everything_and_leaving_contact_the_force_integral(name):
    rng = np.random.default_rng(0)
    readings = [signals.measurement_from(rng) for _ in range(20)]
    targets = [signals.target_near(m, rng, contact=1.0) for m in readings]
    made = signals.controller(name)
    first = [made.step(m, t) for m, t in zip(readings, targets, strict=True)]
    made.reset(signals.DT)
    again = [made.step(m, t) for m, t in zip(readings, targets, strict=True)]
    np.testing.assert_array_equal(first, again)
    if name == "hybrid-pi":
        (m, t), (_, free) = drawn(0), drawn(0, contact=0.0)
        fresh, made = in_tool(m, signals.controller(name).step(m, t))[0][2], signals.controller(name)
        for target in (t, t, t, free):
            made.step(m, target)
        assert in_tool(m, made.step(m, t))[0][2] == pytest.approx(fresh, abs=1e-15)


def test_an_angle_left_to_the_moment_loop_does_not_wind_the_orientation_loop_up():
    (m, t), (_, free) = drawn(0), drawn(0, contact=0.0)
    m.twist[:], m.wrench[:] = 0.0, 0.0
    for target in (t, free):
        target.position[:], target.twist[:] = m.position, 0.0
        target.rotation[:] = Rotation.from_rotvec(0.02 * m.rotation[:, 1]).as_matrix() @ m.rotation
    fresh, made = signals.controller("hybrid-pi").step(m, free), signals.controller("hybrid-pi")
    for _ in range(5000):
        made.step(m, t)
    np.testing.assert_allclose(made.step(m, free), fresh, atol=1e-6)


def pressing(force=0.0, speed=0.0):
    """A tool at rest on its target, z along base z, wanted to press with 20 N."""
    m = signals.measurement_at_rest()
    m.wrench[2], m.twist[2] = force, speed
    return m, signals.target_to_press(contact=1.0)


def speeds(damping, force, speed, count=20):
    """Speed along tool z at every step under a constant force [N], the tool held in place, no limit."""
    baselines = replace(signals.CONFIG.baselines, mode_damping=damping)
    law = signals.controller("force-mode", replace(signals.CONFIG, force_limit_m_s=1.0, baselines=baselines))
    m, t = pressing(force, speed)
    return np.array([law.step(m, t)[2] for _ in range(count)])


def test_force_mode_answers_every_second_millisecond_from_the_tools_speed_within_its_limit():
    answer = speeds(0.0, force=15.0, speed=0.0)
    np.testing.assert_array_equal(answer[1::2][:-1], answer[2::2])
    mass = signals.CONFIG.baselines.mode_mass_kg / signals.CONFIG.baselines.mode_gain_scaling
    np.testing.assert_allclose(np.diff(answer[1::2]), 5.0 / mass * 0.002)
    np.testing.assert_allclose(speeds(0.0, force=20.0, speed=0.01), 0.01)
    np.testing.assert_allclose(speeds(0.3, force=20.0, speed=0.01)[1::2], 0.01 * 0.7 ** np.arange(1, 11))
    for speed in (-0.02, 0.02):
        law, (m, t) = signals.controller("force-mode"), pressing(20.0, speed)
        assert law.step(m, t)[2] == pytest.approx(speed, rel=0.08)
    law, (m, t) = signals.controller("force-mode"), pressing(-500.0)
    assert max([law.step(m, t)[2] for _ in range(500)]) == pytest.approx(signals.CONFIG.force_limit_m_s)
    m.wrench[2] = 520.0
    back = np.array([law.step(m, t)[2] for _ in range(100)])
    assert (back < 0.0).argmax() < 20  # it does not wind up
    law, (m, t) = signals.controller("force-mode"), pressing(0.0)
    first = [law.step(m, t)[2] for _ in range(100)]
    t.contact = False
    law.step(m, t)
    t.contact = True
    np.testing.assert_allclose([law.step(m, t)[2] for _ in range(100)], first, atol=1e-12)
