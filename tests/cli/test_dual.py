"""`run dual` on the command line: which calibration goes where, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


def test_a_calibration_is_taken_for_what_it_is_of(polish_sim: Callable[..., object], tmp_path: Path) -> None:
    assert polish_sim("calibrate", "base", "--out", "base")[0] == 0
    code, out, _ = polish_sim("run", "dual", "--calibration", "base/calibration.toml", "--dry-run")
    assert code == 0
    assert "all within reach" in out
    assert polish_sim("calibrate", "base", "--pair", "cell 7", "--out", "other")[0] == 0
    code, _, err = polish_sim("run", "dual", "--calibration", "other/calibration.toml", "--out", "run")
    assert code == 2
    assert "another pair of robots: 'cell 7'" in err
    assert polish_sim("calibrate", "tcp", "--out", "tool")[0] == 0
    code, _, err = polish_sim("run", "dual", "--calibration", "tool/calibration.toml", "--out", "run")
    assert code == 2
    assert "from the cell's tool" in err
    assert "calibrate tcp --cell-tool" in err
    assert not (tmp_path / "run").exists()
    assert polish_sim("calibrate", "tcp", "--cell-tool", "--seed", "3", "--check", "--out", "own")[0] == 0
    code, out, _ = polish_sim("run", "dual", "--calibration", "own/calibration.toml", "--dry-run")
    assert code == 0
    assert "all within reach" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--stepover", "3"], "--stepover would change nothing in 'run dual'"),
        (["--mode", "assist"], "--mode would change nothing in 'run dual'"),
        (["--standoff", "200"], "--standoff 200 is outside 0 to 100 mm"),
        (["--master-path", "gone.csv"], "cannot read the poses 'gone.csv'"),
        (
            ["--master-path", "way.csv", "--master-turn", "3"],
            "--master-path says where the part goes: leave --master-turn out",
        ),
        (["--master-turn", "300"], "--master-turn 300 is outside -180 to 180 deg/s"),
        (["--calibration", "gone.toml"], "cannot read the calibration 'gone.toml'"),
    ],
)
def test_what_a_run_of_two_robots_cannot_take_is_refused(
    polish_sim: Callable[..., object], tmp_path: Path, words: list[str], said: str
) -> None:
    code, _, err = polish_sim("run", "dual", *words, "--out", "run")
    assert code == 2
    assert said in err
    assert not list(tmp_path.iterdir())


def test_two_robots_are_idle_elsewhere(polish_sim: Callable[..., object]) -> None:
    code, _, err = polish_sim("plan", "plate", "--master-turn", "5")
    assert code == 2
    assert "--master-turn is for two robots: give --dual as well" in err
    code, _, err = polish_sim("run", "surface", "--standoff", "5")
    assert code == 2
    assert "--standoff would change nothing in 'run surface'" in err


def test_a_plan_for_two_says_where_the_part_is_held_and_is_run(
    polish_sim: Callable[..., object], tmp_path: Path
) -> None:
    code, out, _ = polish_sim("plan", "wheel_hub_rim", "--dual", "--out", "plan")
    assert code == 0
    assert "path length" in out
    figures = json.loads((tmp_path / "plan" / "metrics.json").read_text())
    assert figures["chain_residual_m"] < 1e-9
    assert figures["placement_value"] > 0.1
    assert len(figures["q_master_rad"]) == len(figures["q_follower_rad"]) == 6
    run = ("run", "dual", "--path", "plan", "--set", "process.max_feed_s=0.5")
    code, _, err = polish_sim(*run, "--out", "run")
    assert code == 0, err
    planned, ran = (
        np.loadtxt(tmp_path / name / "path.csv", delimiter=",", skiprows=1, usecols=(0, 1, 2))
        for name in ("plan", "run")
    )
    np.testing.assert_allclose(ran, planned, atol=1e-9)
    code, _, err = polish_sim(*run, "--region", "all", "--out", "again")
    assert code == 2
    assert "--path is a finished plan: leave --region out" in err
    code, _, err = polish_sim(
        "plan", "wheel_hub_rim", "--dual", "--set", "dual.follower_pose=[-2.5,0,0,0,0,3]", "--out", "far"
    )
    assert code == 2
    assert "--set dual.follower_pose=[-1.1,0,0,0,0,3.1416]" in err
    assert not (tmp_path / "far").exists()
