"""`polish-sim plan` and `inspect` as a user calls them."""

import json
import shutil
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import trimesh

from polish_sim.cell import Silent
from polish_sim.cli.plan import plan_setups
from polish_sim.errors import PlanError, ReachError
from tests.cli.conftest import UNPROVEN, assert_refused, done, metrics_of, refused
from tests.planning.test_fixture import asked, wall

FILES = ["metrics.json", "path.csv", "path.json", "path.png", "report.html"]


def test_a_plan_folder_holds_the_files_of_the_contract(polish_sim):
    call = polish_sim("plan", "sphere_100", "--stepover", "16", *UNPROVEN, "--out", "plan")
    done(call, "through the air, leads included", "note: read in mm: 112 x 112 x 35 mm")
    assert sorted(file.name for file in Path("plan").iterdir()) == FILES
    assert call.out.rstrip().endswith("folder: plan")
    metrics = metrics_of("plan")
    assert metrics["coverage_stepover"] > 0.98
    assert metrics["retracts"] == 1
    # What the table puts beside each other is of the same way: in contact at 10 mm/s, the rest at 5 mm/s.
    assert metrics["time_in_contact_s"] == pytest.approx(metrics["path_length_m"] / 0.01, rel=0.01)
    assert metrics["motion_time_s"] == pytest.approx(metrics["time_in_contact_s"], rel=0.02)
    # Zeroed in 0.4 s, down 30 mm at 5 mm/s from rest, 0.42 s of touch-down, up by 30 mm and the compression.
    around = 0.4 + 0.03 / 0.005 + 0.05 + 0.42 + 0.03 / 0.02
    assert metrics["cycle_time_s"] == pytest.approx(metrics["motion_time_s"] + around, abs=0.3)


def test_a_plan_takes_as_long_as_its_run_where_joints_slow_it_down(polish_sim):
    """Round the small sphere at 100 mm/s: by the tool's limits alone it would take 8% less."""
    ideal = ("--set", "robot.arm=ideal", *UNPROVEN)  # an elastic wrist would be slowed further
    words = ("--stepover", "12", "--feed", "100", *ideal)
    done(polish_sim("plan", "sphere_50", *words, "--out", "plan"))
    done(polish_sim("run", "surface", "--path", "plan", "--feed", "100", *ideal, "--out", "run"))
    done(polish_sim("inspect", "plan", "--feed", "100", "--out", "inspect"))
    planned, ran, by_tool = map(metrics_of, ("plan", "run", "inspect"))
    assert planned["motion_time_s"] == pytest.approx(ran["motion_time_s"], rel=1e-6)
    assert planned["cycle_time_s"] == pytest.approx(ran["cycle_time_s"], rel=0.02)
    assert by_tool["cycle_time_s"] < 0.94 * ran["cycle_time_s"]


@pytest.mark.pictures
def test_a_plan_says_where_the_part_stands_and_draws_the_reach_map_if_asked(polish_sim):
    trimesh.creation.box((100.0, 100.0, 20.0)).apply_translation([0.0, 0.0, 10.0]).export("block.stl")
    words = ("--up", "z", "--stepover", "40", "--reach-map", *UNPROVEN)
    done(polish_sim("plan", "block.stl", *words, "--out", "plan"), "part's origin, robot base")
    assert Path("plan/reach_map.png").stat().st_size > 20_000
    metrics = metrics_of("plan")
    assert np.array(metrics["T_base_work"])[:3, 3] == pytest.approx([0.0, -0.5, 0.08], abs=1e-3)
    assert metrics["smallest_singular_value"] > 0.1


def test_a_part_out_of_reach_is_planned_not_run_and_both_say_what_to_do(polish_sim):
    words = ("--stepover", "40", "--part-pose", "0,-950,400,0,0,0", "--out", "plan")
    call = polish_sim("plan", "saddle", *words)
    refused(call, "--part-pose 0.001,-499.862,80,0,0,0", code=3)
    assert "out of reach" in call.out
    run = polish_sim("run", "surface", "--part", "sphere_50", "--part-pose", "0,-950,400,0,0,0")
    refused(run, "mm of the part", "--part-pose")
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("sides", "words", "said"),
    [
        ((6.299, 4.0, 0.3), "plan bad.stl", "--units inch makes it 160 mm"),
        ((150.0, 1.5, 1.5), "run surface --part bad.stl", "pad"),
        ((100.0, 20.0, 10.0), "plan bad.stl --pad-diameter 50", "half the pad: 20 mm across, the pad 50 mm"),
    ],
)
def test_a_part_too_small_or_narrow_is_one_message_and_nothing_is_written(polish_sim, sides, words, said):
    trimesh.creation.box(sides).export("bad.stl")
    assert_refused(polish_sim(*words.split()), said, "bad.stl")


