"""Plans handed to runs, a user's own controller, and what can be looked at."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from polish_sim.cli import film, run
from polish_sim.cli.film import CELL, FRAMES_PER_S, PAD
from polish_sim.log import read_log
from polish_sim.models import workpiece_path
from tests.cli.conftest import PROGRAM, Tool

QUICK = ["--set", "process.max_feed_s=1.0"]
CONTROLLER = '''
"""A law of one's own: hold the nominal path, as stiff as it is."""

import numpy as np


class Mine:
    def reset(self, dt):
        self.steps = 0

    def step(self, measurement, target):
        self.steps += 1
        return np.zeros(6)


class Broken:
    def reset(self, dt):
        pass

    def step(self, measurement, target):
        raise ValueError("no idea")


class Half:
    def reset(self, dt):
        pass
'''


@pytest.fixture
def plan(polish_sim: Tool, tmp_path: Path) -> Path:
    code, _, err = polish_sim("plan", "sphere_50", "--stepover", "10", "--out", "plan")
    assert code == 0, err
    return tmp_path / "plan"


def test_a_plan_runs_on_the_part_and_with_the_settings_it_was_made_with(
    polish_sim: Tool, tmp_path: Path, plan: Path
) -> None:
    code, _, err = polish_sim("run", "surface", "--path", "plan", *QUICK, "--out", "run")
    assert code == 0, err
    config = (tmp_path / "run/config.toml").read_text()
    assert 'file = "sphere_50"' in config
    assert "stepover_m = 0.01 " in config


@pytest.mark.parametrize(
    ("words", "said"),
    [(["--stepover", "5"], "leave --stepover out"), (["--part", "plate"], "another file than 'plate'")],
)
def test_a_plan_is_not_run_against_its_own_settings_or_part(
    polish_sim: Tool, plan: Path, words: list[str], said: str
) -> None:
    code, _, err = polish_sim("run", "surface", "--path", "plan", *words, "--out", "run")
    assert code == 2
    assert said in err
    assert not (plan.parent / "run").exists()


def test_a_plan_of_a_user_s_part_asks_where_the_part_is(polish_sim: Tool, tmp_path: Path) -> None:
    (tmp_path / "mine.stl").write_bytes(workpiece_path("sphere_50").read_bytes())
    assert polish_sim("plan", "mine.stl", "--out", "plan")[0] == 0
    # Where the file still is, the plan knows.
    assert polish_sim("run", "surface", "--path", "plan", *QUICK)[0] == 0
    (tmp_path / "mine.stl").rename(tmp_path / "moved.stl")
    code, _, err = polish_sim("run", "surface", "--path", "plan")
    assert code == 2
    assert "--part" in err
    assert polish_sim("run", "surface", "--path", "plan", "--part", "moved.stl", *QUICK)[0] == 0


def test_a_run_that_stops_short_keeps_its_plan_reports_coverage_and_fails_the_check(
    polish_sim: Tool, tmp_path: Path
) -> None:
    code, _, err = polish_sim("run", "surface", "--part", "sphere_50", *QUICK, "--check", "--out", "run")
    assert code == 1, err
    assert {"path.csv", "path.json", "path.png", "force.png"} <= {f.name for f in (tmp_path / "run").iterdir()}
    figures = json.loads((tmp_path / "run/metrics.json").read_text())
    assert 0.0 < figures["coverage"] <= 1.0
    assert figures["path_done"] < 1.0


def test_a_user_s_controller_runs_from_its_file(polish_sim: Tool, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(CONTROLLER)
    code, _, err = polish_sim("run", "arc", "--controller", "mine.py:Mine", *QUICK, "--out", "run")
    assert code == 0, err
    assert f'name = "{tmp_path / "mine.py"}:Mine"' in (tmp_path / "run/config.toml").read_text()


@pytest.mark.parametrize(("name", "code", "said"), [("Broken", 3, "no idea"), ("Half", 2, "step"), ("None", 2, "Mine")])
def test_a_user_s_controller_that_does_not_work_is_told_what_is_wrong(
    polish_sim: Tool, tmp_path: Path, name: str, code: int, said: str
) -> None:
    (tmp_path / "mine.py").write_text(CONTROLLER)
    ended, _, err = polish_sim("run", "arc", "--controller", f"mine.py:{name}", *QUICK, "--out", "run")
    assert ended == code
    assert said in err
    assert "Traceback" not in err


def frames_of(film: Path) -> np.ndarray:
    """Every fourth frame of a film, shape (n, height, width, 3)."""
    reader = imageio_ffmpeg.read_frames(str(film))
    width, height = next(reader)["size"]
    frames = [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]
    return np.stack(frames[::4]).astype(float)


def test_the_film_of_a_stopped_run_goes_on_to_its_end_beside_a_curve_that_grows(tmp_path: Path) -> None:
    # In a process of its own, because MuJoCo takes its OpenGL when it is imported.
    words = ["run", "arc", "--fault", "controller-nan@1.5", "--video", "--out", "run"]
    call = subprocess.run([*PROGRAM, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    if "--video needs OpenGL" in call.stderr:
        pytest.skip(call.stderr.splitlines()[-1])
    assert call.returncode == 3, call.stderr
    frames = frames_of(tmp_path / "run/video.mp4")
    time = read_log(tmp_path / "run/log.npz")["time_s"]
    assert 4 * len(frames) == pytest.approx(FRAMES_PER_S * (time[-1] - time[0]), abs=8)
    height, width = CELL.height, CELL.width
    cell, curve = frames[:, :, :width], frames[:, height // 2 :, width:]
    assert np.abs(cell[-1] - cell[0]).max() > 50.0
    blue = (curve[..., 2] - curve[..., 0] > 60.0).sum(axis=(1, 2))
    assert blue[0] < blue[len(blue) // 2] < blue[-1]
    assert not [file.name for file in (tmp_path / "run").iterdir() if file.name.startswith(".")]


def test_an_interrupt_while_the_film_is_made_leaves_no_half_of_one(
    polish_sim: Tool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> Iterator[tuple[int, int, np.ndarray]]:
        yield 1, 9, np.zeros((CELL.height, CELL.width + PAD.width, 3), np.uint8)
        raise KeyboardInterrupt

    monkeypatch.setattr(film, "check_film", lambda: None)
    monkeypatch.setattr(run, "save_cell", lambda *_: True)
    monkeypatch.setattr(film, "_frames", interrupted)
    code, _, err = polish_sim("run", "arc", *QUICK, "--video", "--out", "run")
    assert code == 130
    assert "but no film" in err
    assert {"log.npz", "arc.png"} <= {file.name for file in (tmp_path / "run").iterdir()}
    assert not list((tmp_path / "run").glob("*video*"))


@pytest.mark.parametrize(("missing", "said"), [("ffmpeg", "polish-sim[video]"), ("OpenGL", "MUJOCO_GL")])
def test_a_film_that_cannot_be_made_is_refused_before_the_run(
    polish_sim: Tool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str, said: str
) -> None:
    def no_renderer(*_: object) -> None:
        raise RuntimeError("no display")

    monkeypatch.setattr(film, "find_spec", lambda _: None if missing == "ffmpeg" else True)
    monkeypatch.setattr("mujoco.Renderer", no_renderer)
    code, _, err = polish_sim("run", "arc", "--video", "--out", "run")
    assert (code, err.count("\n")) == (2, 1)
    assert said in err
    assert not (tmp_path / "run").exists()


def test_without_a_display_view_is_told_so_and_the_run_goes_on(
    polish_sim: Tool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    code, _, err = polish_sim("run", "arc", *QUICK, "--view", "--out", "run")
    assert code == 0
    assert "no viewer" in err
    assert (tmp_path / "run/log.npz").exists()
