"""Each law of hybrid-adaptive by itself, and the composed law on a spring in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest

from polish_sim.config import AdaptiveConfig
from polish_sim.control import CONTROLLERS
from polish_sim.control.adaptive import force_loop, landing
from polish_sim.control.adaptive.gains import LAWS, PressMemory, adaptive_gains
from polish_sim.errors import ConfigError
from tests.control.signals import CONFIG, DT, Plant, land, measurement_at_rest, settling, target_to_press

GAINS = adaptive_gains(AdaptiveConfig())
PACE = force_loop.LoopSpeed(40.0, 40.0, 40.0)
STILL = measurement_at_rest()
DOWN = 0.005  #: Planned speed of an approach [m/s]
SOFT = Plant(stiffness=1000.0, mass=2.4, command_delay=15, sensor_delay=5)


def test_a_ramp_shows_as_late_as_the_sensor_is_and_the_tools_own_force_is_mass_and_dampers():
    """A ramp of speed v through latency T and corner f lags by v (T + 1/(2 pi f)), less half a cycle."""
    memory, speed = PressMemory(), 0.02
    for k in range(400):
        seen = force_loop.as_sensed(GAINS, memory, speed * k * DT, 3.0, DT)
    lag = (speed * 399 * DT - seen.path) / speed
    assert lag == pytest.approx(0.002 + 1.0 / (2.0 * math.pi * 80.0) - 0.5 * DT, abs=1e-4)
    assert seen.own == pytest.approx(3.0)
    memory = PressMemory()
    forces = [landing.own_force(GAINS, memory, STILL, 0.5 * k * DT, 0.0, DT) for k in range(10)]
    assert forces[0] == 0.0
    np.testing.assert_allclose(forces[1:], 2.0 * 0.5)
    off = adaptive_gains(AdaptiveConfig(laws="touch-down stiffness"))
    assert landing.own_force(off, memory, STILL, 1.0, 0.0, DT) == 0.0
    memory = PressMemory()
    memory.force.stiffness = GAINS.stiffness_n_m
    forces = [landing.own_force(GAINS, memory, STILL, 0.05, 0.05, DT) for _ in range(50)]
    lag = 1.0 - math.exp(-2 * DT / GAINS.damping_lag_s)
    assert forces[1] == pytest.approx(GAINS.damping_n_s_m * 0.05 * lag)
    assert forces[-1] == pytest.approx(GAINS.damping_n_s_m * 0.05)


@pytest.mark.parametrize(("cycles", "speed"), [(4, 0.002), (9, 0.02), (25, 0.002)])
def test_the_commands_delay_is_measured_on_the_way_down(cycles, speed):
    """A command shows in the encoders ``cycles`` later; when the next is chosen, one less are under way."""
    memory = PressMemory()
    memory.delay.delay = GAINS.command_delay_s
    commands = [min(speed, 0.05 * k * DT) for k in range(1500)]
    for k, command in enumerate(commands):
        force_loop.measure_delay(GAINS, memory, commands[k - cycles] if k >= cycles else 0.0, DT)
        force_loop.remember_command(memory, command)
    assert memory.delay.delay == pytest.approx((cycles - 1) * DT, abs=0.0005)
    assert force_loop.under_way(memory, DT) == pytest.approx(speed * (cycles - 1) * DT, rel=0.01)


def landing_memory():
    memory = PressMemory()
    memory.air.variance = 0.25**2
    landing.restart_fit(memory, 0.0, 0.0)
    return memory


@pytest.mark.parametrize("stiffness", [1000.0, 5000.0, 40000.0])
def test_stiffness_is_found_from_above_within_the_first_newtons_and_not_by_a_tool_at_rest(stiffness):
    rng, memory, speed, found = np.random.default_rng(0), landing_memory(), 0.02, []
    for path in np.arange(0.0, 8.0 / stiffness, speed * DT):
        reading = stiffness * path + 0.25 * rng.normal()
        found.append(landing.refine_stiffness(GAINS, memory, path, reading, speed))
    assert found[0] == pytest.approx(25000.0)
    assert min(found) > 0.9 * min(stiffness, 25000.0)
    assert found[-1] == pytest.approx(stiffness, rel=0.35)
    memory = PressMemory()
    landing.restart_fit(memory, 0.0, 0.0)
    for _ in range(2000):
        known = landing.refine_stiffness(GAINS, memory, 1e-5 * rng.normal(), rng.normal(), 0.0005)
    assert known == pytest.approx(25000.0)


@pytest.mark.parametrize("phase", np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False))
def test_the_swing_of_an_arm_that_lands_is_no_spring(phase):
    """3 N at 28 Hz on a spring of 5000 N/m, pressed in by 2 mm at 5 mm/s."""
    memory = landing_memory()
    for t in DT * np.arange(round(0.4 / DT)):
        force = 5000.0 * 0.005 * t + 3.0 * math.sin(2.0 * math.pi * 28.0 * t + phase)
        found = landing.refine_stiffness(GAINS, memory, 0.005 * t, force, 0.005)
    assert 0.98 * 5000.0 < found < 1.25 * 5000.0


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_minute_of_air_is_not_taken_for_contact_and_a_part_is_noticed_soon(noise):
    rng, memory, blend = np.random.default_rng(1), PressMemory(), 1.0 - math.exp(-2.0 * math.pi * 80.0 * DT)
    white = noise / math.sqrt(blend / (2.0 - blend))
    reading = 0.0
    for k in range(60300):
        rise = 0.1 * max(k - 60000, 0)
        reading += blend * (white * rng.normal() - reading)
        if landing.watch_air(memory, reading + 0.7 + rise, DOWN, False, DT):
            break
    assert 60000 <= k < 60299
    assert rise < 1.0 + 5.0 * noise


def test_an_arm_that_swings_by_more_than_it_presses_does_not_lose_contact_and_one_that_leaves_does():
    memory = PressMemory()
    for _ in range(500):
        landing.watch_air(memory, 0.0, DOWN, False, DT)
    lost, memory.force.age = [], 0.1
    for t in DT * np.arange(1000):
        reading = 2.0 + 3.0 * math.sin(2.0 * math.pi * 25.0 * t) if t < 0.5 else 0.0
        landing.smooth_reading(memory, reading, DT)
        lost.append(landing.fell_back(memory))
    assert not any(lost[100:500])
    assert all(lost[700:])


def test_a_force_where_contact_was_taken_for_lost_is_not_learned_as_noise_of_the_air():
    """The next contact would be missed up to a larger force: the tool would strike harder each time."""
    rng, memory = np.random.default_rng(2), PressMemory()
    for _ in range(2000):
        landing.watch_air(memory, rng.normal(), DOWN, False, DT)
    rise = landing.fast_rise(memory)
    found = 0
    for k in range(4000):
        found += landing.watch_air(memory, 5.0 * math.sin(0.01 * k) + rng.normal(), DOWN, True, DT)
    assert landing.fast_rise(memory) == rise
    assert found > 500


@pytest.mark.parametrize("travel", [0.0003, 0.004, 0.02])
def test_the_quickest_stop_ends_where_it_should_and_brakes_no_harder_than_the_robot(travel):
    left, speeds = travel, []
    for _ in range(600):
        speeds.append(landing.quickest_stop(GAINS, left, 40.0, 0.1))
        left -= speeds[-1] * DT
        assert left >= 0.0
    assert left < 0.01 * travel
    assert max(-np.diff(speeds)) < GAINS.acceleration_m_s2 * DT
    assert max(speeds) <= 0.1
    assert landing.quickest_stop(GAINS, -travel, 40.0, 0.1) == -speeds[0]


def test_the_loop_is_as_fast_as_delay_inertia_and_noise_allow_and_knows_the_force_before_the_sensor():
    usual = force_loop.pace_of(GAINS, 5000.0, 0.012, 0.25, 1.0)
    assert usual.crossover <= GAINS.delay_share / 0.012
    for stiffness in (500.0, 1000.0, 5000.0):
        pace = force_loop.pace_of(GAINS, stiffness, 0.005, 0.25, 1.0)
        mass = GAINS.tool_mass_kg * GAINS.tool_mass_doubt
        assert 2.0 * pace.crossover * pace.observer * mass / stiffness <= 0.5 + 1e-12
    assert force_loop.pace_of(GAINS, 5000.0, 0.03, 0.25, 1.0).crossover <= 0.5 / 0.03
    assert force_loop.pace_of(GAINS, 5000.0, 0.012, 1.0, 1.0).observer < 0.5 * usual.observer
    # The reading is 4 ms late, the estimate is not; at first touch it is four times as quick, not its rate.
    memory, k, rates = PressMemory(), 5000.0, []
    force_loop.begin_contact(memory, k, 0.0, 0.0)
    for n in range(1000):
        z = 0.002 * math.sin(2.0 * math.pi * 5.0 * n * DT)
        memory.force.travel = z
        seen = force_loop.as_sensed(GAINS, memory, z, 0.0, DT)
        memory.force.landed = 1.0
        force_loop.observe_force(memory, PACE, seen.path, k * seen.path, DT)
        assert memory.force.at_no_travel + k * z == pytest.approx(k * z, abs=1e-9)
    for first in (25.0, 100.0):
        memory = PressMemory()
        force_loop.begin_contact(memory, k, 0.0, 0.0)
        memory.force.landed = 0.1
        force_loop.observe_force(memory, force_loop.LoopSpeed(40.0, 25.0, first), 0.0, 3.0, DT)
        rates.append(memory.force.rate)
    assert rates[0] == rates[1] > 0.0


def corrections(memory, added, seconds=2.0):
    """What the force loop adds to k z while b is ``added`` of the time."""
    found, memory.force.landed = [], 1.0
    for k in range(round(seconds / DT)):
        memory.force.at_no_travel = added(k * DT)
        found.append(force_loop.correction(memory, GAINS.arm_mode, 40.0, DT))
    return found


@pytest.mark.parametrize("times", [0.5, 1.0, 3.0])
def test_the_notch_takes_out_the_arms_vibration(times):
    """At x times its frequency |1 - x^2| / (1 + x^2) is left; up to a tenth in steps of 1 ms."""
    found = corrections(PressMemory(), lambda t: math.sin(times * GAINS.arm_mode * t))
    assert max(found[1000:]) == pytest.approx(abs(1.0 - times**2) / (1.0 + times**2), abs=0.1)


def test_the_notch_does_not_lag_behind_an_even_rise_nor_swing_when_another_stiffness_is_believed():
    memory, rise = PressMemory(), 20.0
    memory.force.rate = rise
    found = corrections(memory, lambda t: rise * t)
    assert found[-1] == pytest.approx(rise * (2.0 - DT) + rise / 40.0, abs=1.1 * rise * DT)
    memory = PressMemory()
    for memory.force.at_no_travel in (3.0, -5.0):
        assert force_loop.correction(memory, 0.0, 40.0, DT) == memory.force.at_no_travel
    memory, other = PressMemory(), PressMemory()
    for each in (memory, other):
        force_loop.begin_contact(each, 25000.0, 0.001, 3.0)
    corrections(memory, lambda _: -22.0, 0.3)
    other.force.travel = 0.001
    for each in (memory, other):
        force_loop.change_stiffness(each, 5000.0, 0.001)
    assert corrections(memory, lambda _: -2.0, 0.1) == pytest.approx(np.full(100, -2.0), abs=1e-9)
    force_loop.observe_force(other, PACE, 0.001, 3.0, DT)
    assert other.force.at_no_travel + 5000.0 * 0.001 == pytest.approx(3.0)


def adaptive(without="", **changes):
    laws = {"laws": " ".join(name for name in LAWS if name != without), **changes}
    made = replace(CONFIG, adaptive=replace(CONFIG.adaptive, damping_n_s_m=0.0, **laws))
    return CONTROLLERS["hybrid-adaptive"](made)


@pytest.mark.parametrize("scale", [0.2, 1.0, 5.0])
@pytest.mark.parametrize(("command", "sensor"), [(2, 1), (17, 5)])
def test_it_lands_on_any_spring_at_any_delay_without_being_told(scale, command, sensor):
    run = land(adaptive(), Plant(stiffness=5000.0 * scale, command_delay=command, sensor_delay=sensor))
    # What cannot strike on stiff springs takes its time for the 20 mm that soft ones give by.
    assert settling(run, 20.0) < (1.0 if scale < 1.0 else 0.35)
    assert run.force.max() < 22.0
    assert np.abs(run.force[-300:] - 20.0).max() < 0.1


@pytest.mark.parametrize(("approach", "force"), [(0.002, 20.0), (0.05, 20.0), (0.02, 3.0), (0.02, 50.0)])
def test_landing_takes_less_than_a_quarter_second_whatever_approach_and_force(approach, force):
    run = land(adaptive(), Plant(noise=0.5), approach, set_force=force)
    assert settling(run, force) < (0.25 if force == 20.0 else 0.3)
    assert run.force.max() < force + 1.0


@pytest.mark.parametrize("rise", [-0.004, 0.004])
def test_a_part_that_rises_steadily_leaves_what_it_rises_within_the_lags(rise):
    """The observer's rate integrates; what stays is k v (command 9 + sensor 3 + low-pass 2 ms) = 0.28 N."""
    run = land(adaptive(), Plant(rise=rise), seconds=2.0)
    assert np.abs(run.force[(run.time > 0.6) & (run.time < 0.7)] - 20.0).max() > 0.4
    np.testing.assert_allclose(run.force[-200:] - 20.0, 5000.0 * rise * 0.014, rtol=0.25)