def test_on_a_face_narrower_than_the_default_pad_plan_and_run_use_one_that_fits(polish_sim):
    trimesh.creation.box((23.0, 23.0, 10.0)).export("small.stl")
    done(polish_sim("plan", "small.stl", *UNPROVEN, "--out", "plan"), "20 mm and step-over 3.2 mm, 3.4 mm")
    assert json.loads(Path("plan/path.json").read_text())["pad"]["radius_m"] == 0.010
    metrics = metrics_of("plan")
    assert metrics["coverage"] > 0.99
    for words in (("--part", "small.stl"), ("--path", "plan")):
        quick = ("--set", "process.max_feed_s=0.5", *UNPROVEN, "--out", "run")
        assert polish_sim("run", "surface", *words, *quick)[0] == 0
        assert "radius_m = 0.01 " in Path("run/config.toml").read_text()
        shutil.rmtree("run")
    Path("run").mkdir()
    Path("link").symlink_to("plan")
    for words, out in (
        (("run", "surface", "--path", "plan"), "run/../plan"), (("smooth", "plan/path.json"), "link"),
        (("inspect", "link"), Path("plan").resolve()),
        (("run", "surface", "--set", "plan.file=link"), "plan"),
    ):  # fmt: skip
        refused(polish_sim(*words, "--out", out, "--overwrite"), f"'{out}'", "--out")
    assert metrics_of("plan") == metrics
    assert polish_sim("inspect", "plan", "--out", "seen")[0] == 0
    seen = metrics_of("seen")
    same = "region_area_m2", "polished_area_m2", "coverage_stepover", "stepover_mean_m"
    assert [seen[name] for name in same] == pytest.approx([metrics[name] for name in same], rel=1e-9)


def test_a_chosen_pad_does_not_sink_off_corners_and_fits_the_force(polish_sim):
    for side, name in ((20.0, "cube.stl"), (6.0, "tiny.stl")):
        trimesh.creation.box((side, side, 20.0)).export(name)
    words = "--part cube.stl --up z --feed 30 --out run"
    assert polish_sim("run", "surface", *words.split())[0] == 0
    assert metrics_of("run")["path_done"] == 1.0
    refused(polish_sim("plan", "tiny.stl", "--up", "z"), "6 mm wide, is too small for 20 N")


def test_a_path_with_the_tool_in_the_part_is_refused_before_it_runs_unless_allowed(polish_sim):
    wall = trimesh.creation.box((5.0, 120.0, 30.0)).apply_translation([60, 0, 15])
    plate = trimesh.creation.box((160.0, 120.0, 20.0)).apply_translation([0, 0, -10])
    trimesh.boolean.union([plate, wall], engine="manifold").export("walled.stl")
    words = ("--region", "point:0,0,0", "--up", "z", "--pad-diameter", "12", "--stepover", "12")
    err = done(polish_sim("plan", "walled.stl", *words, *UNPROVEN, "--out", "plan")).err
    assert "cm^2 are left out (" in next(line for line in err.splitlines() if line.startswith("bad: "))
    run = "run surface --path plan --pad-diameter 50 --set process.max_feed_s=0.5 --out run"
    refused(polish_sim(*run.split(), *UNPROVEN), "mm into the part over", "--allow-contact")
    assert not Path("run").exists()
    assert polish_sim(*run.split(), *UNPROVEN, "--allow-contact")[0] in (0, 3)
    assert 'tool_in_part = "allow"' in Path("run/config.toml").read_text()


