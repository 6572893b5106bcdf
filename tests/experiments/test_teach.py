"""Hand guiding: what the hand feels in every mode, what the arm does without it, and that it never runs away."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from polish_sim.config import GuideConfig, HandConfig, Scenario
from polish_sim.errors import InputError
from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.hand_guiding.arm import home_pose, torque_arm
from polish_sim.hand_guiding.cell import WIDTH, GuidingRun
from polish_sim.hand_guiding.experiment import CLAIMS
from polish_sim.hand_guiding.figures import compare_modes
from polish_sim.hand_guiding.law import MODES
from polish_sim.hand_guiding.teach import PlayedMove, figures_of_moves, minimum_jerk, move_table, moves_of
from polish_sim.identification.arm import ARM_JOINTS
from polish_sim.identification.model_file import IdentifiedJoints, identified_xml
from polish_sim.identification.robot_model import own_parameters

GRIP = {"turn_stiffness_nm_rad": 30.0, "turn_damping_nm_s_rad": 10.0}


def scenario(hand: dict[str, float] | None = None, **guide: object) -> Scenario:
    base = default_scenario("teach")
    return replace(
        base, guide=replace(GuideConfig(), **guide), hand=replace(HandConfig(), **({"off_s": 5.0} | (hand or {})))
    )  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def trial() -> RunResult:
    return run_experiment(scenario())


def test_every_figure_that_is_shown_is_measured(trial: RunResult) -> None:
    assert {claim.figure for claim in CLAIMS["trial"]} <= set(trial.figures)
    assert trial.figures["path_done"] == 1.0
    assert trial.stop_reason is None


def test_inertia_compensation_takes_what_is_asked_off_the_classical_law(trial: RunResult) -> None:
    for direction in "xy":
        assert trial.figures[f"fast_peak_ratio_{direction}"] <= 0.45
        assert trial.figures[f"fast_rms_ratio_{direction}"] <= 0.30
    assert trial.figures["slow_peak_n"] <= 10.0


def test_each_step_of_compensation_lightens_the_slow_move(trial: RunResult) -> None:
    for direction in "xy":
        felt = [trial.figures[f"{mode}_{direction}_slow_hand_force_rms_n"] for mode in MODES]
        assert felt == sorted(felt, reverse=True)


def test_every_move_is_in_the_log_with_the_hand_s_force(trial: RunResult) -> None:
    case, force = np.asarray(trial.log["case"]), np.linalg.norm(np.asarray(trial.log["hand_force_n"]), axis=1)
    moving = np.asarray(trial.log["phase"]) == 2
    for number, name in enumerate(trial.figures["moves"]):
        peak = trial.figures[f"{name}_hand_force_peak_n"]
        assert force[moving & (case == number)].max() == pytest.approx(peak, rel=0.02)


def test_an_arm_nobody_holds_stays_where_it_is(trial: RunResult) -> None:
    assert trial.figures["drift_time_s"] == pytest.approx(4.0, abs=0.01)
    assert trial.figures["drift_rad"] < np.radians(0.01)


def test_the_move_is_minimum_jerk() -> None:
    way, speed = minimum_jerk(np.array([-1.0, 0.0, 0.5, 1.0, 2.0]))
    np.testing.assert_allclose(way, [0.0, 0.0, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(speed, [0.0, 0.0, 1.875, 0.0, 0.0])


def test_inertia_taken_for_a_fifth_more_than_it_is_stays_stable() -> None:
    run = run_experiment(scenario(GRIP, mode="inertia", duration_s=0.6, inertia_share=0.8 * 1.2))
    assert run.stop_reason is None
    assert run.figures["drift_rad"] < np.radians(0.01)


@pytest.mark.parametrize("friction_scale", [0.8, 1.6])
def test_wrong_friction_is_felt_or_stopped_but_never_runs_away(friction_scale: float) -> None:
    asked = scenario(GRIP, mode="inertia", direction="x", duration_s=0.6, friction_scale=friction_scale)
    run = run_experiment(asked)
    speeds = np.abs(np.asarray(run.log["qd_rad_s"]))
    assert speeds.max() < 1.1 * asked.guide.joint_speed_limit_rad_s
    assert np.asarray(run.log["tcp_speed_m_s"]).max() < 1.1 * asked.guide.tool_speed_limit_m_s
    assert (run.stop_reason is not None) == (friction_scale > 1.0)


def test_a_law_that_drives_by_itself_is_stopped_by_its_energy() -> None:
    wild = {"mode": "classical", "direction": "x", "duration_s": 0.6, "coulomb_share": 1.8}
    run = run_experiment(scenario(GRIP, **wild, energy_limit_j=1.0))
    assert run.stop_reason is not None
    assert "more energy than guide.energy_limit_j" in run.stop_reason
    assert run.figures["lent_energy_j"] == pytest.approx(1.0, abs=0.1)
    assert run.figures["path_done"] == 0.0


def cut(rows: int, stop_step: int = 0, interrupted: bool = False) -> PlayedMove:
    """The first rows of a fast move, at rest."""
    asked = scenario(mode="gravity", direction="x", duration_s=0.6)
    move = moves_of(asked.guide, asked.hand)[0]
    table = move_table(move, asked.hand, home_pose(), 0.001)
    reason = "links touch" if stop_step else None
    run = GuidingRun(np.zeros((rows, WIDTH)), np.tile(np.eye(3), (rows, 1, 1)), reason, stop_step, interrupted, 0.0)
    return PlayedMove(move, table, run)


@pytest.mark.parametrize(
    ("play", "whole"),
    [
        (cut(1400, interrupted=True), False),
        (cut(1900, interrupted=True), True),
        (cut(1400, stop_step=900), False),
        (cut(1900, stop_step=1400), False),
        (cut(2400, stop_step=1900), True),
    ],
    ids=["interrupted in it", "interrupted after it", "stopped before it", "stopped in it", "stopped after it"],
)
def test_only_a_whole_move_has_a_force(play: PlayedMove, whole: bool) -> None:
    """The hand moves from 1.1 s to 1.7 s; what brakes record of it after a stop is not the hand's move."""
    figures = figures_of_moves(scenario(), [play], 1, 1.0)
    assert np.isfinite(figures["hand_force_peak_n"]) == whole
    assert np.isfinite(figures["hand_force_rms_n"]) == whole


