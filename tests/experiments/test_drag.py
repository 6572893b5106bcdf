"""Teach to polish: a hand drags the tool along a part, and a path comes out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from polish_sim.config import DragConfig, HandConfig, Scenario
from polish_sim.errors import PolishSimError
from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.hand_guiding.drag import drag_table
from polish_sim.hand_guiding.experiment import CLAIMS, kind_of

STEADY = {"wander_m": 0.0, "tremor_m": 0.0, "wobble_rad": 0.0}


def dragged(**drag: object) -> Scenario:
    base = default_scenario("teach")
    return replace(base, drag=replace(DragConfig(follow="rim"), **drag))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def run() -> RunResult:
    return run_experiment(dragged())


def test_every_figure_that_is_shown_is_measured(run: RunResult) -> None:
    assert kind_of(run.scenario) == "path"
    assert {claim.figure for claim in CLAIMS["path"]} <= set(run.figures)
    assert run.stop_reason is None


def test_a_taught_path_is_no_worse_than_the_hand_that_showed_it(run: RunResult) -> None:
    """What is left is the slow wander within the surface; what left the surface and the tremor are gone."""
    hand = np.sqrt(3.0 * (run.scenario.drag.wander_m**2 + run.scenario.drag.tremor_m**2))
    assert run.figures["recorded_deviation_rms_m"] == pytest.approx(hand, rel=0.35)
    assert run.figures["taught_deviation_rms_m"] < 0.85 * run.figures["recorded_deviation_rms_m"]
    assert run.figures["taught_axis_error_max_rad"] < 0.5 * run.scenario.drag.wobble_rad


def test_a_steady_hand_teaches_the_rim_but_for_what_its_own_spring_gives() -> None:
    run = run_experiment(dragged(**STEADY))
    assert run.figures["taught_deviation_max_m"] < run.figures["hand_force_peak_n"] / run.scenario.hand.stiffness_n_m
    assert run.figures["taught_missed_max_m"] < 2e-3


def test_the_same_seed_teaches_the_same_path(run: RunResult) -> None:
    again, other = run_experiment(dragged()), run_experiment(replace(dragged(), seed=1))
    assert run.path is not None
    assert again.path is not None
    assert other.path is not None
    np.testing.assert_array_equal(again.path.positions_work, run.path.positions_work)
    assert other.path.positions_work.shape != run.path.positions_work.shape or not np.allclose(
        other.path.positions_work, run.path.positions_work
    )


def test_wander_and_tremor_have_the_size_and_band_asked_for() -> None:
    line = np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 50)
    upright = np.tile(np.eye(3), (50, 1, 1))
    rng, hand, dt = np.random.default_rng(3), HandConfig(), 0.001
    for changed, low, high, size in (
        ({"tremor_m": 0.0}, 0.0, 1.0, 0.0005),
        ({"wander_m": 0.0, "tremor_m": 0.0002}, 7.0, 13.0, 0.0002),
    ):
        made = drag_table(line, upright, replace(DragConfig(follow="rim"), **changed), hand, dt, rng)  # type: ignore[arg-type]
        off = (made.table.motion.positions - made.meant.positions)[2000:]
        power = np.abs(np.fft.rfft(off, axis=0)) ** 2
        at = np.fft.rfftfreq(len(off), dt)
        assert power[(at >= low) & (at <= high)].sum() > 0.9 * power.sum()
        assert np.sqrt(np.mean(off**2)) == pytest.approx(size, rel=0.15)


def test_the_hand_goes_from_end_to_end_at_its_speed() -> None:
    line = np.linspace([0.0, 0.0, 0.0], [0.5, 0.0, 0.0], 50)
    drag = replace(DragConfig(follow="rim"), **STEADY)
    meant = drag_table(line, np.tile(np.eye(3), (50, 1, 1)), drag, HandConfig(), 0.001, np.random.default_rng(0)).meant
    assert meant.positions[0, 0] == 0.0
    assert meant.positions[-1, 0] == pytest.approx(0.5, abs=1e-9)
    assert meant.velocities[:, 0].max() == pytest.approx(drag.speed_m_s, rel=1e-3)
    assert np.abs(np.diff(meant.velocities[:, 0])).max() / 0.001 < 0.2


def test_an_arm_that_stops_itself_teaches_no_path() -> None:
    asked = dragged(speed_m_s=0.2)
    run = run_experiment(replace(asked, guide=replace(asked.guide, tool_speed_limit_m_s=0.06)))
    assert run.stop_reason is not None
    assert run.path is None
    assert len(run.log)


def test_a_path_that_is_none_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "path.csv"
    file.write_text("x,y,z,i,j,k\n0,0,0,0,0,1\n")
    with pytest.raises(PolishSimError, match=r"path.csv"):
        run_experiment(dragged(follow=str(file)))
