"""A search finds what a controller does badly, and what it found can be run again."""

from dataclasses import replace

import numpy as np
import pytest

from polish_sim.experiments import run_experiment
from polish_sim.scoring.worst import FIGURES, RANGES, STIFFER, drawn_scenario, search_worst, worst_base


def test_position_control_is_found_to_press_with_more_than_twice_the_force_and_its_run_repeats():
    worst = search_worst(worst_base("position"), 9, lambda *_: None)
    assert worst.runs == 9
    assert set(worst.found) == set(FIGURES)
    peak = worst.found["worst_peak_force_n"]
    assert peak.value > 40.0  # [N]; a part 2 mm too high on springs as drawn presses with 10 N more
    assert worst.found["worst_error_n"].value > 20.0
    again = run_experiment(peak.scenario)
    assert again.figures["peak_force_n"] == pytest.approx(peak.value)
    assert again.stop_reason == (peak.stopped or None)


def test_the_ends_of_the_ranges_are_scenarios():
    for end in (0, 1):
        drawn = drawn_scenario(worst_base("hybrid-pi"), np.array([bounds[end] for bounds in RANGES.values()]))
        assert drawn.head.spring_scale == STIFFER[-end]
        assert drawn.part.displacement_m == RANGES["part.displacement_m"][end]
        assert drawn.process.feed_m_s == RANGES["process.feed_m_s"][end]
        assert drawn.seed >= 500


def test_the_stiffest_springs_late_commands_and_a_fast_approach_do_not_make_the_shipped_laws_strike():
    x = dict(zip(RANGES, (bounds[1] for bounds in RANGES.values()), strict=True))
    for controller in ("hybrid-pi", "hybrid-adaptive"):
        for seed in (611, 612, 613):
            drawn = drawn_scenario(worst_base(controller), np.array([*{**x, "part": 0.0}.values()]))
            run = run_experiment(replace(drawn, seed=seed))
            assert run.figures["peak_force_n"] <= 25.0
