"""`calibrate arm` on the command line: simulated arms, a user's file, a run with them, refusals."""

from pathlib import Path

import numpy as np
import pytest

from polish_sim.cli.boundary import execute
from polish_sim.cli.main import commands
from polish_sim.dual.calibration.arm import read_arm_calibration, read_tracked
from tests.cli.conftest import assert_refused, done, metrics_of, refused


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one calibration of two arms, made once."""
    folder = tmp_path_factory.mktemp("arms") / "found"
    words = ["calibrate", "arm", "--seed", "2", "--pair", "cell 7", "--check", "--out", str(folder)]
    assert execute(commands, words) == 0  # with its picture
    return folder


def test_arms_are_found_again_from_their_residuals(found, polish_sim):
    figures = metrics_of(found)
    assert figures["relative_error_m"] <= 1.5e-4 < 5e-4 < figures["relative_error_nominal_m"]
    assert (found / "arms.png").stat().st_size > 10_000
    words = ("--data", found / "residuals.csv", "--pair", "cell 7", "--out", "again")
    _, out, err = done(polish_sim("calibrate", "arm", *words))
    assert "master: off its table by up to" in out + err
    files = (folder / "calibration.toml" for folder in (found, Path("again")))
    first, again = (read_arm_calibration(file, "cell 7") for file in files)
    np.testing.assert_allclose(again.T_master_follower, first.T_master_follower, atol=1e-4)
    for robot in ("master", "follower"):
        np.testing.assert_allclose(again.tables[robot], first.tables[robot], atol=1e-4)
    assert first.true_tables is not None
    assert again.true_tables is None


def test_a_run_takes_the_arms_as_they_were_found(found, polish_sim, tmp_path, monkeypatch):
    run = ("run", "dual", "--calibration", found / "calibration.toml")
    refused(polish_sim(*run, "--dry-run"), "another pair of robots: 'cell 7'")
    own, short = ("--set", "dual.pair=cell 7"), ("--set", "process.max_feed_s=0.3", "--standoff", "5")
    done(polish_sim(*run, *own, *short, "--out", "run"))
    monkeypatch.chdir(tmp_path / "run")
    out = done(polish_sim("run", "dual", "--config", "config.toml", "--dry-run")).out
    assert "all within reach" in out
    wrong = tmp_path / "wrong.toml"
    wrong.write_text((found / "calibration.toml").read_text().replace("-0.42", "-0.62"))
    refused(polish_sim("run", "dual", "--calibration", wrong, *own, "--dry-run"), "another robot's")


@pytest.fixture
def tracked(found: Path) -> list[str]:
    """Lines of a file of poses: the header, then 20 of each arm."""
    lines = (found / "residuals.csv").read_text().splitlines()
    return [lines[0], *lines[1:21], *lines[61:81]]


def scaled(lines: list[str], angle: float, length: float) -> list[str]:
    """The same joint angles and positions in other units."""
    scales = np.repeat([angle, length], [6, 3])
    rows = ((row[0], *(scales * np.array(row[1:10], float))) for row in (line.split(",") for line in lines))
    return [",".join(map(str, row)) for row in rows]


def test_degrees_and_metres_are_read_as_what_they_are(tmp_path, tracked):
    head = "robot," + ",".join(f"q{k}_deg" for k in range(1, 7)) + ",x_m,y_m,z_m"
    (tmp_path / "si.csv").write_text("\n".join([head, *scaled(tracked[1:], np.degrees(1.0), 1e-3)]))
    (tmp_path / "usual.csv").write_text("\n".join(tracked))
    usual, other = read_tracked(tmp_path / "usual.csv"), read_tracked(tmp_path / "si.csv")
    for robot in usual:
        np.testing.assert_allclose(other[robot].q, usual[robot].q, atol=1e-12)
        np.testing.assert_allclose(other[robot].seen, usual[robot].seen, atol=1e-12)


def test_what_cannot_be_arms_is_refused(polish_sim, tracked):
    degrees, far = scaled(tracked[1:], 57.3, 1.0), scaled(tracked[1:], 1.0, 1e-3)
    head = ",".join(tracked[0].split(",")[:10])
    for lines, said in (
        (tracked[:-1], "19 poses cannot determine an arm's table"),
        ([line for line in tracked if not line.startswith("follower")], "no measurement of the follower"),
        ([tracked[0].replace("q3_rad", "q3"), *tracked[1:]], "lacks the column q3_rad"),
        ([head, *degrees], "Are they in degrees?"),
        ([head, *far], "units"),
        ([tracked[0].replace("x_mm", "x_m"), *tracked[1:]], "mixes units"),
    ):
        Path("poses.csv").write_text("\n".join(lines))
        assert_refused(polish_sim("calibrate", "arm", "--data", "poses.csv"), said, "poses.csv")
