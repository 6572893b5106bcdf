"""Tare, approach, touch-down, process, retract: in order, at their speeds, from what the host can know."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.cell import stroke as phases
from polish_sim.cell.stroke import advance_sequence, build_sequence
from polish_sim.control.signals import Measurement, Target
from polish_sim.log import APPROACH_PHASE, RETRACT_PHASE, TOUCH_PHASE
from tests.cell import cells

HEIGHT, SLIDE, LIFT = 0.02, 0.015, 0.01  # [m]


def test_phases_come_in_order_at_their_speeds_and_the_target_never_jumps():
    run = cells.on_plane(height=HEIGHT, slide=SLIDE, hold=0.5, lift=LIFT).run()
    time, force, phase = run.trace.time_s, run.trace.normal_force_n, run.trace.phase
    place, speed, down = run.trace.tcp_position_m, run.trace.tcp_speed_m_s, cells.TOUCH[:3, 2]
    assert run.stop_reason is None
    assert cells.phases(run) == [0, 1, 2, 3]
    assert np.linalg.norm(place[time < 0.39] - place[0], axis=1).max() < 2e-5
    np.testing.assert_allclose(speed[(phase == APPROACH_PHASE) & (time > 1.0)], 0.005, atol=1e-4)
    assert force[phase == APPROACH_PHASE].max() <= 0.5 < force[phase == TOUCH_PHASE][0]
    assert 0.0 < (place[phase == TOUCH_PHASE][0] - cells.TOUCH[:3, 3]) @ down < 2e-4
    assert phases.TOUCH_DOWN_TIME < np.ptp(time[phase == TOUCH_PHASE]) < phases.TOUCH_DOWN_TIME + 0.1
    path_s = run.trace.path_s_m[run.trace.fed]
    np.testing.assert_allclose(path_s[[0, -1]], [0.0, SLIDE], atol=1e-6)
    assert np.all(np.diff(path_s) >= 0.0)
    assert np.diff(path_s).max() == pytest.approx(0.01 * 0.001, rel=1e-6)
    slid = place[run.trace.fed]
    assert cells.TOUCH[:3, 0] @ (slid[-1] - slid[0]) == pytest.approx(SLIDE, abs=2e-4)
    lifted = place[phase == RETRACT_PHASE]
    np.testing.assert_allclose(lifted[-1] - cells.TOUCH[:3, 3], -LIFT * down + [SLIDE, 0.0, 0.0], atol=1.5e-3)
    assert np.linalg.norm(lifted[:, :2] - lifted[0, :2], axis=1).max() < 2e-4
    assert force[-1] == 0.0
    targets = run.log["target_position_m"]  # the retract at 20 mm/s is the fastest
    assert np.linalg.norm(np.diff(targets, axis=0), axis=1).max() < 0.021 * 0.001


def test_a_part_that_lies_high_is_met_early_and_one_that_lies_low_is_sought():
    for offset in (0.004, -0.004):
        part = cells.part_under(cells.along_tool(cells.TOUCH, z=-offset))
        run = cells.on_plane(part=part, height=HEIGHT, hold=1.5).run()
        assert run.stop_reason is None
        first = int(np.argmax(run.trace.phase == TOUCH_PHASE))
        assert run.trace.tcp_position_m[first, 2] - cells.TOUCH[2, 3] == pytest.approx(offset, abs=2e-4)
        assert run.trace.normal_force_n[-1] == pytest.approx(20.0, abs=0.3)


def test_a_law_that_presses_with_less_than_counts_as_contact_has_landed_once_the_search_is_over():
    run = cells.on_plane("controller.name=hybrid-adaptive", wanted=3.0, threshold=5.0).run()
    assert run.stop_reason is None
    assert run.trace.normal_force_n.max() < 4.0
    assert run.trace.normal_force_n[-1] == pytest.approx(3.0, abs=0.3)


def test_the_feed_time_ends_the_feed_early():
    run = cells.on_plane(slide=0.03, feed_time=1.0).run()
    assert np.ptp(run.trace.time_s[run.trace.fed]) == pytest.approx(1.0, abs=0.002)
    ramps = 0.5 * (0.01 / 0.05 + 0.04) + 0.5 * (0.01 / 0.2 + 0.04)  # up, and down again in time
    assert run.trace.path_s_m[-1] == pytest.approx(0.01 * (1.0 - ramps), abs=1e-4)
    targets = run.log["target_position_m"][run.trace.fed]
    np.testing.assert_allclose(targets[-1], targets[-2], atol=1e-7)


def test_a_tool_that_leans_and_stands_high_is_lifted_from_there_without_a_jolt():
    """By the pad's moment a law leans the tool by 10 deg; stiff springs hold it 2 mm above its target."""
    stroke, sequence, target = cells.pressing_stroke(hold=0.0, lift=LIFT), build_sequence(), Target()
    end, planned, m = stroke.process.positions[-1], cells.TOUCH[:3, :3], Measurement(cycle=0.002)
    sequence.stage, target.rotation[:], target.position[:] = phases.FEEDING, planned, end
    m.rotation[:] = planned @ Rotation.from_rotvec([0.15, -0.09, 0.0]).as_matrix()
    m.position[:] = end - 0.002 * planned[:, 2]
    heights, leans = [], []
    while sequence.stage != phases.DONE:
        assert advance_sequence(stroke, sequence, m, 1.0, target, 0.005)
        if sequence.stage == phases.RETRACT:
            heights.append((end - target.position) @ planned[:, 2])
            leans.append(Rotation.from_matrix(planned.T @ target.rotation).as_rotvec())
    speeds, turning = np.diff(heights) / 0.002, np.linalg.norm(np.diff(leans, axis=0), axis=1) / 0.002
    np.testing.assert_allclose(leans[0], [0.15, -0.09, 0.0], atol=1e-3)
    assert [heights[0], heights[-1]] == pytest.approx([0.002, 0.004 + LIFT])
    np.testing.assert_allclose(leans[-1], 0.0, atol=1e-12)
    assert speeds.max() == pytest.approx(0.02)
    assert np.abs(np.diff(speeds, prepend=0.0, append=0.0)).max() < 0.002  # [m/s]; at once: 0.02
    # 0.175 rad in 12 mm at 20 mm/s; at once, as an error over the look-ahead, it was 1.7 rad/s.
    assert turning.max() == pytest.approx(0.175 / 0.012 * 0.02, rel=0.02)


