"""What the path contributes: each law against its closed form, and its worth on a plant in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.config import AdaptiveConfig, ControllerConfig
from polish_sim.control.adaptive import drawing, surface
from polish_sim.control.adaptive.gains import PathMemory, PressMemory, adaptive_gains
from polish_sim.control.adaptive.landing import own_force, round_a_bend
from polish_sim.control.adaptive.law import hybrid_adaptive
from tests.control import signals
from tests.control.signals import CONFIG, DT, SPACING, SPRING, course_of, measurement_at_rest, target_to_press

CAN = AdaptiveConfig()
GAINS = adaptive_gains(AdaptiveConfig(learning_gain=1.0, normal_limit_rad=0.17, normal_doubt_nm=0.0))
ALONG = np.eye(3)


def fed_at(s, speed=0.06):
    """A target in contact at a place of a straight path along x."""
    t = target_to_press(contact=1.0)
    t.s, t.speed, t.twist[0] = s, speed, speed
    return t


def seen_with(**columns):
    """What lies ahead: flat but for these columns of the course."""
    n = len(next(iter(columns.values())))
    course = course_of(np.zeros(n))._replace(**columns)
    return drawing.Ahead(SPACING, drawing.rows_ahead(course, np.ones(n)))


def nothing_ahead():
    return drawing.Ahead(1.0, np.zeros(0, drawing.AheadRow.dtype))


def granted(ahead, error, memory):
    """Feed granted after one more cycle with a force error [N]."""
    t = fed_at(0.1)
    memory.feed_error = drawing.averaged_error(memory.feed_error, error, t, 0.001)
    return float(drawing.granted_feed(ahead, t, memory.feed_error, GAINS))


def sent(ahead, s, look_ahead=0.0, ratio=1.0, R=ALONG, wanted=ALONG):
    """Rate along tool z that the feed-forward asks of a tool at ``R`` where ``wanted`` is aimed at [m/s]."""
    m = measurement_at_rest()
    m.rotation[:] = R
    return float(drawing.planned_press_rate(ahead, m, fed_at(s), wanted, look_ahead, ratio, GAINS))


def test_where_the_command_will_act_the_tool_is_sent_down_a_slope_at_slope_times_feed_and_turned():
    ahead = seen_with(surplus=0.05 * SPACING * np.arange(200))
    assert sent(ahead, 0.05) == pytest.approx(0.05 * 0.06, rel=1e-3)
    assert sent(ahead, 0.05, ratio=0.2) == pytest.approx(0.2 * sent(ahead, 0.05))  # on stiffer springs
    assert drawing.planned_surplus(ahead, fed_at(0.05), 1.0, GAINS) == pytest.approx(0.05 * 0.05, rel=1e-3)
    ahead = seen_with(surplus=0.05 * SPACING * np.maximum(np.arange(400) - 200, 0))
    assert sent(ahead, 0.09) == pytest.approx(0, abs=1e-6)
    assert sent(ahead, 0.09, look_ahead=0.4) == pytest.approx(0.05 * 0.06, rel=1e-2)
    # Leaning 1 deg against the feed, the tool's own z sees v sin(1 deg); a wanted lean is no lag.
    ahead, R = seen_with(surplus=np.zeros(200)), Rotation.from_euler("y", 1.0, degrees=True).as_matrix()
    assert sent(ahead, 0.05, R=R) == pytest.approx(0.06 * math.sin(math.radians(1.0)))
    assert sent(ahead, 0.05, R=R, wanted=R) == pytest.approx(0.0, abs=1e-9)
    ahead = seen_with(turning=np.outer(np.arange(400) >= 200, [0.0, 10.0, 0.0]))
    for s, look_ahead, rate in ((0.0994, 0.02, 10.0 * 0.06), (0.15, 0.01, 0.0)):
        out = np.zeros(7)
        drawing.lead_turning(
            ahead, fed_at(s), adaptive_gains(AdaptiveConfig(command_delay_s=look_ahead)), out
        )
        np.testing.assert_allclose(out, [0.0, 0.0, 0.0, 0.0, rate, 0.0, 0.0], atol=1e-9)


def test_round_a_bend_the_carried_mass_is_accelerated_by_both_its_circles():
    """Tool point at v round a bend of radius R, centre l above it: v^2 / R + l (v / R)^2 towards the part."""
    v, radius, height = 0.06, 0.06, 0.1226
    m, turned = measurement_at_rest(), Rotation.random(random_state=1)
    m.rotation[:] = turned.as_matrix()
    # Over a convex part, z into it: moving along x the axis turns about -y.
    m.twist[:3], m.twist[3:] = turned.apply([v, 0.0, 0.0]), turned.apply([0.0, -v / radius, 0.0])
    gains = adaptive_gains(AdaptiveConfig(tool_center_m=height))
    towards = v**2 / radius + height * (v / radius) ** 2
    assert round_a_bend(gains, m) == pytest.approx(towards)
    memory = PressMemory()
    forces = [own_force(gains, memory, m, 0.0, 0.0, DT) for _ in range(2)]
    np.testing.assert_allclose(forces, gains.tool_mass_kg * towards)


def test_columns_are_linear_between_rows_and_the_arm_swings_as_the_path_or_the_config_says():
    ahead = seen_with(stiffness=np.array([4000.0, 5000.0, 3000.0]))
    for s, known in ((0.25 * SPACING, 4250.0), (SPACING, 5000.0), (1.0, 3000.0), (-1.0, 4000.0)):
        assert drawing.at(ahead.rows["stiffness"], SPACING, s) == pytest.approx(known, rel=1e-3)
    ahead = nothing_ahead()
    assert drawing.at(ahead.rows["stiffness"], ahead.spacing, 0.1) == 0.0
    assert sent(ahead, 0.1) == 0.0
    assert surface.learned_rate(ahead, fed_at(0.1), 0.0, GAINS, 0.001, surface.NeighbourMemory()) == 0.0
    assert granted(ahead, 0.0, PathMemory()) == 1.0
    course = course_of(np.zeros(300))._replace(arm_mode=np.repeat([0.0, 100.0, 120.0], 100))
    for hz, wanted in ((20.0, [40.0 * math.pi, 100.0, 120.0]), (0.0, [0.0, 0.0, 0.0])):
        law = hybrid_adaptive(ControllerConfig(adaptive=AdaptiveConfig(arm_mode_hz=hz)))
        law.prepare(course)
        np.testing.assert_allclose(law.course["arm_mode"], np.repeat(wanted, 100))


def test_the_feed_falls_before_bends_no_faster_than_it_may_and_with_the_force_error_beyond_its_budget():
    """A corner of 3 mm radius takes half of 1.2 m/s^2 at sqrt(0.6 x 0.003) = 42 mm/s. On a steep slope it is
    so slow that the unforeseen part stays within the budget."""
    bending = np.zeros(2000)
    bending[1000:1040] = 1.0 / 0.003
    course = course_of(np.zeros(2000), feed=0.06)._replace(bending=bending)
    share = drawing.followable_share(course, CAN)
    assert share.min() == pytest.approx(math.sqrt(0.6 * 0.003) / 0.06, rel=0.02)
    assert (share[:900] == 1.0).all()
    assert (share[1140:] == 1.0).all()
    assert np.abs(np.diff((0.06 * share) ** 2)).max() <= 2.0 * SPACING * (0.12 + 1e-9)
    speed = 0.1 * drawing.followable_share(course_of(0.5 * SPACING * np.arange(400), feed=0.1), CAN)[200]
    assert 0.3 * SPRING * 0.5 * speed / 40.0 == pytest.approx(1.0, rel=1e-3)
    # 200 waves a turn and 24 Hz: at most 2 pi 12 / 200 rad/s.
    can = AdaptiveConfig(gear_waves=200.0)
    turning, mode = np.zeros((2000, 3)), np.full(2000, 2.0 * math.pi * 24.0)
    turning[800:1200, 1] = 1.0 / 0.06  # a bend of 60 mm radius
    rigid = course_of(np.zeros(2000), feed=0.03)._replace(turning=turning)
    share = drawing.followable_share(rigid._replace(arm_mode=mode), can)
    assert share[1000] * 0.03 / 0.06 == pytest.approx(2.0 * math.pi * 12.0 / 200.0, rel=0.01)
    assert share[0] == share[-1] == 1.0
    assert drawing.followable_share(rigid, can)[1000] == 1.0
    ahead, memory = nothing_ahead(), PathMemory()
    shares = [granted(ahead, 2.0, memory) for _ in range(1500)]
    assert shares[0] == 1.0
    assert shares[-1] == pytest.approx(0.5, rel=1e-3)
    assert np.abs(np.diff(shares)).max() < 0.02
    for _ in range(1500):
        share = granted(ahead, 0.0, memory)
    assert share == 1.0
    assert granted(ahead, 0.0, PathMemory(feed_error=100.0)) == pytest.approx(GAINS.feed_least)


def test_what_is_learned_is_stored_where_it_was_met_and_fed_forward_until_the_neighbour_is_lost():
    """The average lags its length behind a ramp; what is stored does not."""
    ahead, state = seen_with(surplus=np.zeros(800)), surface.LearningMemory()
    for s in np.arange(0.0, 0.2, 0.06 * 0.001):
        surface.learn(ahead, fed_at(float(s)), 0.01 * s, GAINS, 0.001, state)
    rows = np.arange(100, 300)
    assert ahead.rows["known"][rows].all()
    np.testing.assert_allclose(ahead.rows["learned"][rows], 0.01 * SPACING * rows, atol=1.5e-5)
    assert not ahead.rows["known"][:10].any()
    neighbour = np.where(np.arange(800) < 600, np.arange(800) - 400, -1)
    ahead = seen_with(surplus=np.zeros(800), neighbour=neighbour)
    ahead.rows["learned"], ahead.rows["known"] = 0.01 * SPACING * np.arange(800), True
    state = surface.NeighbourMemory()
    assert surface.learned_rate(seen_with(neighbour=neighbour), fed_at(0.25), 0.0, GAINS, 0.001, state) == 0.0
    for _ in range(1000):
        rate = surface.learned_rate(ahead, fed_at(0.25), 0.0, GAINS, 0.001, state)
    assert rate == pytest.approx(0.01 * 0.06, rel=1e-3)
    fading = [surface.learned_rate(ahead, fed_at(0.35), 0.0, GAINS, 0.001, state) for _ in range(1000)]
    assert fading[0] == pytest.approx(rate, rel=0.02)
    assert abs(fading[-1]) < 1e-3 * rate
    assert np.abs(np.diff(fading)).max() < 0.02 * rate


def level(true_tilt, noise=0.0, friction=0.0, seconds=4.0, gains=GAINS):
    """Close the loop on a part tilted about tool x and y [rad]; corrections (n, 2) [rad]. The moment is the
    pad's tilt stiffness times what is left of the tilt, about the tool point behind a spring."""
    rng, m, state, track = np.random.default_rng(1), measurement_at_rest(), surface.NormalMemory(), []
    m.wrench[:3] = friction, -0.5 * friction, 20.0
    behind = 20.0 / GAINS.head_stiffness_n_m * np.array([m.wrench[1], -m.wrench[0]])
    for _ in range(round(1000 * seconds)):
        moment = -3.125 * (true_tilt - state.tilt)
        m.wrench[3:5] = moment + behind + noise * rng.standard_normal(2)
        surface.level_by_moment(nothing_ahead(), m, fed_at(0.05), gains, 0.001, state)
        track.append(state.tilt.copy())
    return np.array(track)


