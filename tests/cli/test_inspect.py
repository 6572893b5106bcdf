"""`polish-sim inspect` as a user calls it."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.cli.conftest import assert_refused, done, metrics_of, refused

FILES = ["coverage.ply", "coverage.png", "metrics.json", "spacing.png"]
SPACING = {"stepover_p5_m", "stepover_p95_m", "max_axis_rate_rad_m"}
KEYS = {"coverage", "exposure_cv", "unreachable_area_m2", *SPACING}


def write_raster(file, height=20.0):
    ends = [(x, y) for k, y in enumerate(range(-95, 96, 10)) for x in ((-100, 100)[:: (-1) ** k])]
    lines = [f"{x},{y},{height},0,0,1" for x, y in ends]
    file.write_text("x,y,z,i,j,k\n" + "\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.pictures
def test_a_foreign_path_gives_the_files_and_figures_of_the_contract(polish_sim):
    write_raster(Path("raster.csv"))
    _, out, err = done(polish_sim("inspect", "raster.csv", "--part", "plate", "--out", "seen"))
    assert sorted(file.name for file in Path("seen").iterdir()) == FILES
    assert out.rstrip().endswith("folder: seen")
    assert "step-over taken from the path: 10 mm" in err
    metrics = metrics_of("seen")
    assert set(metrics) >= KEYS
    assert metrics["coverage_stepover"] == 1.0
    # The mesh opens elsewhere and carries the time under the pad.
    mesh = trimesh.load("seen/coverage.ply", process=False)
    exposure = mesh.metadata["_ply_raw"]["vertex"]["data"]["exposure_s"].ravel()
    assert mesh.area == pytest.approx(200.0 * 200.0, rel=1e-6)
    assert mesh.visual.vertex_colors.shape == (len(mesh.vertices), 4)
    # Twenty lines at 10 mm/s, a pad of 25 mm radius, away from the edges.
    inner = (np.abs(mesh.vertices[:, :2]) < 60.0).all(axis=1)
    assert exposure[inner].mean() == pytest.approx(np.pi * 25.0**2 / (10.0 * 10.0), rel=0.02)


def test_options_reach_the_figures_and_a_plan_beside_a_path_that_was_cut_is_named_with_what_to_do(polish_sim):
    write_raster(Path("raster.csv"))
    words = ("--stepover", "12", "--pad-diameter", "30", "--feed", "20")
    done(polish_sim("inspect", "raster.csv", "--part", "plate", *words, "--out", "seen"))
    metrics = metrics_of("seen")
    assert metrics["stepover_expected_m"] == pytest.approx(0.012)
    assert metrics["overlap"] == pytest.approx(1.0 - 10.0 / 30.0)
    assert metrics["time_in_contact_s"] == pytest.approx(4190.0 / 20.0)
    # The corners of its lines are slowed for; the tool is lifted at the end.
    assert 4190.0 / 20.0 < metrics["motion_time_s"] < metrics["cycle_time_s"] < 1.1 * 4190.0 / 20.0
    # One equal to the default counts where it is given.
    Path("mine.toml").write_text("[plan]\nstepover_m = 0.008\n")
    done(polish_sim("inspect", "raster.csv", "--part", "plate", "--config", "mine.toml", "--out", "8"))
    assert metrics_of("8")["stepover_expected_m"] == 0.008
    write_raster(Path("path.csv"))
    for text in ('{"part": {"na', "[1]"):
        Path("path.json").write_text(text)
        refused(polish_sim("inspect", "path.csv", "--part", "plate", "--out", "cut"), "'path.json'", "again")
        assert not Path("cut").exists()


BAD = {
    "no part": (("raster.csv",), "give it with --part"),
    "missing path": (("none.csv", "--part", "plate"), "none.csv"),
    "pressed in": (("deep.csv", "--part", "plate"), "pressed in already by 4.00 mm"),
    "another part": (("raster.csv", "--part", "sphere_100"), "does not lie on 'sphere_100'"),
    "another unit": (("raster.csv", "--part", "plate", "--units", "cm"), "10 times as large as the path"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_request_is_one_message_and_nothing_is_written(polish_sim, case):
    write_raster(Path("raster.csv"))
    write_raster(Path("deep.csv"), 16.0)
    words, message = BAD[case]
    assert_refused(polish_sim("inspect", *words), message, "raster.csv", "deep.csv")
