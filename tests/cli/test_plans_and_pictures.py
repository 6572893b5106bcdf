"""The options of a path, plans handed to runs, a user's own controller, and what can be looked at."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import imageio_ffmpeg
import numpy as np
import pytest

from polish_sim.cli import film, run
from polish_sim.cli.film import CELL, FRAMES_PER_S, PAD
from polish_sim.errors import place_in_mm
from polish_sim.experiments import proof_record
from polish_sim.experiments.registry import PATH_OPTIONS
from polish_sim.log import PROCESS_PHASE, read_log
from polish_sim.planning.toolpath import PROCESS
from polish_sim.spatial import from_pose
from tests.cli.conftest import PROGRAM, UNPROVEN, assert_refused, done, metrics_of, refused
from tests.kept import plate_file

QUICK = ["--set", "process.max_feed_s=1.0"]
PANELS = ("Part and region:", "Path:", "Landing and tool axis:", "Tool and process:", "Config:", "Output:")


def test_help_groups_every_option_of_a_path_in_panels(polish_sim):
    for command in (("plan",), ("run", "surface")):
        out = polish_sim(*command, "--help").out
        assert all(f"\n{panel}\n" in out for panel in PANELS)
        assert all(f"  {option} " in out for option in PATH_OPTIONS)
        places = [out.index(word) for word in ("Path:", "--stepover", "Landing and tool axis:", "--lead-in")]
        assert places == sorted(places)


def test_a_plan_runs_on_its_part_with_its_settings_and_no_others(polish_sim):
    mine = Path(shutil.copy(plate_file(), Path.cwd() / "mine.stl"))
    words = ("--up", "z", "--stepover", "40", *UNPROVEN, "--out", "plan")
    assert polish_sim("plan", mine, *words)[0] == 0
    run = ("run", "surface", "--path", "plan")
    force, pose = "process.contact_force_n=12", "part.pose=[0, -0.6, 0.2, 0, 0, 0]"
    done(polish_sim(*run, *QUICK, *UNPROVEN, "--set", force, "--set", pose, "--feed", "8", "--out", "run"))
    assert {file.name for file in Path("run").iterdir()} >= {"path.csv", "path.json", "path.png", "force.png"}
    figures = metrics_of("run")  # of a run that stops short
    assert 0.0 < figures["coverage"] <= 1.0
    assert figures["path_done"] < 1.0
    config = Path("run/config.toml").read_text()
    assert f'file = "{mine}"' in config
    settings = "stepover_m = 0.04", "contact_force_n = 12.0", "feed_m_s = 0.008", "pose = [0.0, -0.6, 0.2,"
    assert all(f"\n{setting} " in config for setting in settings)
    done(polish_sim("run", "surface", "--config", "run/config.toml", "--out", "again"))
    assert Path("again/config.toml").read_text() == config
    document = json.loads(Path("plan/path.json").read_text())
    for entry, value in (("part", {**document["part"], "unit": "cm"}), ("plan", {"pattern": "raster"})):
        edited = document | {entry: {**document[entry], **value}}
        Path(f"edited_{entry}.json").write_text(json.dumps(edited))
    del document["sum"]  # as in older files
    document["plan"]["removal"] = "even"
    Path("even.json").write_text(json.dumps(document))
    for name, edited in (("up", {"up": [0, 0, 0]}), ("key", {"plan": {"foo": 1}}), ("null", {"part": None})):
        Path(f"{name}.json").write_text(json.dumps(document | edited))
    for more, said in (
        (["--lead-in", "arc", "--overlap", "60"], "--overlap, --lead-in would change nothing on a finished"),
        (["--part", "plate"], "another file than 'plate'"),
        (["--set", "plan.pattern = raster", "--units", "mm"], "--set plan.pattern would change nothing"),
        (["--path", "up.json"], "'up' in 'up.json'"),
        (["--path", "key.json"], "the plan 'key.json': unknown key 'plan.foo'"),
        (["--path", "null.json"], "'null.json' does not say its part and plan"),
        (["--path", "edited_part.json"], "'edited_part.json' was edited"),
        (["--path", "edited_plan.json"], "'edited_plan.json' was edited"),
        (["--up", "x", "--units", "mm"], "--up, --units would change nothing"),
        (["--path", "even.json", "--feed", "8"], "those of its removal: plan again"),
    ):
        refused(polish_sim(*run, *more, "--out", "other"), said)
        assert not Path("other").exists()
    mine.rename("moved.stl")
    refused(polish_sim(*run, "--dry-run"), "--part")
    assert polish_sim(*run, "--part", "moved.stl", *UNPROVEN, "--dry-run")[0] == 0


def test_the_film_of_a_stopped_run_goes_to_its_end_beside_its_curve(tmp_path):
    # In a process of its own, because MuJoCo takes its OpenGL when it is imported.
    words = ["run", "arc", "--fault", "controller-nan@0.5", "--video", "--out", "run"]
    call = subprocess.run([*PROGRAM, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    if "--video needs OpenGL" in call.stderr:
        pytest.skip(call.stderr.splitlines()[-1])
    assert call.returncode == 3, call.stderr
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "run/video.mp4"))
    width, height = next(reader)["size"]
    frames = [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]
    frames = np.stack(frames[::4]).astype(float)
    time = read_log(tmp_path / "run/log.npz")["time_s"]
    assert 4 * len(frames) == pytest.approx(FRAMES_PER_S * (time[-1] - time[0]), abs=8)
    cell, curve = frames[:, :, : CELL.width], frames[:, CELL.height // 2 :, CELL.width :]
    assert np.abs(cell[-1] - cell[0]).max() > 50.0
    line = np.abs(curve - np.median(curve, axis=0)).sum(axis=(1, 3)).argmax(axis=1)
    assert line[0] < line[len(line) // 2] < line[-1]
    assert not [file.name for file in (tmp_path / "run").iterdir() if file.name.startswith(".")]


def test_an_interrupt_leaves_no_half_of_a_film(polish_sim, tmp_path, monkeypatch):
    def interrupted(*_):
        yield 1, 9, np.zeros((CELL.height, CELL.width + PAD.width, 3), np.uint8)
        raise KeyboardInterrupt

    monkeypatch.setattr(film, "check_film", lambda: None)
    monkeypatch.setattr(run, "save_cell_picture", lambda *_: True)
    monkeypatch.setattr(film, "_frames", interrupted)
    refused(polish_sim("run", "arc", *QUICK, "--video", "--out", "run"), "but no film", code=130)
    assert {"log.npz", "arc.png"} <= {file.name for file in (tmp_path / "run").iterdir()}
    assert not list((tmp_path / "run").glob("*video*"))


@pytest.mark.parametrize(
    ("option", "missing", "said"),
    [
        ("--video", "imageio_ffmpeg", "pip install 'polish-sim[video]'"), ("--video", "OpenGL", "MUJOCO_GL"),
        ("--live", "viser", "pip install 'polish-sim[view]'"),
    ],
)  # fmt: skip
def test_what_cannot_be_shown_is_refused_before_the_run(polish_sim, monkeypatch, option, missing, said):
    monkeypatch.setitem(sys.modules, missing, None)
    monkeypatch.setattr("mujoco.Renderer", Mock(side_effect=RuntimeError("no display")))
    call = polish_sim("run", "arc", option, "--out", "run")
    assert_refused(call, said)
    assert call.err.count("\n") == 1


def test_without_a_display_view_is_told_so_and_the_run_goes_on(polish_sim, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert "no viewer" in done(polish_sim("run", "arc", *QUICK, "--view", "--out", "run")).err
    assert (tmp_path / "run/log.npz").exists()


WORDS = ("--stepover", "50", "--feed", "40", "--edge-margin", "50")
BEHIND = 130  # [mm]


def test_a_proven_plan_is_not_played_again(polish_sim, monkeypatch):
    words = ("--up", "z", *WORDS, "--proof", "nominal", "--out", "plan")
    assert "prove in the cell" in done(polish_sim("plan", plate_file(), *words)).err
    assert metrics_of("plan")["proven"] == 1
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
    whole = done(polish_sim(*run, "--proof", "nominal", "--seed", "520", "--out", "whole"), "sensor drifts")
    assert "prove in the cell" not in whole.err
    harder = ("--contact-force", "15", "--proof", "nominal", "--set", "process.max_feed_s=1")
    other = polish_sim(*run, *harder, "--out", "other")
    assert "prove in the cell" in other.err
    assert "process.contact_force_n" in other.err
    assert metrics_of("whole")["path_done"] == 1.0
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
