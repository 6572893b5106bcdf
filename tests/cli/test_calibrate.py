"""`polish-sim calibrate payload` as a user calls it; which calibration goes where in `run dual`."""

import csv
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from polish_sim.config import Scenario
from polish_sim.page.page import read_page
from polish_sim.scenario_file import load_scenario
from polish_sim.spatial import from_pose
from tests.cli.conftest import Call, assert_refused, done, metrics_of, ran, refused


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """The folder of one small calibration, made once."""
    folder = tmp_path_factory.mktemp("calibrated") / "one"
    ran("calibrate", "payload", "--poses", 6, "--seed", 4, "--out", folder, "--check")
    return folder


@pytest.fixture
def folder(calibrated, polish_sim, tmp_path):
    return Path(shutil.copytree(calibrated, tmp_path / "one"))


def test_a_calibration_leaves_files_that_agree_and_give_the_same_tool_again(folder, polish_sim):
    files = "calibration.toml config.toml metrics.json residuals.csv residuals.png"
    assert sorted(path.name for path in folder.iterdir()) == files.split()
    metrics = metrics_of(folder)
    calibration = tomllib.loads((folder / "calibration.toml").read_text(encoding="utf-8"))
    assert {"center_m", "bias_n", "bias_nm", "center_m_std", "bias_n_std"} <= metrics.keys()
    assert calibration["mass_kg"] == metrics["mass_kg"] == pytest.approx(2.0, rel=0.01)
    assert calibration["covariance"][0][0] == pytest.approx(metrics["mass_kg_std"] ** 2)
    assert metrics["seed"] == 4
    rows = list(csv.DictReader((folder / "residuals.csv").open(encoding="utf-8")))
    assert len(rows) == metrics["readings"] == 7
    scenario = load_scenario(folder / "config.toml", Scenario())
    assert (scenario.experiment, scenario.seed, scenario.payload.poses) == ("calibrate-payload", 4, 6)
    out = done(polish_sim("calibrate", "payload", "--config", "one/config.toml", "--out", "two")).out
    assert out.splitlines()[-1] == "folder: two"
    for name in ("calibration.toml", "residuals.csv"):
        assert (Path("two") / name).read_bytes() == (folder / name).read_bytes()
    done(polish_sim("calibrate", "payload", "--data", "one/residuals.csv", "--out", "three", "--check"))
    again = metrics_of("three")
    assert again["mass_kg"] == pytest.approx(metrics["mass_kg"], rel=1e-8)
    assert "mass_error_kg" not in again  # nobody knows a robot's true tool


@pytest.mark.parametrize(
    ("columns", "scales", "said"),
    [
        ("fy_n fx_n fz_n", (1.0, 1.0, 1.0), "the forces do not follow a tool's weight"),
        ("fx_n fy_n fz_n", (1.0, 1.0, -1.0), "the forces do not follow a tool's weight"),
        ("tx_nm tz_nm ty_nm", (1.0, 1.0, 1.0), "the torques do not follow a tool's weight"),
        ("tx_nm ty_nm tz_nm", (1.0, 1.0, -1.0), "is the sign of one lost"),
        ("fx_n fy_n fz_n", (0.102, 0.102, 0.102), "centre of mass comes out 0.95"),
        ("tx_nm ty_nm tz_nm", (1e3, 1e3, 1e3), "are the torques in N m"),
        ("fx_n fy_n fz_n", (-1.0, -1.0, -1.0), "the readings have the opposite sign"),
    ],
)
def test_readings_that_follow_no_weight_are_refused(columns, scales, said, folder, polish_sim):
    rows = list(csv.reader((folder / "residuals.csv").open(encoding="utf-8")))
    given = [list(row) for row in rows]
    for name, source, scale in zip(sorted(columns.split()), columns.split(), scales, strict=True):
        to, of = rows[0].index(name), rows[0].index(source)
        for row, read in zip(given[1:], rows[1:], strict=True):
            row[to] = str(scale * float(read[of]))
    Path("bad.csv").write_text("\n".join(map(",".join, given)) + "\n", encoding="utf-8")
    assert_refused(polish_sim("calibrate", "payload", "--data", "bad.csv"), said, "bad.csv", "one")


