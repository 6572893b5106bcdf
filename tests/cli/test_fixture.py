"""`--fixture` on the command line: a plan carries its fixture to `inspect` and `run`, wherever they are
called."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import UNPROVEN, Tool, metrics_of
from tests.planning.test_fixture import asked, wall


def test_a_plan_carries_its_fixture_which_must_be_there_unchanged(
    polish_sim: Tool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked(Path(), wall(10.0))  # called by relative names
    words = "--fixture fixture.stl --region point:0,0,0 --stepover 20 --up z --out made"
    assert polish_sim("plan", "plate.stl", *words.split(), *UNPROVEN).code == 0
    folder = Path("made").resolve()
    said = json.loads((folder / "path.json").read_text())["fixture"]
    assert said["file"] == "fixture.stl"
    assert Path(said["path"]) == folder.parent / "fixture.stl"
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert polish_sim("inspect", folder, "--out", "seen").code == 0
    area = metrics_of(folder)["unreachable_area_m2"]
    assert area > 0.0
    assert metrics_of("seen")["unreachable_area_m2"] == pytest.approx(area)
    dry = polish_sim("run", "surface", "--path", folder, *UNPROVEN, "--dry-run")
    assert dry.code == 0
    assert "fixture" in dry.err + dry.out
    monkeypatch.chdir(tmp_path)
    wall(30.0).export("fixture.stl")
    changed = polish_sim("inspect", folder, "--out", "seen")
    assert changed.code == 2
    assert "made with the fixture 'fixture.stl'" in changed.err
    assert "--fixture" in changed.err
    assert polish_sim("inspect", folder, "--fixture", "fixture.stl", "--out", "seen").code == 0
    Path("fixture.stl").unlink()
    assert polish_sim("run", "surface", "--path", folder, "--dry-run").code == 2
