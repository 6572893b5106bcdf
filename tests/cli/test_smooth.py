"""`polish-sim smooth` as a user calls it."""

import math
from pathlib import Path

import numpy as np
import pytest

from polish_sim.motion.rules.limits import SmoothingLimits, load_limits
from tests.cli.conftest import assert_refused, done, metrics_of

HEAD = "x,y,z,i,j,k\n"
ZIGZAG = HEAD + "0,0,20,0,0,1\n30,0,20,0,0,1\n40,20,20,0,0.1,0.994987437\n40,20,20,0,0,1\n10,30,20,0,0,1\n"
FILES = {
    "trajectory.npz", "trajectory.csv", "metrics.json", "limits.toml", "tool.png", "joints.png",
    "corners.png",
}  # fmt: skip


@pytest.mark.pictures
def test_spline_keeps_tolerances_and_limits_and_is_sampled_evenly_with_the_speeds_of_its_joints(polish_sim):
    Path("path.csv").write_text(ZIGZAG)
    done(polish_sim("smooth", "path.csv", "--out", smoothed := Path("one")))
    metrics = metrics_of(smoothed)
    assert {file.name for file in smoothed.iterdir()} == FILES
    assert (metrics["rule"], metrics["segments"]) == ("spline", 4)
    assert set(metrics["cycle_time_by_rule_s"]) == {"joint-jerk", "joint-acceleration", "spline"}
    assert metrics["cycle_time_by_rule_s"]["spline"] == metrics["cycle_time_s"]
    assert metrics["tip_deviation_contour_max_m"] <= 0.02e-3 * (1.0 + 1e-9)
    assert metrics["axis_deviation_max_rad"] <= math.radians(0.02) * (1.0 + 1e-9)
    for part in ("tool", "axis", "joint"):
        for order in ("speed", "acceleration", "jerk"):
            assert metrics[f"{part}_{order}_ratio_max"] <= 1.0 + 1e-9
    assert len(metrics["peaks"]) == 3 * (2 + 6)
    for peak in metrics["peaks"].values():
        assert 0.0 <= peak["time_s"] <= metrics["cycle_time_s"]
        assert peak["after"].startswith("line ")
        assert len(peak["tip_m"]) == 3
    again = load_limits(smoothed / "limits.toml")
    np.testing.assert_allclose(again.table, SmoothingLimits().table, rtol=1e-6)
    archive = np.load(smoothed / "trajectory.npz")
    time, count = archive["time_s"], len(archive["time_s"])
    shapes = {"tip_m": (count, 3), "axis": (count, 3), "q_rad": (count, 6), "qd_rad_s": (count, 6)}
    assert {name: archive[name].shape for name in shapes} == shapes
    assert np.diff(time)[:-1] == pytest.approx(0.002, abs=1e-12)
    assert time[-1] == metrics_of(smoothed)["cycle_time_s"]
    assert archive["tip_m"][[0, -1]] == pytest.approx(np.array([[0, 0, 0.02], [0.01, 0.03, 0.02]]), abs=1e-12)
    assert archive["axis"][0] == pytest.approx([0.0, 0.0, 1.0])
    assert np.linalg.norm(archive["axis"], axis=1) == pytest.approx(1.0, abs=1e-12)
    q, qd = archive["q_rad"][:-1], archive["qd_rad_s"][:-1]
    assert np.abs((q[2:] - q[:-2]) / 0.004 - qd[1:-1]).max() < 1e-4
    header = (smoothed / "trajectory.csv").read_text().partition("\n")[0]
    assert header.startswith("time_s,x_m,y_m,z_m,nx,ny,nz,")
    table = np.loadtxt(smoothed / "trajectory.csv", delimiter=",", skiprows=1)
    columns = np.column_stack([time, archive["tip_m"], archive["axis"], archive["q_rad"]])
    assert np.abs(table - columns).max() <= 0.5e-9 * (1.0 + 1e-6)


def test_the_tool_alone_needs_no_robot_and_no_tolerance_means_exact_stops(polish_sim):
    Path("far.csv").write_text(HEAD + "0,0,0,0,0,1\n2000,0,0,0,0,1\n2000,500,0,0,0,1\n")
    words = ("--no-joints", "--rate", 20, "--against", "joint-acceleration", "--out", "out")
    out = done(polish_sim("smooth", "far.csv", *words)).out
    assert "joint-acceleration" in out.splitlines()[2]
    assert {file.name for file in Path("out").iterdir()} == FILES - {"joints.png"}
    metrics = metrics_of("out")
    assert metrics["against"]["rule"] == "joint-acceleration"
    assert metrics["joint_jerk_ratio_max"] is None
    assert metrics["cycle_time_s"] >= 2.5 / 0.05
    assert "q_rad" not in np.load("out/trajectory.npz")
    Path("path.csv").write_text(HEAD + "0,0,0,0,0,1\n5,0,0,0,0,1\n5,5,0,0,0,1\n")
    words = ("--tolerance", 0, "--axis-tolerance", 0, "--no-joints")
    done(polish_sim("smooth", "path.csv", *words, "--out", "stops"))
    metrics = metrics_of("stops")
    assert metrics["tip_deviation_vertex_max_m"] < 1e-12
    # Twice 5 mm: acceleration is reached, speed is not (paper 4's limits).
    each = 0.05 + math.sqrt(0.05**2 + 4 * 0.005 / 0.5)
    assert metrics["cycle_time_s"] == pytest.approx(2 * each, rel=1e-9)


