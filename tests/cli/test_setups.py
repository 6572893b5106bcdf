"""`plan --region all`: every side of a part in few setups, each a plan folder."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.cli.conftest import UNPROVEN, done, metrics_of, refused

PLAN = ("--region", "all", "--stepover", "40", *UNPROVEN, "--out", "all")


@pytest.fixture(autouse=True)
def _few_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts with square sides are turned by 90 deg at a time, half a metre away: few of the places."""
    monkeypatch.setattr("polish_sim.experiments.reach_map.TURNS", np.radians(np.arange(0.0, 360.0, 90.0)))
    monkeypatch.setattr("polish_sim.experiments.reach_map.DISTANCES", np.array([0.55]))


@pytest.fixture
def cube(tmp_path: Path) -> Path:
    trimesh.creation.box((80.0, 80.0, 80.0)).export(tmp_path / "cube.stl")
    return tmp_path / "cube.stl"


def test_a_cube_takes_two_setups_and_each_face_is_planned_once(polish_sim, cube):
    _, out, err = done(polish_sim("plan", cube, *PLAN))
    setups = metrics_of("all")["setups"]
    assert len(setups) == 2
    numbers = [n for setup in setups for n in setup["region"].partition(":")[2].partition("/")[0].split(",")]
    assert sorted(numbers) == list("123456")
    assert sum(setup["region_area_m2"] for setup in setups) == pytest.approx(6 * 0.08**2)
    assert all(setup["smallest_singular_value"] > 0.02 for setup in setups)
    assert "384.0 cm^2 no setup reaches 0.0 cm^2" in out
    assert "setup_1: z up" in err
    assert polish_sim("run", "surface", "--path", "all/setup_2", "--dry-run", *UNPROVEN)[0] == 0
    assert polish_sim("inspect", "all/setup_1", "--out", "seen")[0] == 0
    assert metrics_of("seen")["coverage"] == pytest.approx(setups[0]["coverage"], abs=0.002)
    refused(polish_sim("run", "surface", "--path", "all"), "setup_1")
    run = polish_sim("run", "surface", "--part", cube, "--region", "all", "--dry-run")
    refused(run, "--path FOLDER/setup_N")


def test_a_setup_is_planned_again_from_its_own_words_and_narrow_walls_left_out_by_name(polish_sim, cube):
    region = ("--region", "all:4,1/z", "--up", "y", "--stepover", "20", *UNPROVEN)
    assert polish_sim("plan", cube, *region, "--out", "one")[0] == 0
    path = json.loads(Path("one/path.json").read_text())
    assert path["up"] == [0.0, 1.0, 0.0]
    axes = np.column_stack([path["path"][name] for name in ("nx", "ny", "nz")])
    fed = np.array(path["path"]["segment"]) == "process"
    assert len(np.unique(np.round(axes[fed]), axis=0)) == 2
    for words, said in (("all:0,7", "side for --up"), ("all:7/z", "patches 1 to 6")):
        refused(polish_sim("plan", cube, "--region", words, "--out", "two"), said)
    # Walls narrower than half the pad are left out by name.
    trimesh.creation.box((100.0, 80.0, 10.0)).export("plate.stl")
    err = done(polish_sim("plan", "plate.stl", *PLAN)).err
    assert "no setup reaches 36 cm^2 in 4 patches" in err
    assert "narrower than half the pad" in err
    assert metrics_of("all")["unreached_area_m2"] == pytest.approx(2 * (0.1 + 0.08) * 0.01)