def test_a_touched_reading_is_named_and_a_noisy_sensor_falls_short(folder, polish_sim):
    rows = list(csv.reader((folder / "residuals.csv").open(encoding="utf-8")))
    column = rows[0].index("fy_n")
    rows[3][column] = str(float(rows[3][column]) + 2.0)
    Path("touched.csv").write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")
    done(polish_sim("calibrate", "payload", "--data", "touched.csv", "--out", "b"), "reading 3 does not fit")
    for row in rows[1 : 1 + len(rows) // 2]:  # half of the forces in kN
        first = rows[0].index("fx_n")
        row[first : first + 3] = [str(1e-3 * float(value)) for value in row[first : first + 3]]
    Path("half.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    half = polish_sim("calibrate", "payload", "--data", "half.csv", "--out", "no")
    refused(half, "the forces do not follow a tool's weight")
    words = ("--noise", "20", "--poses", "4", "--set", "payload.average_s=0.02", "--out", "noisy")
    assert polish_sim("calibrate", "payload", *words, "--check").code == 1


@pytest.mark.parametrize(
    ("asked", "error", "power"),
    [("payload --poses 4", "mass_error_relative", 1), ("tcp", "position_error_m", 2)],
)
def test_many_seeds_give_their_mean_or_rms_and_worst_once(asked, error, power, polish_sim):
    words = ("calibrate", *asked.split(), "--seeds", "2", "--on", "here", "--out", "many")
    done(polish_sim(*words, "--check"))
    metrics = metrics_of("many")
    assert metrics["seeds"] == [0, 1]
    errors = np.array([run[error] for run in metrics["runs"].values()])
    assert metrics["worst"][error] == errors.max()
    mean = np.mean(errors**power) ** (1 / power)
    assert metrics["rms" if power == 2 else "mean"][error] == pytest.approx(mean)
    assert power == 2 or Path("many/seed-0001/calibration.toml").is_file()
    head, *rows = read_page(Path("many/report.html")).tables["Figures"]
    assert head[3:] == ["worst seed", "paper", "asked", "met"]
    assert len(rows) == len(metrics["worst"])
    begun = Path("many/rows.jsonl").read_bytes()
    done(polish_sim(*words))
    assert Path("many/rows.jsonl").read_bytes() == begun


def test_a_run_takes_the_calibration(folder, polish_sim):
    words = ("--set", "process.hold_s=1", "--calibration", "one/calibration.toml", "--out", "run")
    done(polish_sim("run", "force", *words))
    metrics = metrics_of("run")
    found = tomllib.loads((folder / "calibration.toml").read_text(encoding="utf-8"))
    assert metrics["payload_mass_error_kg"] == pytest.approx(found["mass_kg"] - 2.0, abs=1e-9)
    scenario = load_scenario(Path("run/config.toml"), Scenario())
    assert Path(scenario.payload.file) == (folder / "calibration.toml").resolve()


@pytest.fixture(scope="module")
def calibrations(tmp_path_factory):
    """Calibrations of bases, of another pair's, of a planted tool and of the cell's own, made once."""
    made = tmp_path_factory.mktemp("calibrations")
    asked = {"base": "base --seed 1", "other": "base --pair cell-7", "tool": "tcp"}
    for name, words in (asked | {"own": "tcp --cell-tool --seed 3 --check"}).items():
        ran("calibrate", *words.split(), "--out", made / name)
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
    done(run_dual("base own", "--set", "process.max_feed_s=0.3", "--standoff", "5", "--out", "run"))
    settings = tomllib.loads((tmp_path / "run" / "config.toml").read_text(encoding="utf-8"))["dual"]
    assert Path(settings["bases_file"]).parent.name == "base"
    assert Path(settings["tool_file"]).parent.name == "own"
    planted = metrics_of(tmp_path / "base")["true_transform"]
    np.testing.assert_allclose(from_pose(settings["follower_pose"]), planted, atol=1e-12)


@pytest.mark.parametrize(
    ("names", "words", "said"),
    [
        ("other", [], ["another pair", "'cell-7'"]),
        ("tool", [], ["the cell's tool", "calibrate tcp --cell-tool"]), ("base base", [], ["one of each"]),
        ("base", ["--set", "dual.follower_pose=[-1.1,0.01,0,0,0,3]"], ["leave one of them out"]),
    ],
)  # fmt: skip
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
    assert "path length" in done(polish_sim("plan", "wheel_hub_rim", "--dual", "--out", "plan")).out
    figures = metrics_of("plan")
    assert figures["chain_residual_m"] < 1e-9
    assert figures["placement_value"] > 0.1
    assert len(figures["q_master_rad"]) == len(figures["q_follower_rad"]) == 6
    fed = ("--set", "process.max_feed_s=0.5", "--fault", "master-stop@60")
    run = ("run", "dual", "--path", "plan", *fed)
    _, out, err = done(polish_sim(*run, "--out", "run"))
    missed = metrics_of("run")["relative_error_rms_m"] > 6e-5
    assert ("dual.closing_touches=36" in out + err) == missed  # what would help
    files = (Path(name) / "path.csv" for name in ("plan", "run"))
    planned, ran = (np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1, 2)) for file in files)
    np.testing.assert_allclose(ran, planned, atol=1e-9)
    refused(polish_sim(*run, "--region", "all"), "--region would change nothing on a finished plan")
    far = ("--dual", "--set", "dual.follower_pose=[-2.5,0,0,0,0,3]", "--out", "far")
    refused(polish_sim("plan", "wheel_hub_rim", *far), "the follower does not reach")
    assert not Path("far").exists()