@pytest.mark.parametrize(
    ("law", "plant", "since", "off"),
    [*((law, Plant(), 1.7, 0.2) for law in ("touch-down", "stiffness", "inertia")), ("", SOFT, 2.0, 0.1)],
)
def test_without_one_law_the_others_still_land_and_with_all_inertia_does_not_ring(law, plant, since, off):
    run = land(adaptive(without=law), plant, seconds=since + 0.5)
    assert np.abs(run.force[run.time >= since] - 20.0).max() < off


def test_touch_down_makes_the_landing_faster_stiffness_holds_stiffer_springs_and_unknown_laws_are_refused():
    slow, fast = (land(adaptive(law), Plant(noise=0.5), approach=0.002) for law in ("touch-down", ""))
    assert settling(fast, 20.0) < 0.8 * settling(slow, 20.0)
    stiff = Plant(stiffness=25000.0, command_delay=17, sensor_delay=5)
    assert land(adaptive(), stiff).force.max() < 21.0
    assert land(adaptive("stiffness"), stiff).force.max() > 25.0
    with pytest.raises(ConfigError, match=r"'touchdown'.*touch-down, stiffness"):
        adaptive(laws="touchdown")


def test_neither_a_force_before_the_tool_moves_nor_noise_in_the_air_is_taken_for_contact():
    """3 N are read where 2.4 N are set, with nothing travelled; then 2 mm/s on a spring of 3000 N/m."""
    controller = adaptive(without="touch-down")
    controller.reset(DT)
    m, t = measurement_at_rest(), target_to_press(2.4, contact=1.0)
    believed = []
    for k in range(600):
        m.twist[2] = min(0.002, 0.02 * DT * max(k - 50, 0))
        m.position[2] += m.twist[2] * DT
        m.wrench[2] = 3.0 + 3000.0 * m.position[2]
        controller.step(m, t)
        believed.append(controller.context.memory.press.force.stiffness)
    assert believed[49] == 25000.0
    assert 3000.0 < believed[-1] < 12500.0
    # The sequence takes noise for contact half a metre above the part: the approach speed is kept.
    controller, rng = adaptive(), np.random.default_rng(0)
    controller.reset(0.001)
    m, t = measurement_at_rest(), target_to_press()
    t.twist[2] = 0.01
    speeds = []
    for k in range(3000):
        m.wrench[2] = rng.normal()
        t.contact = k > 1000
        m.twist[2] = 0.01
        speeds.append(controller.step(m, t)[2])
    assert np.max(speeds[1001:]) < 0.02
    assert np.mean(speeds[1001:]) == pytest.approx(0.01, rel=0.05)


def test_a_tool_held_up_on_the_part_and_let_down_is_not_hurled_at_its_target():
    controller, speeds = adaptive(), []
    controller.reset(DT)
    m, t = measurement_at_rest(), target_to_press(3.0)
    for k in range(2000):
        down = k < 250
        t.twist[2] = 0.005
        t.position[2] += 0.005 * DT
        m.twist[2] = 0.005 if down else 0.0
        m.position[2] += m.twist[2] * DT
        m.wrench[2] = 0.0 if down or k >= 1600 else 3.0
        speeds.append(controller.step(m, t)[2])
    assert t.position[2] - m.position[2] > 0.005
    assert max(map(abs, speeds[600:1600])) < 0.004
    assert 0.004 < max(speeds[1600:]) < 0.0101
