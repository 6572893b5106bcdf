"""`polish-sim run teach` as a user calls it."""

import json
from pathlib import Path

import numpy as np
import pytest

from polish_sim.exchange import read_path
from tests.cli.conftest import UNPROVEN, done, metrics_of, refused

SHORT = ("--set", "hand.off_s=2")


@pytest.mark.pictures
def test_one_mode_leaves_the_contract_s_files_and_figures(polish_sim):
    words = ("--mode", "assist", "--direction", "x", "--duration", 0.8, *SHORT, "--out", "out")
    out = done(polish_sim("run", "teach", *words)).out
    files = {file.name for file in Path("out").iterdir()}
    assert {"config.toml", "metrics.json", "log.npz", "hand_force.png"} <= files
    metrics = metrics_of("out")
    assert {"hand_force_peak_n", "hand_force_rms_n", "drift_rad"} <= set(metrics)
    assert metrics["moves"] == ["assist_x_0p8s"]
    log = np.load("out/log.npz")
    assert log["hand_force_n"].shape == (len(log["time_s"]), 3)
    assert "hand force" in out
    done(polish_sim("report", "out", "out", "--out", "beside"))
    Path("out/metrics.json").write_text(json.dumps(metrics | {"moves": [1]}))
    refused(polish_sim("report", "out", "--out", "edited"), "'moves'", "'out/metrics.json'")


def test_an_arm_that_would_run_away_stops_with_3_and_keeps_its_log(polish_sim):
    words = ("--mode", "classical", "--direction", "x", "--duration", 0.6, "--set", "guide.friction_scale=2")
    call = polish_sim("run", "teach", *words, *SHORT, "--out", "out")
    refused(call, "protective stop: classical x fast: ", code=3)
    assert metrics_of("out")["protective_stop"]
    assert len(np.load("out/log.npz")["time_s"]) > 100


def test_a_taught_rim_is_polished_within_4_newton(polish_sim):
    """From the hand to the polished part: taught.csv of one run is the path of the next."""
    out = done(polish_sim("run", "teach", "--part", "sphere_50", "--follow", "rim", "--out", "taught")).out
    assert "taught path off what was meant" in out
    assert {"taught.csv", "taught.png", "hand_force.png"} <= {file.name for file in Path("taught").iterdir()}
    path = read_path("taught/taught.csv")
    assert path.length_m == metrics_of("taught")["taught_length_m"]
    words = "--part sphere_50 --path taught/taught.csv --set process.max_feed_s=4 --out polished"
    assert polish_sim("run", "surface", *words.split(), *UNPROVEN)[0] == 0
    assert metrics_of("polished")["force_within_4n"] >= 0.995