@pytest.mark.parametrize("order", [1, -1])
def test_one_move_cut_short_leaves_its_mode_without_a_peak(order: int) -> None:
    """The largest of a known and an unknown force is unknown, whichever came first."""
    played = [cut(2400), cut(1400, interrupted=True)][::order]
    assert np.isnan(figures_of_moves(scenario(), played, 2, 1.0)["hand_force_peak_n"])
    forces = [{"hand_force_peak_n": 20.0, "hand_force_rms_n": 9.0}, {"hand_force_peak_n": np.nan}][::order]
    modes = compare_modes(dict(zip(("classical_x_slow", "classical_y_slow"), forces, strict=True)))
    assert np.isnan(modes["classical_peak_n"])
    assert np.isnan(compare_modes(dict(zip(("assist_x_slow", "assist_y_slow"), forces, strict=True)))["slow_peak_n"])


def test_an_identified_model_is_as_good_as_the_true_one(tmp_path: Path) -> None:
    file = tmp_path / "identified.xml"
    parameters = own_parameters(torque_arm(Scenario()), ARM_JOINTS)
    file.write_text(identified_xml(ARM_JOINTS, IdentifiedJoints(parameters)))
    move = {"mode": "assist", "direction": "x", "duration_s": 0.6}
    true, identified = (run_experiment(scenario(**move, **more)) for more in ({}, {"model_file": str(file)}))
    for figure in ("hand_force_peak_n", "hand_force_rms_n"):
        assert identified.figures[figure] == pytest.approx(true.figures[figure], rel=0.02)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"mode": "float"}, "unknown mode 'float'"), ({"direction": "z"}, r"unknown direction 'z'. Known: x, y")],
)
def test_unknown_names_list_the_known_ones(wrong: dict[str, str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        run_experiment(scenario(**wrong))
