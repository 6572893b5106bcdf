"""Injected faults: each at its step and with its reason, the force bounded, the tool off the part."""

import math
import re

import numpy as np
import pytest

from polish_sim.cell import Silent, guards
from polish_sim.cell.faults import FaultEvent, as_planned, parse_events
from polish_sim.cell.real_part import SHIFT_SPEED
from polish_sim.errors import ConfigError, InputError
from polish_sim.experiments import default_scenario
from polish_sim.experiments.assembly import check_settings
from polish_sim.scenario_file import override
from tests.cell import cells


def faulty(events, *changes, **how):
    """A cell with the default noise, pressing on a plane 5 mm below; ``how`` as of `pressing_stroke`."""
    settings = [*cells.NOMINAL_PART, cells.EVERY_STEP, f"faults.events={events}", *changes]
    stroke = cells.pressing_stroke(**({"hold": 2.0, "lift": 0.01} | how))
    return cells.cell_for(override(default_scenario("force"), settings), stroke, part=cells.part_under())


def assert_it_ends_well(run):
    """Whatever happened: bounded force, whole log, tool off the part, reason and brakes in time."""
    assert run.trace.normal_force_n.max() < 60.0
    np.testing.assert_allclose(run.trace.time_s, 0.001 * np.arange(run.steps), atol=1e-9)
    assert len(run.log) == run.steps
    assert np.all(run.trace.normal_force_n[-50:] == 0.0)
    assert run.safety.faults_missed == ()
    if run.stop_reason is not None:
        assert 0.0 < run.safety.stop_delay_s <= 0.020
        assert run.safety.retracted is True


@pytest.mark.parametrize(
    ("event", "code", "least", "most"),
    [
        ("sensor-dropout@0.8", guards.NO_READING, 0.0, 0.020),
        ("sensor-zeros@contact+0.02", guards.NO_READING, 0.0, 0.020),
        ("sensor-jump@contact+0.02", guards.JUMP, 0.0, 0.020),
        ("sensor-drop@contact+1", guards.JUMP, 0.0, 0.020),
        ("controller-nan@contact+0.02", guards.CONTROLLER_NAN, 0.0, 0.020),
        # What shows by its absence, when its time is over; the spindle runs down a fifth in 0.1 s.
        ("sensor-frozen@contact+1", guards.FROZEN, 0.016, 0.024),
        ("command-lost@contact+1", guards.SILENT_HOST, 0.102, 0.110),
        ("spindle-stop@contact+1", guards.SPINDLE, 0.096, 0.104),
        ("part-low@contact+1", guards.FALLEN, 0.0, 12.0),
        ("part-missing@contact+1", guards.FALLEN, 0.0, 12.0),
        ("sensor-drift@contact+1", guards.FALLEN, 0.0, 12.0),
    ],
)
def test_what_can_be_noticed_stops_the_robot_in_time(event, code, least, most):
    run = faulty(event, "spindle.speed_rpm=6000", hold=12.0).run()
    assert run.stop_reason == guards.REASONS[code]
    assert least <= run.safety.fault_to_stop_s <= most
    assert_it_ends_well(run)


@pytest.mark.parametrize(("when", "way"), [(1.0, 0.005), (0.05, 0.009)])
def test_a_part_that_rises_by_10_mm_is_followed_for_5_more_than_pressed_in(when, way):
    """While it touches down it is pressed in by 4 mm more: its rise counts from where contact was."""
    run = faulty(f"part-high@contact+{when}").run()
    assert run.stop_reason == guards.REASONS[guards.RISEN]
    assert run.safety.fault_to_stop_s == pytest.approx(way / SHIFT_SPEED, abs=0.1)
    assert run.trace.part_shift_m[cells.stopped_at(run), 2] == pytest.approx(way, abs=0.002)
    assert run.trace.part_shift_m[-1, 2] == pytest.approx(0.010)
    assert_it_ends_well(run)


@pytest.mark.parametrize("name", ["HIGH", "LOW", "MISSING"])
def test_a_part_that_is_not_where_it_was_planned_is_noticed(name):
    run = faulty(f"part-{name.lower()}@0", height=0.02, search_depth=0.02 if name == "LOW" else 0.01).run()
    assert run.stop_reason == guards.REASONS[getattr(guards, name)]
    assert run.trace.normal_force_n.max() < 10.0
    if name == "MISSING":  # sought to the search depth and no further
        assert "process.search_depth_m" in str(run.stop_reason)
        assert np.ptp(run.trace.tcp_position_m[run.trace.phase == 0, 2]) == pytest.approx(0.03, abs=3e-4)
        assert set(run.trace.phase) == {0, 3}
    assert_it_ends_well(run)


@pytest.mark.parametrize(("event", "rim", "high"), [("", 1, False), ("part-high@0", 1, True), ("", 0, True)])
def test_a_pad_that_leans_finds_the_part_with_its_rim_and_no_part_that_stands_too_high(event, rim, high):
    lean, radius = math.radians(12.0), cells.PAD.radius_m
    touch, early = cells.tool_pose(0.0, -0.5, 0.1, (lean, 0.0, 0.0)), rim * radius * math.tan(lean)
    run = faulty(event, "safety.offset_limit_m=0.002", T_base_touch=touch, height=0.02, early=early).run()
    assert run.stop_reason == (guards.REASONS[guards.HIGH] if high else None)


