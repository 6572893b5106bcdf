"""Plans handed to runs, a user's own controller, and what can be looked at."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from polish_sim.models import workpiece_path
from tests.cli.conftest import Tool

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
    assert {"path.csv", "path.json", "path.png", "force.png", "peaks.png"} <= {
        f.name for f in (tmp_path / "run").iterdir()
    }
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


def test_a_video_moves_or_its_absence_is_told(polish_sim: Tool, tmp_path: Path) -> None:
    code, _, err = polish_sim("run", "arc", "--set", "process.max_feed_s=2", "--video", "--out", "run")
    assert code == 0, err
    films = list((tmp_path / "run").glob("video.*"))
    assert films or "no OpenGL" in err
    for film in films:
        assert film.stat().st_size > 5_000
        if film.suffix == ".gif":
            assert Image.open(film).n_frames >= 5  # type: ignore[attr-defined]


def test_without_a_display_view_is_told_so_and_the_run_goes_on(
    polish_sim: Tool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    code, _, err = polish_sim("run", "arc", *QUICK, "--view", "--out", "run")
    assert code == 0
    assert "no viewer" in err
    assert (tmp_path / "run/log.npz").exists()
