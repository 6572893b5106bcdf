"""`polish-sim identify` as a user calls it."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from polish_sim.cli.identification import simulated
from polish_sim.identification.settings import IdentifySettings
from tests.identification.motions import known_robot, noisy

Tool = Callable[..., Any]
NAMES = ["time_s", *(f"q{j}_rad" for j in range(1, 7)), *(f"torque{j}_nm" for j in range(1, 7))]


def _log(file: Path, still: int | None = None) -> Path:
    """A log of one period, as a user might bring it; a joint may stand still."""
    known = known_robot(4000)
    coefficients = known.motion.coefficients.copy()
    if still is not None:
        coefficients[still, 1:] = 0.0
    t = np.arange(4000) / 400.0
    states = type(known.motion)(coefficients)(t)
    torque = noisy(known.model.torque(states, known.model.truth()), np.random.default_rng(0))
    table = np.column_stack([t, states.q, torque])
    np.savetxt(file, table, delimiter=",", header=",".join(NAMES), comments="")
    return file


def test_a_log_becomes_a_model_with_a_table_and_figures(polish_sim: Tool, tmp_path: Path) -> None:
    call = polish_sim("identify", "--data", _log(tmp_path / "log.csv"), "--period", 10, "--out", "found", "--check")
    assert call.code == 0, call.err
    assert {path.name for path in Path("found").iterdir()} == {
        "identified.xml", "parameters.csv", "metrics.json", "torques.png",
    }  # fmt: skip
    metrics = json.loads(Path("found/metrics.json").read_text(encoding="utf-8"))
    assert metrics["base_parameters"] == 58
    assert metrics["error_over_crb"] is None
    rows = list(csv.DictReader(Path("found/parameters.csv").read_text(encoding="utf-8").splitlines()))
    friction = {row["name"]: row for row in rows if row["identifiable"] == "alone"}
    assert float(friction["fc1"]["value"]) == pytest.approx(5.0, abs=5 * float(friction["fc1"]["std"]))
    model = mujoco.MjModel.from_xml_path("found/identified.xml")
    assert model.dof_frictionloss[0] == pytest.approx(5.0, abs=0.3)
    mujoco.mj_step(model, mujoco.MjData(model))


def test_the_simulated_arm_leaves_its_files(tmp_path: Path) -> None:
    outcome = simulated(IdentifySettings(periods=1, iterations=5), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "identified.xml", "parameters.csv", "metrics.json", "torques.png", "motion.png",
    }  # fmt: skip
    assert outcome.experiment == "identify-short"
    metrics = json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))
    assert len(metrics["nrms_heldout"]) == 6
    assert metrics["condition"] > 1.0


def test_the_report_says_what_torques_can_tell(polish_sim: Tool) -> None:
    call = polish_sim("identify", "--report")
    assert call.code == 0
    assert "the 58 base parameters" in call.out
    assert not list(Path().iterdir())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--method", "guess"], "unknown method 'guess'. Known: joint, stepwise."),
        (["--objective", "best"], "unknown objective 'best'"),
        (["--periods", "0"], "at least one whole period"),
        (["--period", "5"], "--period belongs to --data"),
        (["--data", "none.csv"], "cannot read the log 'none.csv'"),
        (["--data", "none.csv", "--seed", "3"], "--seed would change nothing with --data"),
        (["--data", "none.csv", "--period", "-1"], "more than 0 s"),
    ],
)
def test_bad_usage_is_one_message_and_writes_nothing(polish_sim: Tool, words: list[str], said: str) -> None:
    call = polish_sim("identify", *words)
    assert call.code == 2
    assert said in call.err
    assert not list(Path().iterdir())


def test_a_joint_that_stood_still_is_named(polish_sim: Tool, tmp_path: Path) -> None:
    call = polish_sim("identify", "--data", _log(tmp_path / "log.csv", still=4), "--period", 10, "--out", "found")
    assert call.code == 2
    assert "wrist_2_joint did not move" in call.err
    assert not Path("found").exists()