@pytest.mark.parametrize(
    "name", ["sensor-noise", "latency-jump", "part-shift", "part-loose", "friction-jump"]
)
def test_what_no_guard_must_notice_keeps_the_force_bounded_all_the_same(name):
    assert_it_ends_well(faulty(f"{name}@contact+0.5", slide=0.01).run())


def test_a_fault_happens_at_its_step_whoever_looks_on():
    events = "part-shift@0.7304, sensor-dropout@contact+0.1234, sensor-noise@100"
    onlooker = cells.EachStep(lambda _model, _data: None, 0.007)
    alone, watched = (faulty(events).run(watching) for watching in (Silent(), onlooker))
    assert alone.safety == watched.safety
    assert alone.safety.faults_missed == ("sensor-noise@100",)
    assert alone.safety.fault_time_s == pytest.approx(0.731)
    np.testing.assert_array_equal(alone.trace.normal_force_n, watched.trace.normal_force_n)
    contact = alone.trace.time_s[np.argmax(alone.trace.normal_force_n > 0.5)]
    assert alone.safety.protective_stop_time_s == pytest.approx(contact + 0.124, abs=1e-6)


def test_events_are_read_as_they_are_written_and_what_is_none_is_refused():
    events = parse_events("sensor-dropout@3.2, part-high @ contact + 0.5 ,")
    assert events == (FaultEvent("sensor-dropout", 3.2), FaultEvent("part-high", 0.5, after_contact=True))
    assert ", ".join(map(str, events)) == "sensor-dropout@3.2, part-high@contact+0.5"
    for wrong in ("sensor-dropout", "sensor-dropout@soon", "part-high@-1"):
        with pytest.raises(ConfigError, match="NAME@TIME"):
            parse_events(wrong)
    with pytest.raises(InputError, match=r"part-missing, .*sensor-dropout"):
        parse_events("gremlins@3")


def test_noise_five_times_stronger_raises_the_threshold_of_contact():
    """2.5 N a sample, 1.24 N after the 80 Hz low-pass: five of that are 6.2 N, three times the threshold."""
    cell = faulty("", "sensor.force_noise_n=2.5", hold=1.0)
    run = cell.run()
    floor = cell.state.sequence.floor
    blend = 1.0 - math.exp(-2.0 * math.pi * 80.0 * 0.001)
    assert floor == pytest.approx(5.0 * 2.5 * math.sqrt(blend / (2.0 - blend)), rel=0.2)
    assert run.stop_reason is None
    assert run.trace.normal_force_n[run.trace.fed].min() > 5.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("process.changes='force_n=25'", "NAME=VALUE@TIME"),
        ("process.changes='force_n@3'", "no number"),
        ("process.changes='force=25@3'", "Did you mean 'force_n'"),
        ("process.changes='feed_m_s=0.02@3'", "at most the planned 0.01"),
        ("process.changes='force_n=-3@3'", "out of range"),
        ("process.changes='force_n=10@1'", "no part to press on"),
        ("faults.events=part-high@1", "no part to press on"),
        ("faults.events=sensor-frozen@contact+1", "no part to press on"),
    ],
)
def test_what_cannot_be_made_or_would_change_nothing_is_refused(change, said):
    with pytest.raises((ConfigError, InputError), match=said):
        check_settings(override(default_scenario("arc" if "no part" in said else "force"), [change]))


def test_force_and_feed_set_anew_are_kept_and_what_happens_by_hand_happens_again_when_planned():
    changes = "force_n=45@contact+1, feed_m_s=0.004@contact+1.5, force_n=5@contact+2"
    run = faulty("", f"process.changes='{changes}'", hold=0.0, slide=0.02).run()
    assert run.stop_reason is None
    start = run.trace.time_s[np.argmax(run.trace.normal_force_n > 0.5)]
    for wanted, since in ((20.0, 0.7), (45.0, 1.7), (5.0, 2.7)):
        held = run.trace.normal_force_n[np.abs(run.trace.time_s - start - since) < 0.2]
        assert np.abs(held - wanted).max() < 1.0
    for wanted, since in ((0.01, 1.2), (0.004, 2.5)):
        s = np.interp([start + since - 0.1, start + since + 0.1], run.trace.time_s, run.trace.path_s_m)
        assert (s[1] - s[0]) / 0.2 == pytest.approx(wanted, rel=0.01)

    def by_hand(_model, _data):
        steps = int(cell.state.status.steps)
        for what, at in (("force_n=24.5", 1504), ("feed_m_s=0.003", 1704), ("sensor-drift", 1904)):
            if at - 13 <= steps < at:
                cell.let_happen(what)

    cell = faulty("", hold=2.0, slide=0.02)
    first = cell.run(cells.EachStep(by_hand, 0.013))
    planned = as_planned(cell.scenario, cell.asked)
    assert re.fullmatch(r"force_n=24\.5@[\d.]+, feed_m_s=0\.003@[\d.]+", planned.process.changes)
    changes = f"process.changes='{planned.process.changes}'"
    again = faulty(planned.faults.events, changes, hold=2.0, slide=0.02).run()
    assert all(first.log[name].tobytes() == again.log[name].tobytes() for name in first.log.names)