def test_a_tilted_part_is_found_whatever_friction_noise_swing_and_a_drawn_border_s_moment():
    for tilt in ([0.05, -0.08], [0.0, math.radians(8.0)]):
        np.testing.assert_allclose(level(np.array(tilt), friction=6.0)[-1], tilt, atol=1e-3)
    assert np.linalg.norm(level(np.array([0.4, 0.4]))[-1]) == pytest.approx(0.17)
    doubting = adaptive_gains(AdaptiveConfig(normal_doubt_nm=0.04, normal_lean_rad=0.01))
    prior = (0.04 / 3.125 / 0.01) ** 2
    for tilt, turned in ((0.015, 0.015 / (1.0 + prior)), (0.1, 0.1 - 0.01 * prior)):
        assert level(np.array([tilt, 0.0]), gains=doubting)[-1, 0] == pytest.approx(turned, rel=1e-3)
    found = level(np.zeros(2), noise=0.02, seconds=10.0)
    assert np.sqrt((found[2000:] ** 2).mean(axis=0)).max() < 0.002
    # 0.3 N m at 30 Hz through a low-pass of 3 Hz and an integrator of 3/s.
    m, state, tilts = measurement_at_rest(), surface.NormalMemory(), []
    for k in range(3000):
        m.wrench[2:5] = 20.0, 0.3 * math.sin(2.0 * math.pi * 30.0 * 0.001 * k), 0.0
        surface.level_by_moment(nothing_ahead(), m, fed_at(0.05), GAINS, 0.001, state)
        tilts.append(state.tilt[0])
    swing = 0.5 * np.ptp(tilts[2000:])
    alone = GAINS.normal_rate_1_s * 0.3 / GAINS.pad_tilt_stiffness_nm_rad / (2.0 * math.pi * 30.0)
    assert swing == pytest.approx(alone / math.hypot(1.0, 30.0 / surface.MOMENT_HZ), rel=0.05)
    ahead = seen_with(moment=np.tile([0.1, -0.2], (200, 1)))
    m, state = measurement_at_rest(), surface.NormalMemory()
    m.wrench[2:5] = 20.0, 0.1, -0.2
    for _ in range(3000):
        surface.level_by_moment(ahead, m, fed_at(0.05), GAINS, 0.001, state)
    np.testing.assert_allclose(state.tilt, 0.0, atol=1e-9)