def test_two_strokes_follow_each_other_through_free_space_and_the_sensor_is_zeroed_again_if_it_is_to_be():
    """Its reading creeps: by what it crept since the tare the second stroke presses less."""
    second_touch, above = cells.tool_pose(0.03, -0.48, 0.1), cells.along_tool(cells.TOUCH, z=-LIFT)
    way = cells.way_through(above, cells.along_tool(second_touch, z=-0.005))
    first = cells.pressing_stroke(hold=0.5, lift=LIFT)
    second = cells.pressing_stroke(second_touch, hold=0.5, lift=LIFT)._replace(travel=way, start_s=0.1)
    part, drift, last = cells.part_under(), 0.2, []
    for retare in (False, True):
        strokes = first, second._replace(retare=retare)
        cell = cells.cell_for(cells.ideal("force", cells.EVERY_STEP), *strokes, part=part)
        cell.state.sensor.errors.creep[2] = 0.001 * drift
        run = cell.run()
        assert run.stop_reason is None
        assert cells.phases(run) == [0, 1, 2, 3, 0, 1, 2, 3]
        trace, fed = run.trace, run.trace.fed
        crossing = (trace.phase == APPROACH_PHASE) & (trace.time_s > 3.0)
        assert trace.normal_force_n[crossing].max() <= 0.5
        assert {0.0, 0.1} == set(np.round(trace.path_s_m[fed], 6))
        np.testing.assert_allclose(trace.tcp_position_m[fed][-1, :2], second_touch[:2, 3], atol=1e-4)
        last.append(trace.normal_force_n[fed][-1])
        if not retare:
            assert last[0] == pytest.approx(20.0 - drift * (trace.time_s[fed][-1] - 0.3), abs=0.2)
    assert last[1] - last[0] > drift * 2.5


def contact_time(reading, floor=0.0):
    """When a reading [N] by the time in the air [s] is contact [s], if ever; ``floor``: the noise [N]."""
    stroke, sequence, target = cells.pressing_stroke(height=0.008), build_sequence(), Target()
    sequence.floor = floor
    t, m = -(phases.TARE_START + phases.TARE_TIME), Measurement(cycle=0.001)
    while True:
        m.wrench[2], m.position[:] = reading(t), target.position
        if not advance_sequence(stroke, sequence, m, 1.0, target, 0.005):
            return math.inf
        if sequence.stage == phases.TOUCH_DOWN:
            return t
        t += 0.001


def swing(t):
    """An arm of 18 Hz that is shaken when it starts to come down."""
    return math.sin(2.0 * math.pi * 18.0 * t) if t > 0.0 else 0.0


def test_contact_is_found_at_2_newton_beyond_a_swing_and_not_by_one_noisy_reading_high_up():
    assert contact_time(lambda t: 100.0 * max(t - 1.0, 0.0)) == pytest.approx(1.02, abs=0.0015)
    assert contact_time(lambda t: 6.0 * swing(t) * math.exp(-0.3 * t)) == math.inf
    assert 1.0 < contact_time(lambda t: 3.0 * swing(t) + 100.0 * max(t - 1.0, 0.0)) < 1.15
    # 5 mm above the surface, 0.6 s after the start, it is.
    assert contact_time(lambda t: 7.0 * (0.3 < t < 0.302)) == pytest.approx(0.301, abs=0.001)
    assert contact_time(lambda t: 7.0 * (0.3 < t < 0.302), floor=6.0) == math.inf
    assert contact_time(lambda t: 7.0 * (t > 0.3), floor=6.0) == pytest.approx(0.32, abs=0.002)
    assert contact_time(lambda t: 7.0 * (0.8 < t < 0.802), floor=6.0) == pytest.approx(0.801, abs=0.001)