def test_a_feed_of_the_path_holds_where_the_path_says(polish_sim):
    Path("path.nc").write_text("G0 X0 Y0 Z50\nX50\nG1 X100 F600 U7\nX150 F1200\n")
    words = ("smooth", "path.nc", "--no-joints", "--rate", 1000, "--out", "out")
    assert "line 3, column 14: unknown word 'U7'" in polish_sim(*words)[2]
    assert "left out: 'path.nc', line 3, column 14" in done(polish_sim(*words, "--lenient")).err
    archive = np.load("out/trajectory.npz")
    speed = np.linalg.norm(np.diff(archive["tip_m"], axis=0), axis=1)[:-1] / 0.001
    x = archive["tip_m"][1:-1, 0]
    for part, feed in ((x < 0.049, 0.05), ((x > 0.051) & (x < 0.099), 0.01), (x > 0.101, 0.02)):
        assert 0.999 * feed < speed[part].max() <= feed * (1.0 + 1e-6)
    assert any("no tool axis" in note for note in metrics_of("out")["notes"])
    fed = ("smooth", "path.nc", "--no-joints", "--lenient", "--feed", 25, "--out", "fed")
    assert polish_sim(*fed)[0] == 0
    assert metrics_of("fed")["peaks"]["tip_speed"]["value_m_s"] == pytest.approx(0.025, rel=1e-3)


LIMITS = "[tip]\nspeed_mm_s = {}\nacceleration_mm_s2 = 500\n{}\n"
UNORDERED = "s_m,x_m,y_m,z_m,nx,ny,nz,pass_index,segment\n"
UNORDERED += "".join(f"{s},{s},0,0,0,0,1,0,process\n" for s in (0, 2, 1))
BAD = {
    "one point": (HEAD + "0,0,0,0,0,1\n", "", "it has one point"),
    "always the same point": (HEAD + "0,0,0,0,0,1\n0,0,0,0,0,1\n", "", "all points are the same"),
    "a half turn": (HEAD + "0,0,0,0,0,1\n9,0,0,0,0,-1\n", "", "180 deg between line 2, point 1 and line 3"),
    "points out of order": (UNORDERED, "", "line 4, point 3: s_m falls from 2 to 1"),
    "out of reach where it lies": (ZIGZAG, "--part-pose 5000,0,0,0,0,0", "out of reach"),
    "a feed so low that it never ends": (ZIGZAG, "--feed 0.001", "is not smoothed in one piece"),
    "no such rule": (ZIGZAG, "--rule fast", "unknown rule 'fast'"),
    "a rule that has left": (ZIGZAG, "--rule certified", "spline"),
    "a tolerance below zero": (ZIGZAG, "--tolerance -1", "--tolerance -1 is outside 0 to 10 mm"),
    "a rule beside itself": (ZIGZAG, "--against spline", "--against spline is the rule itself"),
    "no limits there": (ZIGZAG, "--limits none.toml", "none.toml"),
    "a limit of zero": (ZIGZAG, "--limits zero.toml", "tip.jerk_mm_s3"),
    "a limit without end": (ZIGZAG, "--limits inf.toml", "'inf.toml': 'tip.speed_mm_s' must be a number"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_message_and_leaves_nothing(polish_sim, case):
    text, words, message = BAD[case]
    Path("path.csv").write_text(text)
    Path("zero.toml").write_text(LIMITS.format("50", "jerk_mm_s3 = 0"))
    Path("inf.toml").write_text(LIMITS.format("inf", "jerk_mm_s3 = 10000"))
    there = [file.name for file in Path().iterdir()]
    assert_refused(polish_sim("smooth", "path.csv", *words.split(), "--out", "out"), message, *there)


def test_run_smooth_plays_a_path_with_every_rule_and_can_be_drawn_again(polish_sim):
    Path("path.csv").write_text(HEAD + "".join(f"{5 * k},{5 * (k % 2)},20,0,0,1\n" for k in range(4)))
    assert "within reach" in polish_sim("run", "smooth", "--path", "path.csv", "--dry-run").out
    assert [file.name for file in Path().iterdir()] == ["path.csv"]
    done(polish_sim("run", "smooth", "--path", "path.csv", "--out", "out"), "spline")
    assert metrics_of("out")["path_done"] == 1.0
    assert polish_sim("report", "out")[0] == 0
    seeds = ("--seed", "7", "--seeds", "2", "--on", "here", "--out", "two")
    done(polish_sim("run", "smooth", "--path", "path.csv", *seeds), "smooth, 2 seeds")
    first, second = (metrics_of(Path(f"two/seed-000{seed}")) for seed in (7, 8))
    assert first["spline_tracking_error_max_rad"] != second["spline_tracking_error_max_rad"]
