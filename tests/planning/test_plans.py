"""Whole plans: what must hold at every point of every path, and the figures asked for."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.errors import InputError, PlanError
from polish_sim.models import workpiece_path
from polish_sim.planning import plan_part, plan_path
from polish_sim.planning.feasibility import pad_notes
from polish_sim.planning.ground.ground import prepare_ground
from polish_sim.planning.planner import path_on
from polish_sim.planning.quality.located import locate
from polish_sim.planning.toolpath import PROCESS
from tests.planning.shapes import plan_of, prism, region_of, shipped_plan

STEP = 0.008


WHOLE = ["plate", "freeform", "saddle", "cylinder", "sphere_100", "wheel_hub_rim"]
"""Discs and rings; round two holes the region splits."""


@pytest.mark.parametrize(
    ("name", "pattern"), [*((name, "spiral") for name in (*WHOLE, "plate_two_holes")), ("freeform", "raster")]
)
def test_every_point_is_on_the_part_with_its_axis_along_the_normal(name, pattern):
    result = shipped_plan(name, pattern)
    path, process = result.path, result.path.process
    foot = result.region.surface.closest(path.positions_work[process])
    assert np.linalg.norm(foot.positions - path.positions_work[process], axis=1).max() < 1e-9
    assert (foot.normals * path.axes_work[process]).sum(axis=1).min() > 1.0 - 1e-9
    assert np.linalg.norm(path.axes_work, axis=1) == pytest.approx(np.ones(len(path.s)), abs=1e-12)
    assert np.diff(path.s).min() > 0.0
    assert np.diff(path.s).max() < 1.2e-3
    assert np.diff(path.pass_index).min() >= 0


@pytest.mark.parametrize("name", WHOLE)
def test_one_spiral_covers_a_disc_or_a_ring_without_crossing_itself(name):
    figures = shipped_plan(name).figures
    assert figures["retracts"] == 1
    assert figures["self_crossings"] == 0
    assert figures["coverage_stepover"] >= 0.995
    assert figures["coverage"] >= 0.99


def plate_of_four_holes(folder):
    def inside(x, y):
        holes = (x + 60) ** 2 + (y - 50) ** 2, (x - 55) ** 2 + (y - 40) ** 2, (x - 20) ** 2 + (y + 50) ** 2
        return (np.min(holes, axis=0) > 20**2) & ((x + 50) ** 2 + (y + 40) ** 2 > 28**2)

    return plan_of(prism(inside, 240.0), folder / "holes.stl", PlanConfig(stepover_m=STEP))


@pytest.mark.parametrize("name", ["plate_two_holes", ""])
def test_around_holes_the_spiral_is_one_stroke_evenly_spaced(name, tmp_path):
    figures = (shipped_plan(name) if name else plate_of_four_holes(tmp_path)).figures
    assert figures["self_crossings"] == 0
    assert figures["retracts"] <= 3
    assert figures["coverage_stepover"] >= 0.99
    assert figures["stepover_p5_m"] >= 0.8 * STEP


@pytest.mark.parametrize("name", WHOLE)
def test_neighbouring_turns_keep_the_step_over_within_a_twentieth(name):
    figures = shipped_plan(name).figures
    assert figures["stepover_p5_m"] > 0.95 * STEP
    assert figures["stepover_p95_m"] < 1.05 * STEP


@pytest.mark.parametrize("name", ["plate", "freeform", "sphere_100", "cylinder"])
def test_length_times_step_over_is_the_area(name):
    """Each turn sweeps a stripe one step-over wide; turns are counted once, the seam a little twice."""
    figures = shipped_plan(name).figures
    assert figures["path_length_m"] * STEP == pytest.approx(figures["area_m2"], rel=0.03)


def test_the_axis_turns_smoothly_along_the_freeform():
    """Between neighbouring points the axis turns by no more than the tightest curvature of 1/50 mm allows."""
    path = shipped_plan("freeform").path
    process = path.segment == PROCESS
    turn = np.linalg.norm(np.diff(path.axes_work[process], axis=0), axis=1)
    step = np.linalg.norm(np.diff(path.positions_work[process], axis=0), axis=1)
    assert (turn / step).max() < 1.0 / 0.05


def test_curvature_along_the_path_is_the_spheres():
    path = shipped_plan("sphere_100").path
    assert path.curvature[path.process] == pytest.approx(np.full(path.process.sum(), 10.0), rel=0.02)


def test_a_turned_part_gets_the_same_plan(tmp_path):
    upright = shipped_plan("cylinder").figures
    mesh = trimesh.load(workpiece_path("cylinder"))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2.0, [0.0, 1.0, 0.0]))
    mesh.export(tmp_path / "turned.stl")
    figures = plan_part(PartConfig(str(tmp_path / "turned.stl"), up="-x"), PlanConfig(stepover_m=STEP)).figures
    for name in ("path_length_m", "stepover_p5_m", "stepover_p95_m", "coverage_stepover"):
        assert figures[name] == pytest.approx(upright[name], rel=5e-3), name


def test_the_same_request_gives_the_same_bytes():
    first = shipped_plan("sphere_100").path
    second = plan_part(PartConfig("sphere_100"), PlanConfig(stepover_m=STEP)).path
    assert first.positions_work.tobytes() == second.positions_work.tobytes()


def test_progress_is_reported_and_grows():
    shares = []
    plan_path(region_of("sphere_100"), PlanConfig(stepover_m=STEP), shares.append)
    assert shares == sorted(shares)
    assert 0.9 < shares[-1] <= 1.0


def test_a_part_with_an_arm_is_covered_without_crossings(tmp_path):
    arm = prism(lambda x, y: (np.abs(x) < 70) & (y < -10) | (x < -10), 160.0)
    figures = plan_of(arm, tmp_path / "arm.stl", PlanConfig(stepover_m=STEP)).figures
    assert figures["coverage_stepover"] > 0.97
    assert figures["self_crossings"] == 0


def test_at_a_neck_the_spiral_splits_and_both_sides_are_covered(tmp_path):
    bone = prism(lambda x, y: (np.abs(y) < 10) | (np.abs(x) > 40), 200.0)
    figures = plan_of(bone, tmp_path / "bone.stl", PlanConfig(stepover_m=STEP)).figures
    assert figures["coverage_stepover"] > 0.97
    assert figures["self_crossings"] == 0
    assert figures["retracts"] <= 3


def test_small_holes_are_run_over_and_large_ones_are_not(tmp_path):
    def drilled(half):
        return prism(lambda x, y: np.maximum(np.abs(x), np.abs(y)) > half, 160.0)

    small = plan_of(drilled(5), tmp_path / "small.stl", PlanConfig(stepover_m=STEP))
    assert small.figures["bridged_holes"] == 1
    assert small.figures["retracts"] == 1
    large = plan_of(drilled(25), tmp_path / "large.stl", PlanConfig(stepover_m=STEP))
    assert large.figures["bridged_holes"] == 0
    flat = large.path.positions_work[large.path.process]
    assert np.abs(flat[:, :2]).max(axis=1).min() > 0.025


def test_a_frame_of_even_width_is_one_spiral_from_border_to_border(tmp_path):
    frame = prism(lambda x, y: np.maximum(np.abs(x), np.abs(y)) > 40, 160.0)
    figures = plan_of(frame, tmp_path / "frame.stl", PlanConfig(stepover_m=STEP)).figures
    assert figures["retracts"] == 1
    assert figures["coverage_stepover"] > 0.97


BAD = {
    "an unknown pattern": (
        PartConfig("plate"),
        PlanConfig(pattern="star"),
        InputError,
        "unknown pattern .star.. .*Known: ",
    ),
    "an unknown lead-in": (PartConfig("plate"), PlanConfig(lead_in="jump"), InputError, "arc, normal, tangent"),
    "no step-over": (PartConfig("plate"), PlanConfig(stepover_m=0.0), PlanError, "positive"),
    "a step-over beyond the pad": (PartConfig("plate"), PlanConfig(stepover_m=0.06), PlanError, "stripes"),
    "a margin that leaves nothing": (
        PartConfig("sphere_50"),
        PlanConfig(edge_margin_m=0.05),
        PlanError,
        "nothing of the region is left 50 mm inside its border",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_request_that_cannot_be_met_says_why(case):
    part, plan, error, text = BAD[case]
    with pytest.raises(error, match=text):
        plan_part(part, plan)


def test_a_part_narrower_than_the_pad_is_refused(tmp_path):
    rod = prism(lambda x, y: np.abs(y) < 10, 100.0)
    rod.export(tmp_path / "rod.stl")
    part, plan = PartConfig(str(tmp_path / "rod.stl")), PlanConfig(stepover_m=STEP)
    with pytest.raises(PlanError, match="narrower than half the pad: 20 mm"):
        plan_part(part, plan, pad=PadConfig(choice="given"))
    # One nobody asked for gives way; a step-over asked for stays.
    chosen = plan_part(part, PlanConfig(stepover_m=0.005))
    assert (chosen.tool.pad.radius_m, chosen.plan.stepover_m) == (0.010, 0.005)


def test_turns_a_pad_apart_say_what_they_leave_and_closer_ones_do_not():
    apart = plan_part(PartConfig("plate"), PlanConfig(stepover_m=0.05))
    said = [note for note in apart.notes if "closes the gaps" in note]
    assert f"covers {100.0 * apart.figures['coverage']:.1f}%" in said[0]
    assert apart.figures["coverage"] < 0.99
    closer = plan_part(PartConfig("plate"), PlanConfig(stepover_m=0.025))
    assert not [note for note in closer.notes if "closes the gaps" in note]


def test_a_pad_wider_than_the_ring_is_mentioned():
    assert any("hangs over" in note for note in shipped_plan("wheel_hub_rim").notes)


def test_where_the_rim_carries_alone_the_note_says_where_and_how_far_the_middle_is_off():
    """Over a bowl of radius R the ground rises a^2 / 2R under the rim, which 20 N presses in by a sqrt(F / k R)."""
    radius, rounds = 0.065, np.zeros((2, 3))
    points = np.column_stack([np.linspace(0.0, 0.01, 2), rounds[:, 0], rounds[:, 0]])
    up = np.tile([0.0, 0.0, 1.0], (2, 1))
    ground = prepare_ground(region_of("plate"), PlanConfig(stepover_m=0.05))
    for pad, off_mm in ((0.025, 4.808 - 3.101), (0.010, 0.0)):
        on = locate(ground, path_on(ground, PlanConfig(stepover_m=0.05)))._replace(
            positions=points, axes=up, normals=up, curvatures=np.full((2, 2), -1.0 / radius), forces=np.full(2, 20.0)
        )
        found = [note for note in pad_notes(ground, on, PadConfig(radius_m=pad)) if "rim carries alone" in note]
        assert len(found) == (off_mm > 0.0)
        if found:
            assert f"its middle up to {off_mm:.2g} mm off" in found[0]
            assert "the radius is 65 mm" in found[0]
