"""The pad pressed on a spring: the cell's borders of stability lie where the linear model has them."""

import json
from dataclasses import replace

import pytest

from benchmarks.force_margins import press
from benchmarks.loop_margins import analytic_margins
from polish_sim.cli.score import show_border
from polish_sim.config import Scenario
from polish_sim.experiments import default_scenario
from polish_sim.row_file import Rows
from polish_sim.scenario_file import override
from polish_sim.scoring.border import MODEL, Rest, build_bench, measure_border
from polish_sim.scoring.score import user_entry
from polish_sim.workers import Here, Result, Runner

SETTINGS = ["robot.arm=ideal", "controller.force_filter_hz=10"]
FORCE = override(default_scenario("force"), SETTINGS)
"""The loop of the model: a stiff arm. With a slower filter limits of speed bend the border first."""


def test_gain_and_delay_margins_of_the_model_hold_in_the_cell_within_8_and_5_percent():
    margins, bench = analytic_margins(FORCE), build_bench(FORCE)

    def later(delay: float) -> Scenario:
        latency = FORCE.robot.command_latency_s + delay
        return replace(FORCE, robot=replace(FORCE.robot, command_latency_s=latency))

    rest = press(bench, FORCE)
    assert rest.resting
    assert rest.offset == pytest.approx(0.0, abs=0.1)
    assert press(bench, FORCE, 0.92 * margins.gain, friction=False).resting
    beyond = press(bench, FORCE, 1.08 * margins.gain, friction=False)
    assert not beyond.resting
    assert beyond.frequency == pytest.approx(margins.phase_crossover, rel=0.1)
    assert press(bench, later(0.95 * margins.delay), friction=False).resting
    beyond = press(bench, later(1.05 * margins.delay), friction=False)
    assert not beyond.stable
    assert beyond.frequency == pytest.approx(margins.crossover, rel=0.1)


def test_border_of_the_cell_lies_on_that_of_the_model_and_a_lost_run_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr("polish_sim.scoring.border.FINE_SCALES", (1.0, 3.0))
    entry = user_entry("hybrid-pi", SETTINGS)
    border = measure_border([entry], Runner(Rows(tmp_path), Here()), (1.0, 3.0), (0.008, 0.06))
    line = dict(zip(border.line_scales, border.lines["hybrid-pi"], strict=True))
    stable = [[rest.stable for rest in row] for row in border.rests["hybrid-pi"]]
    assert stable == [[latency <= line[scale] for scale in (1.0, 3.0)] for latency in (0.008, 0.06)]

    class Dying(Here):
        def results(self, tasks, work, group_of):
            for task in tasks:
                lost = "springs x 1, " in str(task)
                yield Result(task, None if lost else work(task), "died" if lost else None)

    def row(task):
        return {"longest_s": 0.02} if task.case.text == MODEL else Rest(True, True, 0.0, 0.0, 0.0)._asdict()

    monkeypatch.setattr("polish_sim.scoring.border.border_row", row)
    runner = Runner(Rows(tmp_path), Dying())
    border = measure_border([user_entry("hybrid-pi")], runner, (1.0, 3.0), (0.008, 0.06))
    assert [[rest.stable for rest in row] for row in border.rests["hybrid-pi"]] == [[None, True]] * 2
    assert runner.lost == 3
    assert show_border(border, tmp_path) == 0
    found = json.loads((tmp_path / "border.json").read_text())["controllers"]["hybrid-pi"]
    assert found["latency_stable_s"] == [None, 0.06]
    assert found["latency_stable_model_s"][0] is None