def test_a_plan_over_countersunk_holes_is_inspected_and_keeps_no_margin_round_them(polish_sim):
    plate = trimesh.creation.box((160.0, 100.0, 12.0))
    for x in (-50.0, 0.0, 50.0):
        hole, sink = trimesh.creation.cylinder(3.0, 40.0), trimesh.creation.cone(6.0, 6.0, sections=48)
        sink.apply_transform(np.diag([1.0, -1.0, -1.0, 1.0]))
        both = [hole.apply_translation([x, 0, 0]), sink.apply_translation([x, 0, 6.001])]
        plate = trimesh.boolean.difference([plate, *both], engine="manifold")
    plate.export("plate.stl")
    words = ("--up", "z", "--edge-margin", "20", *UNPROVEN, "--out", "plan")
    assert polish_sim("plan", "plate.stl", *words)[0] == 0
    metrics = metrics_of("plan")
    assert metrics["bridged_holes"] == 3
    assert metrics["region_area_m2"] == pytest.approx(0.120 * 0.060 - 3 * np.pi * 0.006**2, rel=0.01)
    assert polish_sim("inspect", "plan/path.csv", "--part", "plate.stl", "--out", "seen")[0] == 0
    assert metrics_of("seen")["coverage"] == metrics["coverage"]


def test_a_plan_says_how_much_of_the_part_its_region_is_and_turns_are_a_whole_number_apart(polish_sim):
    cap = trimesh.creation.icosphere(subdivisions=4, radius=80.0)
    cap.update_faces(cap.triangles_center[:, 2] > 80.0 * np.cos(np.radians(75.0)))
    cap.export("cap.stl")
    _, out, err = done(polish_sim("plan", "cap.stl", "--stepover", "30", *UNPROVEN, "--out", "plan"))
    figures = metrics_of("plan")
    for key, angle, rel in (("region_area_m2", 46.0, 0.01), ("part_area_m2", 75.0, 0.05)):
        area = 2.0 * np.pi * 0.08**2 * (1.0 - np.cos(np.radians(angle)))  # of a spherical cap
        assert figures[key] == pytest.approx(area, rel=rel)
    assert "more than 46 deg" in err
    areas = f"{1e4 * figures['region_area_m2']:.1f} / {1e4 * figures['part_area_m2']:.1f}"
    assert areas in out
    trimesh.creation.annulus(20.0, 60.0, 10.0, sections=120).export("ring.stl")
    _, out, err = done(polish_sim("plan", "ring.stl", "--stepover", "15", *UNPROVEN, "--out", "ring"))
    apart = 1e3 * metrics_of("ring")["stepover_mean_m"]
    assert 11.5 < apart < 14.0
    assert " / 15" in next(line for line in out.splitlines() if "asked" in line)
    assert f" / {apart:.2f} / " in next(line for line in out.splitlines() if "step-over," in line)
    assert "more than 46 deg" not in err


def test_a_plan_carries_its_fixture_which_must_be_there_unchanged(polish_sim, monkeypatch, tmp_path):
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
    done(polish_sim("run", "surface", "--path", folder, *UNPROVEN, "--dry-run"), "fixture")
    monkeypatch.chdir(tmp_path)
    wall(30.0).export("fixture.stl")
    changed = polish_sim("inspect", folder, "--out", "seen")
    refused(changed, "made with the fixture 'fixture.stl'", "--fixture")
    done(polish_sim("inspect", folder, "--fixture", "fixture.stl", "--out", "seen"))
    Path("fixture.stl").unlink()
    assert polish_sim("run", "surface", "--path", folder, "--dry-run").code == 2


ALL = ("--region", "all", "--stepover", "40", *UNPROVEN, "--out", "all")


@pytest.fixture
def cube(tmp_path, monkeypatch):
    """Its square sides are turned by 90 deg at a time, half a metre away: few of the places."""
    monkeypatch.setattr("polish_sim.experiments.reach_map.TURNS", np.radians(np.arange(0.0, 360.0, 90.0)))
    monkeypatch.setattr("polish_sim.experiments.reach_map.DISTANCES", np.array([0.55]))
    trimesh.creation.box((80.0, 80.0, 80.0)).export(tmp_path / "cube.stl")
    return tmp_path / "cube.stl"


