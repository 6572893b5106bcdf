"""The proof as a user meets it: a plan that was played, a run from a place on, figures that are bad."""

import json
from pathlib import Path

import numpy as np
import pytest

from polish_sim.errors import place_in_mm
from polish_sim.experiments import proof_record
from polish_sim.log import PROCESS_PHASE
from polish_sim.planning.toolpath import PROCESS
from polish_sim.spatial import from_pose
from tests.cli.conftest import done, metrics_of
from tests.kept import plate_file

WORDS = ("--stepover", "50", "--feed", "40", "--edge-margin", "40")
BEHIND = 200  # [mm]


def test_a_proven_plan_is_not_played_again(polish_sim, monkeypatch):
    """A coarse path on a plate, proven on the part as drawn."""
    words = ("--up", "z", *WORDS, "--proof", "nominal", "--out", "plan")
    assert "prove in the cell" in done(polish_sim("plan", plate_file(), *words)).err
    assert metrics_of("plan")["proven"] == 1
    # Smoothed, it lies where it was proven, on that arm.
    placed = "stands at " + place_in_mm([row[3] for row in metrics_of("plan")["T_base_work"][:3]])
    assert placed in polish_sim("run", "smooth", "--path", "plan", "--dry-run").out
    document = json.loads(Path("plan/path.json").read_text())
    place = np.array(metrics_of("plan")["T_base_work"])[:3, 3]
    assert document["proof"]["pose"][:3] == pytest.approx(place.tolist(), abs=1e-9)
    document["proof"].update(arm="ur10e", pose=[0.0, -1.0, 0.2, 0.0, 0.0, 0.0])  # out of a ur5e's reach
    del document["sum"]
    Path("far.json").write_text(json.dumps(document))
    assert "--feed 40 keeps it" in done(polish_sim("smooth", "far.json", "--rate", 20, "--out", "far")).err
    assert np.allclose(metrics_of("far")["T_base_work"], from_pose(document["proof"]["pose"]), atol=1e-9)
    run = ("run", "surface", "--path", "plan")
    monkeypatch.setattr(proof_record, "drift_notes", lambda *_: ["the sensor drifts"])
    whole = done(polish_sim(*run, "--proof", "nominal", "--seed", "520", "--out", "whole"))
    assert "prove in the cell" not in whole.err
    assert "note: the sensor drifts" in whole.err
    harder = ("--contact-force", "15", "--proof", "nominal", "--set", "process.max_feed_s=1")
    other = polish_sim(*run, *harder, "--out", "other")
    assert "prove in the cell" in other.err
    assert "process.contact_force_n" in other.err
    found = metrics_of("whole")
    assert found["path_done"] == 1.0
    assert "feed_m_s = 0.04" in Path("whole/config.toml").read_text()

    for words in (("--from", "99999"), ("--proof", "often"), ("--proof", "0")):
        refused = polish_sim(*run, *words, "--out", "none")
        assert (refused.code, Path("none").exists()) == (2, False)
        assert words[0] in refused.err

    done(polish_sim(*run, "--from", BEHIND, "--proof", "none", "--out", "rest"))
    assert metrics_of("rest")["left_out_area_m2"] > 0.0
    before = "it was polished before (--from)"
    assert before in metrics_of("rest")["left_out"]
    assert before not in "".join(metrics_of("rest")["bad_figures"])
    # It lands half the pad's radius before with half the force, and has all of it a pad's diameter on.
    log, path = (np.load(Path("rest") / name) for name in ("log.npz", "path.npz"))
    fed, pressed = log["phase"] == PROCESS_PHASE, np.load(Path("whole/path.npz"))
    force, first = log["normal_force_n"][fed], path["positions_work"][path["segment"] == PROCESS][0]
    assert 8.0 < force[0] < 13.0
    assert force[-20:].mean() == pytest.approx(20.0, abs=1.0)
    away = np.linalg.norm(pressed["positions_work"] - first, axis=1)
    assert pressed["s"][away.argmin()] == pytest.approx(1e-3 * BEHIND - 0.0125, abs=2e-3)


def test_a_run_with_bad_figures_says_each_and_fails_with_check(polish_sim):
    words = f"run surface --part {plate_file()} --up z --controller position --proof none --seed 504".split()
    words += [*WORDS, "--set", "part.displacement_m=0.003", "--set", "process.max_feed_s=3"]
    checked = polish_sim(*words, "--check", "--out", "checked")
    assert checked.code == 1
    bad = metrics_of("checked")["bad_figures"]
    assert bad
    assert sum(line.startswith("bad: ") for line in checked.err.splitlines()) == len(bad)
