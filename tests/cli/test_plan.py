"""`polish-sim plan` as a user calls it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from polish_sim.models import workpiece_path
from tests.cli.conftest import UNPROVEN, assert_refused, done, metrics_of, refused
from tests.planning.test_fixture import asked, wall

FILES = ["metrics.json", "path.csv", "path.json", "path.png", "report.html"]


def test_a_plan_folder_holds_the_files_of_the_contract(polish_sim):
    _, out, err = done(polish_sim("plan", "sphere_100", "--stepover", "16", *UNPROVEN, "--out", "plan"))
    assert sorted(file.name for file in Path("plan").iterdir()) == FILES
    assert out.rstrip().endswith("folder: plan")
    assert "note: read in mm: 112 x 112 x 35 mm" in err
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
    out = done(polish_sim("plan", "block.stl", *words, "--out", "plan")).out
    assert Path("plan/reach_map.png").stat().st_size > 20_000
    metrics = metrics_of("plan")
    assert np.array(metrics["T_base_work"])[:3, 3] == pytest.approx([0.0, -0.5, 0.08], abs=1e-3)
    assert metrics["smallest_singular_value"] > 0.1
    assert "part's origin, robot base" in out


def test_a_part_out_of_reach_is_planned_not_run_and_both_say_what_to_do(polish_sim):
    words = ("--stepover", "40", "--part-pose", "0,-950,400,0,0,0", "--out", "plan")
    call = polish_sim("plan", "saddle", *words)
    refused(call, "--part-pose 0.001,-499.862,80,0,0,0", code=3)
    assert "out of reach" in call.out
    run = polish_sim("run", "surface", "--part", "sphere_50", "--part-pose", "0,-950,400,0,0,0")
    refused(run, "mm of the part", "--part-pose")
    assert not Path("results").exists()


PLATE = workpiece_path("plate").read_bytes()[:5000]
NARROW = "narrower than half the pad: 20 mm across, the pad 50 mm"
BAD: dict[str, tuple[bytes | trimesh.Trimesh, str, str]] = {
    "step-over beyond the part": (b"", "plan plate --stepover 300", "300 mm"),
    "unknown pattern": (b"", "plan plate --pattern star", "Did you mean 'raster'? Known: "),
    "unknown lead-in": (b"", "plan plate --lead-in jump", "Known: arc, normal, tangent"),
    "overlap twice": (b"", "plan plate --overlap 70 --stepover 8", "give one of them"),
    "reach map of two robots": (b"", "plan plate --dual --reach-map", "change nothing with --dual"),
    "cut short": (PLATE, "run surface --part bad.stl", "cut short"),
    "in metres": (trimesh.creation.box((1.2, 1.2, 0.2)), "run surface --part bad.stl", "--units m"),
    "in inches": (trimesh.creation.box((6.299, 4.0, 0.3)), "plan bad.stl", "--units inch makes it 160 mm"),
    "thin": (trimesh.creation.box((150, 1.5, 1.5)), "run surface --part bad.stl", "pad"),
    "narrow": (trimesh.creation.box((100, 20, 10)), "plan bad.stl --pad-diameter 50", NARROW),
}
"""What the file holds, if one is needed, the command and what it says."""


@pytest.mark.parametrize("case", BAD)
def test_a_bad_request_or_part_is_one_message_and_nothing_is_written(polish_sim, case):
    content, words, said = BAD[case]
    file = Path("bad.stl")
    file.write_bytes(content if isinstance(content, bytes) else content.export(file_type="stl"))
    call = polish_sim(*words.split())
    assert_refused(call, said, "bad.stl")
    assert "--units m " not in call.err or case == "in metres"


def test_on_a_face_narrower_than_the_default_pad_plan_and_run_use_one_that_fits(polish_sim):
    trimesh.creation.box((23.0, 23.0, 10.0)).export("small.stl")
    err = done(polish_sim("plan", "small.stl", *UNPROVEN, "--out", "plan")).err
    assert "pad of 20 mm and step-over 3.2 mm, 3.4 mm" in err
    assert json.loads(Path("plan/path.json").read_text())["pad"]["radius_m"] == 0.010
    metrics = metrics_of("plan")
    assert metrics["coverage"] > 0.99
    # The run takes the plan's pad, planned by itself or from the file; inspect sees what the plan saw.
    for words in (("--part", "small.stl"), ("--path", "plan")):
        quick = ("--set", "process.max_feed_s=0.5", *UNPROVEN, "--out", "run")
        assert polish_sim("run", "surface", *words, *quick)[0] == 0
        assert "radius_m = 0.01 " in Path("run/config.toml").read_text()
        shutil.rmtree("run")
    Path("run").mkdir()
    Path("link").symlink_to("plan")
    for words, out in (
        (("run", "surface", "--path", "plan"), "run/../plan"),
        (("smooth", "plan/path.json"), "link"),
        (("inspect", "link"), Path("plan").resolve()),
        (("run", "surface", "--set", "plan.file=link"), "plan"),
    ):
        refused(polish_sim(*words, "--out", out, "--overwrite"), f"'{out}'", "--out")
    assert metrics_of("plan") == metrics
    assert polish_sim("inspect", "plan", "--out", "seen")[0] == 0
    seen = metrics_of("seen")
    # All of the region counts, also the margin that was chosen with the pad.
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
    dry = done(polish_sim("run", "surface", "--path", folder, *UNPROVEN, "--dry-run"))
    assert "fixture" in dry.err + dry.out
    monkeypatch.chdir(tmp_path)
    wall(30.0).export("fixture.stl")
    changed = polish_sim("inspect", folder, "--out", "seen")
    refused(changed, "made with the fixture 'fixture.stl'", "--fixture")
    done(polish_sim("inspect", folder, "--fixture", "fixture.stl", "--out", "seen"))
    Path("fixture.stl").unlink()
    assert polish_sim("run", "surface", "--path", folder, "--dry-run").code == 2