def test_a_cube_takes_two_setups_and_each_face_is_planned_once(polish_sim, cube):
    refused(call := polish_sim("plan", cube, *ALL, "--edge-margin", "50"), "inside its border")
    assert "side up" not in call.err  # before any setup is looked for
    done(polish_sim("plan", cube, *ALL), "384.0 cm^2 no setup reaches 0.0 cm^2", "setup_1: z up")
    setups = metrics_of("all")["setups"]
    assert len(setups) == 2
    numbers = [n for setup in setups for n in setup["region"].partition(":")[2].partition("/")[0].split(",")]
    assert sorted(numbers) == list("123456")
    assert sum(setup["region_area_m2"] for setup in setups) == pytest.approx(6 * 0.08**2)
    assert all(setup["smallest_singular_value"] > 0.02 for setup in setups)
    assert polish_sim("run", "surface", "--path", "all/setup_2", "--dry-run", *UNPROVEN)[0] == 0
    assert polish_sim("inspect", "all/setup_1", "--out", "seen")[0] == 0
    assert metrics_of("seen")["coverage"] == pytest.approx(setups[0]["coverage"], abs=0.002)
    refused(polish_sim("run", "surface", "--path", "all"), "setup_1")
    run = polish_sim("run", "surface", "--part", cube, "--region", "all", "--dry-run")
    refused(run, "--path FOLDER/setup_N")


def test_a_setup_the_arm_cannot_do_once_its_path_was_cut_is_looked_for_elsewhere(tmp_path, monkeypatch):
    monkeypatch.setattr("polish_sim.cli.plan.plan_once", Mock(side_effect=ReachError("out of reach")))
    setup = Mock(patches=(1, 2))
    search = Mock(next=Mock(side_effect=[setup, None]), left=[setup], given_up=[])
    with pytest.raises(PlanError, match="no setup reaches anything"):
        plan_setups(search, tmp_path, None, Silent())
    search.refuse.assert_called_once_with(setup, "out of reach", elsewhere=True)


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
    trimesh.creation.box((100.0, 80.0, 10.0)).export("plate.stl")
    done(polish_sim("plan", "plate.stl", *ALL), "reaches 36 cm^2 in 4 patches", "narrower than half the pad")
    assert metrics_of("all")["unreached_area_m2"] == pytest.approx(2 * (0.1 + 0.08) * 0.01)


def write_raster(file, height=20.0):
    ends = [(x, y) for k, y in enumerate(range(-95, 96, 10)) for x in ((-100, 100)[:: (-1) ** k])]
    lines = [f"{x},{y},{height},0,0,1" for x, y in ends]
    file.write_text("x,y,z,i,j,k\n" + "\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.pictures
def test_a_foreign_path_gives_the_files_and_figures_of_the_contract(polish_sim):
    write_raster(Path("raster.csv"))
    _, out, err = done(polish_sim("inspect", "raster.csv", "--part", "plate", "--out", "seen"))
    files = sorted(file.name for file in Path("seen").iterdir())
    assert files == ["coverage.ply", "coverage.png", "metrics.json"]
    assert out.rstrip().endswith("folder: seen")
    assert "step-over taken from the path: 10 mm" in err
    metrics = metrics_of("seen")
    assert metrics.keys() >= {"coverage", "exposure_cv", "unreachable_area_m2", "max_axis_rate_rad_m"}
    assert metrics["stepover_p5_m"] <= metrics["stepover_p95_m"]
    assert metrics["coverage_stepover"] == 1.0
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
    Path("mine.toml").write_text("[plan]\nstepover_m = 0.008\n")
    done(polish_sim("inspect", "raster.csv", "--part", "plate", "--config", "mine.toml", "--out", "8"))
    assert metrics_of("8")["stepover_expected_m"] == 0.008
    write_raster(Path("path.csv"))
    for text in ('{"part": {"na', "[1]"):
        Path("path.json").write_text(text)
        refused(polish_sim("inspect", "path.csv", "--part", "plate", "--out", "cut"), "'path.json'", "again")
        assert not Path("cut").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("raster.csv", "give it with --part"), ("none.csv --part plate", "none.csv"),
        ("deep.csv --part plate", "pressed in already by 4.00 mm"),
        ("raster.csv --part sphere_100", "does not lie on 'sphere_100'"),
        ("raster.csv --part plate --units cm", "10 times as large as the path"),
    ],
)  # fmt: skip
def test_a_path_that_cannot_be_inspected_is_one_message_and_nothing_is_written(polish_sim, words, said):
    write_raster(Path("raster.csv"))
    write_raster(Path("deep.csv"), 16.0)
    assert_refused(polish_sim("inspect", *words.split()), said, "raster.csv", "deep.csv")