def controller(laws, course):
    adaptive = AdaptiveConfig(laws="touch-down stiffness inertia " + laws)
    law = hybrid_adaptive(replace(CONFIG, adaptive=adaptive))
    law.prepare(course)
    return law


def wave(s):
    """Up to 1 mm deep, slope up to 0.05, as at the crest of a freeform part [m]."""
    return 0.0005 * (1.0 - math.cos(100.0 * s))


def test_a_drawn_wave_is_followed_better_with_feed_forward_another_one_on_the_next_turn():
    course, worst = course_of(np.array([wave(SPACING * r) for r in range(700)])), []
    for laws in ("", "feed-forward"):
        places, errors = signals.follow(controller(laws, course), wave, 0.3)
        worst.append(float(np.abs(errors[places > 0.05]).max()))
    assert worst[0] > 0.3
    assert worst[1] < 0.2 * worst[0]
    # Two equal turns of 0.4 m one after the other; nothing of the wave is in the course.
    rows = np.arange(1700)
    course = course_of(np.zeros(1700), neighbour=np.where(rows >= 800, rows - 800, -1))
    places, errors = signals.follow(controller("learning", course), lambda s: 0.6 * wave(s % 0.4), 0.78)
    first = np.abs(errors[(places > 0.1) & (places < 0.35)]).max()
    second = np.abs(errors[(places > 0.5) & (places < 0.75)]).max()
    assert first > 0.15
    assert second < 0.5 * first


def test_reset_forgets_the_run_and_keeps_the_course():
    law = controller("feed-forward feed learning normal", course_of(np.zeros(700)))
    fresh, drawn = law.context.copy(), law.course.copy()
    signals.follow(law, wave, 0.1)
    assert law.context != fresh
    assert (law.course != drawn).any()
    law.reset(0.001)
    assert law.context == fresh
    np.testing.assert_array_equal(law.course, drawn)
