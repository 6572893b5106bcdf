"""Same scenario and seed, same bytes; nothing that only looks on changes a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from polish_sim.cell import Silent
from polish_sim.config import Scenario
from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.log import RunLog, read_log, write_log
from polish_sim.planning import PlanResult
from polish_sim.scenario_file import load_scenario, override, to_toml
from tests.cell.cells import along_tool, cell_for, part_under, pressing_stroke, tool_pose, way_through
from tests.cell.fields import plane

Cap = tuple[Scenario, PlanResult]


def same(one: RunLog, other: RunLog) -> bool:
    return all(one[name].tobytes() == other[name].tobytes() for name in one.names)


@pytest.fixture(scope="module")
def short_force() -> RunResult:
    """One second of pressing."""
    return run_experiment(override(default_scenario("force"), ["process.hold_s=1"]))


def test_the_same_seed_gives_the_same_bytes(cap: Cap, cap_run: RunResult, tmp_path: Path) -> None:
    again = run_experiment(*cap)
    assert same(cap_run.log, again.log)
    assert all(np.array_equal(a, b) for a, b in zip(cap_run.trace, again.trace, strict=True))
    for name, result in (("a", cap_run), ("b", again)):
        write_log(tmp_path / name, result.log)
    assert same(read_log(tmp_path / "a"), read_log(tmp_path / "b"))


def test_another_seed_gives_another_part_and_other_noise(cap: Cap, cap_run: RunResult) -> None:
    scenario, plan = cap
    other = run_experiment(override(scenario, ["seed=1"]), plan)
    assert not same(cap_run.log, other.log)
    assert other.figures["force_rms_error_n"] != cap_run.figures["force_rms_error_n"]


def test_the_written_config_runs_to_the_same_bytes(tmp_path: Path) -> None:
    first = run_experiment(override(default_scenario("force"), ["seed=7", "process.hold_s=1"]))
    path = tmp_path / "config.toml"
    path.write_text(to_toml(first.scenario), encoding="utf-8")
    assert same(first.log, run_experiment(load_scenario(path, default_scenario("arc"))).log)


@pytest.mark.parametrize("every_s", [0.001, 0.007, 0.04, 3.0])
def test_who_looks_on_how_often_changes_nothing(short_force: RunResult, every_s: float) -> None:
    class Onlooker(Silent):
        frame_every_s = every_s

    assert same(short_force.log, run_experiment(short_force.scenario, observer=Onlooker()).log)


@pytest.mark.parametrize("every_s", [0.011, 1.0])
def test_nor_does_it_when_strokes_follow_each_other(every_s: float) -> None:
    class Onlooker(Silent):
        frame_every_s = every_s

    second = tool_pose(0.02, -0.5, 0.1)
    way = way_through(along_tool(tool_pose(0.0, -0.5, 0.1), z=-0.005), along_tool(second, z=-0.005))
    strokes = pressing_stroke(hold=0.3, lift=0.005), pressing_stroke(second, hold=0.3, lift=0.005)._replace(travel=way)
    runs = [
        cell_for(default_scenario("force"), *strokes, part=part_under(plane())).run(who) for who in (None, Onlooker())
    ]
    assert runs[0].stop_reason is None
    assert same(runs[0].log, runs[1].log)


def test_the_log_rate_thins_the_rows_and_changes_nothing_else(short_force: RunResult) -> None:
    rates = {0: 1, 250: 4, 100: 10}
    assert short_force.scenario.simulation.log_rate_hz == 250
    runs = {250: short_force} | {
        rate: run_experiment(override(short_force.scenario, [f"simulation.log_rate_hz={rate}"])) for rate in (0, 100)
    }
    for rate, every in rates.items():
        for name in ("time_s", "tcp_position_m", "wrench_measured_tool", "command_twist", "phase"):
            np.testing.assert_array_equal(runs[rate].log[name], runs[0].log[name][::every])
        np.testing.assert_array_equal(runs[rate].trace.normal_force_n, runs[0].trace.normal_force_n)


def test_least_and_largest_force_cover_the_steps_between_the_rows() -> None:
    scenario = override(default_scenario("force"), ["process.hold_s=1", "simulation.log_rate_hz=50"])
    result = run_experiment(scenario)
    force = result.trace.normal_force_n.astype(np.float32)
    for row, (least, largest) in enumerate(zip(*_extremes(result), strict=True)):
        between = force[max(0, 20 * (row - 1) + 1) : 20 * row + 1]
        assert least == between.min()
        assert largest == between.max()


def _extremes(result: RunResult) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(result.log["normal_force_min_n"]), np.asarray(result.log["normal_force_max_n"])
