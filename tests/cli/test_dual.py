"""`run dual` on the command line: which calibration goes where, and what is refused."""

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from polish_sim.spatial import from_pose
from tests.cli.conftest import Call, done, metrics_of, ran, refused

SHORT = ("--set", "process.max_feed_s=0.3", "--standoff", "5")


@pytest.fixture(scope="module")
def calibrations(tmp_path_factory):
    """Calibrations of bases, of another pair's, of a planted tool and of the cell's own, made once."""
    made = tmp_path_factory.mktemp("calibrations")
    asked = {
        "base": ("base", "--seed", "1"),
        "other": ("base", "--pair", "cell 7"),
        "tool": ("tcp",),
        "own": ("tcp", "--cell-tool", "--seed", "3", "--check"),
    }
    for name, words in asked.items():
        ran("calibrate", *words, "--out", made / name)
    return made


@pytest.fixture
def run_dual(calibrations, polish_sim, tmp_path):
    """`run dual` with calibrations by name, in a folder with copies of them."""
    shutil.copytree(calibrations, tmp_path, dirs_exist_ok=True)

    def run(names, *words):
        taken = [word for name in names.split() for word in ("--calibration", f"{name}/calibration.toml")]
        code, out, err = polish_sim("run", "dual", *taken, *words)
        assert (tmp_path / "run").exists() == ("--out" in words and code == 0)
        return Call(code, out, err.replace("\n", " "))

    return run


def test_the_cell_stands_as_the_calibrations_of_bases_and_tool_were_made(run_dual, tmp_path):
    done(run_dual("base own", *SHORT, "--out", "run"))
    settings = tomllib.loads((tmp_path / "run" / "config.toml").read_text(encoding="utf-8"))["dual"]
    assert Path(settings["bases_file"]).parent.name == "base"
    assert Path(settings["tool_file"]).parent.name == "own"
    planted = metrics_of(tmp_path / "base")["true_transform"]
    np.testing.assert_allclose(from_pose(settings["follower_pose"]), planted, atol=1e-12)


@pytest.mark.parametrize(
    ("names", "words", "said"),
    [
        ("other", [], ["another pair", "'cell 7'"]),
        ("tool", [], ["the cell's tool", "calibrate tcp --cell-tool"]),
        ("base base", [], ["one of each"]),
        ("base", ["--set", "dual.follower_pose=[-1.1,0.01,0,0,0,3]"], ["leave one of them out"]),
    ],
)
def test_calibrations_that_do_not_fit_are_refused(names, words, said, run_dual):
    refused(run_dual(names, *words, "--out", "run"), *said)


def test_a_spoilt_calibration_is_one_message(run_dual, tmp_path):
    file = tmp_path / "base" / "calibration.toml"
    whole = file.read_text(encoding="utf-8")
    for spoil in ("transform", "pair"):
        file.write_text(whole.partition(f"\n{spoil} =")[0] + f"\n{spoil} = [[1.0, nan]]\n", encoding="utf-8")
        call = run_dual("base", "--out", "run")
        assert call.out == ""
        refused(call, "calibration.toml'")


def test_a_plan_for_two_says_where_the_part_is_held_and_is_run(polish_sim):
    out = done(polish_sim("plan", "wheel_hub_rim", "--dual", "--out", "plan")).out
    assert "path length" in out
    figures = metrics_of("plan")
    assert figures["chain_residual_m"] < 1e-9
    assert figures["placement_value"] > 0.1
    assert len(figures["q_master_rad"]) == len(figures["q_follower_rad"]) == 6
    run = ("run", "dual", "--path", "plan", "--set", "process.max_feed_s=0.5")
    _, out, err = done(polish_sim(*run, "--out", "run"))
    missed = metrics_of("run")["relative_error_rms_m"] > 6e-5
    assert ("dual.closing_touches=36" in out + err) == missed  # what would help
    files = (Path(name) / "path.csv" for name in ("plan", "run"))
    planned, ran = (np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1, 2)) for file in files)
    np.testing.assert_allclose(ran, planned, atol=1e-9)
    done(polish_sim(*run, "--fault", "master-stop@contact+1", "--dry-run"))
    again = polish_sim(*run, "--region", "all", "--out", "again")
    refused(again, "--region would change nothing on a finished plan")
    far = ("--dual", "--set", "dual.follower_pose=[-2.5,0,0,0,0,3]", "--out", "far")
    refused(polish_sim("plan", "wheel_hub_rim", *far), "the follower does not reach")
    assert not Path("far").exists()
