"""A search finds what a controller does badly, and what it found can be run again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import qmc

from polish_sim.errors import InputError
from polish_sim.experiments import run_experiment
from polish_sim.row_file import Rows
from polish_sim.scoring import user_entry
from polish_sim.scoring.worst import FIGURES, LISTS, RANGES, drawn_task, first_tasks, search_worst, size_of
from polish_sim.workers import Here, Runner
from tests.kept import plate_file


def test_position_control_is_found_to_press_with_more_than_twice_the_force_and_its_run_repeats(tmp_path):
    short = ["plan.stepover_m=0.04", "plan.edge_margin_m=0.03", "process.max_feed_s=1"]
    entry, heard = user_entry("position", short), []
    rows = search_worst(entry, 3, Runner(Rows(tmp_path), Here(), lambda *at: heard.append(at[:2])))
    assert len(rows) == 3
    assert heard == [(done, 3) for done in range(4)]
    peak = max(rows, key=lambda task: size_of(rows[task], "largest_force_n"))
    # A part 2 mm too high on springs as drawn presses with 10 N more.
    assert rows[peak]["largest_force_n"] > 40.0
    assert max(size_of(row, "max_error_n") for row in rows.values()) > 20.0
    assert all(figure in rows[peak] for figure in FIGURES.values())
    again = run_experiment(peak.scenario)
    assert again.figures["peak_force_n"] == pytest.approx(rows[peak]["largest_force_n"])
    assert again.stop_reason.startswith(rows[peak]["protective_stop"][:30])


class Planted:
    """Rows whose figures are known from the scenario: largest in a corner, along an edge, and at a point."""

    interrupted = False

    def fill(self, keys, *_, heard):
        return {task: self.row(task.scenario) for task in keys}

    def row(self, drawn):
        part, process = drawn.part, drawn.process
        keys = part.displacement_m, part.rotation_rad, drawn.robot.command_latency_s
        keys += process.approach_speed_m_s, process.feed_m_s
        others = "part.file", "head", "seed", "sensor"
        ends = [RANGES[name] for name in RANGES if not name.startswith(others)]
        off, turn, late, fast, fed = ((v - a) / (b - a) for v, (a, b) in zip(keys, ends, strict=True))
        miss = abs(late - 0.3) + abs(fed - 0.3) + abs(turn - 0.3)
        most, lost = off + fast + late, max(0.0, fed - 0.8) * off
        return {"largest_force_n": most, "contact_lost_s": lost, "max_error_n": 2.0 - miss, "duration": 2.0}


def test_a_search_finds_more_than_runs_spread_evenly_and_a_controller_no_run_starts_with_is_refused(tmp_path):
    entry, planted, runs = user_entry("hybrid-pi"), Planted(), 400
    rows = search_worst(entry, runs, planted)
    low, high = np.array([*RANGES.values()]).T
    even = low + (high - low) * qmc.Sobol(len(RANGES), rng=1).random(1024)[:runs]
    spread = [planted.row(drawn_task(entry, x).scenario) for x in even]
    assert len(rows) == runs
    for figure in FIGURES.values():
        assert max(row[figure] for row in rows.values()) > max(row[figure] for row in spread)
    entry = user_entry("hybrid-pi", ["part.pose=[3.0, 0.0, 0.0, 0.0, 0.0, 0.0]"])
    with pytest.raises(InputError, match="no run could be set up: not run: the part cannot stand"):
        search_worst(entry, 2, Runner(Rows(tmp_path), Here()))


def test_the_ends_of_the_ranges_are_scenarios_and_a_setting_of_the_controller_s_own_is_not_searched():
    for end in (0, 1):
        x = np.array([bounds[end] for bounds in RANGES.values()])
        drawn = drawn_task(user_entry("hybrid-pi"), x).scenario
        assert drawn.head.spring_scale == LISTS["head.spring_scale"][-end]
        assert drawn.part.displacement_m == RANGES["part.displacement_m"][end]
        assert drawn.process.feed_m_s == RANGES["process.feed_m_s"][end]
        assert drawn.seed >= 500
    entry = user_entry("hybrid-pi", ["process.feed_m_s=0.02"])
    assert {task.scenario.process.feed_m_s for task in first_tasks(entry)} == {0.02}


def test_the_stiffest_springs_late_commands_and_a_fast_approach_do_not_make_the_shipped_laws_strike():
    x = np.array([most for _, most in RANGES.values()])
    landing = [f"part.file={plate_file()}", "plan.edge_margin_m=0.06", "process.max_feed_s=0.3"]
    for controller in ("hybrid-pi", "hybrid-adaptive"):
        for seed in (611, 612, 613):
            drawn = drawn_task(user_entry(controller, landing), x).scenario
            run = run_experiment(replace(drawn, seed=seed))
            assert run.figures["peak_force_n"] <= 25.0
