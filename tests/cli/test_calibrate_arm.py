"""`calibrate arm` on the command line: simulated arms, a user's file, what a run makes of it, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from polish_sim.dual.calibration.arm import read_arm_calibration, read_tracked


def test_arms_are_found_again_from_the_file_of_their_own_residuals(
    polish_sim: Callable[..., object], tmp_path: Path
) -> None:
    code, out, err = polish_sim("calibrate", "arm", "--seed", "2", "--check", "--out", "found")
    assert code == 0, err
    assert "master: off its table by up to" in out + err
    figures = json.loads((tmp_path / "found" / "metrics.json").read_text())
    assert figures["relative_error_m"] <= 1.5e-4 < 5e-4 < figures["relative_error_nominal_m"]
    assert (tmp_path / "found" / "arms.png").stat().st_size > 10_000
    code, _, err = polish_sim("calibrate", "arm", "--data", "found/residuals.csv", "--out", "again")
    assert code == 0, err
    first, again = (
        read_arm_calibration(tmp_path / name / "calibration.toml", "simulated") for name in ("found", "again")
    )
    np.testing.assert_allclose(again.T_master_follower, first.T_master_follower, atol=1e-4)
    for robot in ("master", "follower"):
        np.testing.assert_allclose(again.tables[robot], first.tables[robot], atol=1e-4)
    assert first.true_tables is not None
    assert again.true_tables is None


def test_a_run_takes_the_arms_as_they_were_found(
    polish_sim: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert polish_sim("calibrate", "arm", "--seed", "1", "--out", "found")[0] == 0
    short = ("--set", "process.max_feed_s=0.3", "--standoff", "5")
    code, _, err = polish_sim("run", "dual", "--calibration", "found/calibration.toml", *short, "--out", "run")
    assert code == 0, err
    code, _, err = polish_sim(
        "run", "dual", "--calibration", "found/calibration.toml", "--set", "dual.arm_poses=60", "--dry-run"
    )
    assert code == 2
    assert "dual.arm_poses beside dual.arms_file" in err
    code, _, err = polish_sim("run", "dual", "--set", "dual.arm_poses=5", "--dry-run")
    assert code == 2
    assert "0 for none, else 20 or more" in err
    monkeypatch.chdir(tmp_path / "run")
    code, out, err = polish_sim("run", "dual", "--config", "config.toml", "--dry-run")
    assert code == 0, err
    assert "all within reach" in out


def test_what_was_measured_with_nominal_arms_is_not_taken_beside_their_tables(
    polish_sim: Callable[..., object], tmp_path: Path
) -> None:
    for kind, *words in (("arm",), ("base",), ("tcp", "--cell-tool")):
        assert polish_sim("calibrate", kind, *words, "--out", kind)[0] == 0
    arms, base, tool = (("--calibration", f"{kind}/calibration.toml") for kind in ("arm", "base", "tcp"))
    poses = ("--set", "dual.arm_poses=60")
    for words, said in (
        ((*arms, *tool), "dual.tool_file beside dual.arms_file"),
        ((*poses, *tool), "dual.tool_file beside dual.arm_poses"),
        ((*arms, *base), "dual.bases_file beside dual.arms_file"),
        ((*poses, *base), "dual.bases_file beside dual.arm_poses"),
    ):
        code, _, err = polish_sim("run", "dual", *words, "--out", "run")
        assert code == 2, said
        assert said in err
        assert ("Leave the tool's file out" if words[-2:] == tool else "Give one of the two") in err
    assert not (tmp_path / "run").exists()


@pytest.fixture
def tracked(polish_sim: Callable[..., object], tmp_path: Path) -> list[str]:
    """Lines of a file of poses: the header, then 20 of each arm."""
    assert polish_sim("calibrate", "arm", "--poses", "20", "--out", "found")[0] == 0
    return (tmp_path / "found" / "residuals.csv").read_text().splitlines()


def test_what_cannot_be_arms_is_refused(polish_sim: Callable[..., object], tmp_path: Path, tracked: list[str]) -> None:
    degrees = [",".join([cells[0], *(str(57.3 * float(q)) for q in cells[1:7]), *cells[7:]])
               for cells in (line.split(",") for line in tracked[1:])]  # fmt: skip
    far = [",".join([*cells[:7], *(str(1e-3 * float(x)) for x in cells[7:10]), *cells[10:]])
           for cells in (line.split(",") for line in tracked[1:])]  # fmt: skip
    for lines, said in (
        (tracked[:-1], "19 poses cannot tell an arm's table"),
        ([line for line in tracked if not line.startswith("follower")], "no measurement of the follower"),
        ([tracked[0].replace("q3_rad", "q3"), *tracked[1:]], "lacks the column q3_rad"),
        ([tracked[0], *degrees], "Are they in degrees?"),
        ([tracked[0], *far], "units"),
        ([tracked[0].replace("x_mm", "x_m"), *tracked[1:]], "mixes units"),
    ):
        (tmp_path / "poses.csv").write_text("\n".join(lines))
        code, _, err = polish_sim("calibrate", "arm", "--data", "poses.csv", "--out", "out")
        assert code == 2, said
        assert said in err
        assert not (tmp_path / "out").exists()


def test_degrees_and_metres_are_read_as_what_they_are(tmp_path: Path, tracked: list[str]) -> None:
    rows = [line.split(",") for line in tracked[1:]]
    head = "robot," + ",".join(f"q{k}_deg" for k in range(1, 7)) + ",x_m,y_m,z_m"
    lines = [
        ",".join(
            [r[0], *(repr(float(np.degrees(float(q)))) for q in r[1:7]), *(repr(1e-3 * float(x)) for x in r[7:10])]
        )
        for r in rows
    ]
    (tmp_path / "si.csv").write_text("\n".join([head, *lines]))
    usual, other = read_tracked(tmp_path / "found" / "residuals.csv"), read_tracked(tmp_path / "si.csv")
    for robot in usual:
        np.testing.assert_allclose(other[robot].q, usual[robot].q, atol=1e-12)
        np.testing.assert_allclose(other[robot].seen, usual[robot].seen, atol=1e-12)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--poses", "19"], "--poses 19 is outside 20 to"),
        (["--length-error", "5"], "--length-error 5 is outside 0 to 2 mm"),
        (["--data", "gone.csv"], "cannot read the measurements 'gone.csv'"),
        (["--data", "gone.csv", "--seed", "1"], "--seed would change nothing with --data"),
    ],
)
def test_options_that_cannot_be_are_refused(
    polish_sim: Callable[..., object], tmp_path: Path, words: list[str], said: str
) -> None:
    code, _, err = polish_sim("calibrate", "arm", *words, "--out", "out")
    assert code == 2
    assert said in err
    assert not list(tmp_path.iterdir())


def test_another_robots_table_is_refused(polish_sim: Callable[..., object], tmp_path: Path) -> None:
    assert polish_sim("calibrate", "arm", "--pair", "cell 7", "--out", "found")[0] == 0
    run = ("run", "dual", "--calibration", "found/calibration.toml", "--dry-run")
    code, _, err = polish_sim(*run)
    assert code == 2
    assert "another pair of robots: 'cell 7'" in err
    file = tmp_path / "found" / "calibration.toml"
    file.write_text(file.read_text().replace("-0.42", "-0.62"))
    code, _, err = polish_sim(*run, "--set", "dual.pair=cell 7")
    assert code == 2
    assert "another robot's, or its rows or units are mixed" in err
