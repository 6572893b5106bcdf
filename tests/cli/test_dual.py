"""`run dual` on the command line: which calibration goes where, and what is refused."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from polish_sim.spatial import from_pose


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


def test_calibrations_of_bases_and_tool_are_both_taken_and_the_cell_stands_as_they_were_made(
    polish_sim: Callable[..., object], tmp_path: Path
) -> None:
    assert polish_sim("calibrate", "base", "--seed", "1", "--out", "base")[0] == 0
    assert polish_sim("calibrate", "tcp", "--cell-tool", "--out", "tool")[0] == 0
    both = ("--calibration", "base/calibration.toml", "--calibration", "tool/calibration.toml")
    short = ("--set", "process.max_feed_s=0.3", "--standoff", "5")
    code, _, err = polish_sim("run", "dual", *both, *short, "--out", "run")
    assert code == 0, err
    settings = tomllib.loads((tmp_path / "run" / "config.toml").read_text(encoding="utf-8"))["dual"]
    assert Path(settings["bases_file"]).parent.name == "base"
    assert Path(settings["tool_file"]).parent.name == "tool"
    planted = json.loads((tmp_path / "base" / "metrics.json").read_text(encoding="utf-8"))["true_transform"]
    np.testing.assert_allclose(from_pose(settings["follower_pose"]), planted, atol=1e-12)
    code, _, err = polish_sim("run", "dual", "--config", "run/config.toml", "--dry-run")
    assert code == 0, err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--calibration", "base/calibration.toml", "--calibration", "base/calibration.toml"], "give one of each"),
        (["--calibration", "base/calibration.toml", "--set", "dual.follower_pose=[-1.1,0.01,0,0,0,3]"],
         "leave one of them out"),
    ],
)  # fmt: skip
def test_calibrations_that_contradict_are_refused(
    words: list[str], said: str, polish_sim: Callable[..., object], tmp_path: Path
) -> None:
    assert polish_sim("calibrate", "base", "--out", "base")[0] == 0
    code, _, err = polish_sim("run", "dual", *words, "--out", "run")
    assert code == 2
    assert said in err.replace("\n", " ")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("spoil", ["transform", "pair", "true_transform", "all"])
def test_a_spoilt_calibration_is_one_message(spoil: str, polish_sim: Callable[..., object], tmp_path: Path) -> None:
    assert polish_sim("calibrate", "base", "--out", "base")[0] == 0
    file = tmp_path / "base" / "calibration.toml"
    text = file.read_text(encoding="utf-8")
    start = text.index(f"\n{spoil} =") + 1 if spoil != "all" else 0
    file.write_text(text[:start] + f"{spoil} = [[1.0, nan]]\n" if start else "\x00\x01", encoding="utf-8")
    code, out, err = polish_sim("run", "dual", "--calibration", "base/calibration.toml", "--out", "run")
    assert (code, out) == (2, "")
    assert "calibration.toml'" in err
    assert not (tmp_path / "run").exists()


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


def test_a_fault_of_the_master_is_one_of_a_run_of_two(polish_sim: Callable[..., object]) -> None:
    code, _, err = polish_sim("run", "dual", "--fault", "master-stop@contact+1", "--dry-run")
    assert code == 0, err
    code, _, err = polish_sim("run", "surface", "--fault", "master-stop@1", "--dry-run")
    assert code == 2
    assert "there is no second robot: it is one of 'run dual'" in err


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
    assert "--set dual.follower_pose=[-1.1,0,0,0,0,3.14159265]" in err
    assert not (tmp_path / "far").exists()
