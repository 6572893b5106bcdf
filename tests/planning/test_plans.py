"""Whole plans: what holds at every point of every path, where it begins, requests that cannot be met."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from polish_sim import measure_path
from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.errors import PlanError
from polish_sim.planning import plan_part, plan_path
from tests.planning.shapes import block, plan_of, plate, region_of, shipped_plan, union

STEP = 0.008
RING, HOLES = "wheel_hub_rim", "plate_two_holes"
WHOLE = ("plate", "freeform", "saddle", "cylinder", "sphere_100", RING)
"""Discs and rings; round two holes the region splits."""
PLANS = [
    *((name, "spiral", 1, 0.995) for name in WHOLE),
    *((name, "contour", 1, 0.995) for name in ("plate", "freeform")),
    *((name, "raster", 1, 0.995) for name in ("plate", "cylinder")),
    *((name, "fermat", 1, 0.995) for name in ("freeform", RING, HOLES)),
    (HOLES, "contour", 20, 0.995),
    (HOLES, "raster", 4, 0.99),
    (HOLES, "spiral", 3, 0.99),
]
"""Part, pattern, most strokes and least share within 0.55 step-overs."""


@pytest.mark.parametrize(("name", "pattern", "strokes", "share"), PLANS)
def test_a_part_is_covered_in_few_strokes_on_its_surface_without_crossings(name, pattern, strokes, share):
    result = shipped_plan(name, pattern)
    assert result.figures["retracts"] <= strokes
    assert result.figures["self_crossings"] == 0
    assert result.figures["coverage_stepover"] >= share
    assert result.figures["coverage"] >= 0.99
    assert (result.figures["pad_in_part_max_m"], result.figures["pad_in_part_length_m"]) == (0.0, 0.0)
    path, process = result.path, result.path.process
    foot = result.region.surface.closest(path.positions_work[process])
    assert np.linalg.norm(foot.positions - path.positions_work[process], axis=1).max() < 1e-9
    assert (foot.normals * path.axes_work[process]).sum(axis=1).min() > 1.0 - 1e-9
    assert np.linalg.norm(path.axes_work, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert np.diff(path.s).min() > 0.0
    assert np.diff(path.s).max() < (1.5e-3 if pattern == "contour" else 1.2e-3)
    assert np.diff(path.pass_index).min() >= 0
    if pattern in ("spiral", "fermat") and name in ("plate", "freeform", "sphere_100", "cylinder"):
        # Each turn sweeps a stripe one step-over wide; turns are counted once, the seam a little twice.
        swept, off = result.figures["path_length_m"] * STEP, 0.03 if pattern == "spiral" else 0.05
        assert swept == pytest.approx(result.figures["region_area_m2"], rel=off)
    if (name, pattern) == (HOLES, "spiral"):
        assert result.figures["stepover_p5_m"] >= 0.8 * STEP
    elif pattern == "spiral":
        assert result.figures["stepover_p5_m"] > 0.95 * STEP
        assert result.figures["stepover_p95_m"] < 1.05 * STEP


SQUARE = shapely.box(-80, -80, 80, 80)
ENDS = shapely.union(shapely.box(-100, -100, -40, 100), shapely.box(40, -100, 100, 100))
OUTLINES = {
    "arm": shapely.union(shapely.box(-80, -80, 70, -10), shapely.box(-80, -80, -10, 80)),
    "neck": shapely.union(ENDS, shapely.box(-50, -10, 50, 10)),
    "wide neck": shapely.union(ENDS, shapely.box(-50, -20, 50, 20)),
    "even frame": SQUARE - shapely.box(-40, -40, 40, 40),
    "uneven frame": SQUARE - shapely.box(-35, -45, 35, 25),
    "notch": SQUARE - shapely.box(-20, 10, 20, 80),
}


@pytest.mark.parametrize(
    ("shape", "pattern", "strokes", "share"),
    [
        ("arm", "spiral", 9, 0.97), ("neck", "spiral", 3, 0.97), ("even frame", "spiral", 1, 0.97),
        ("wide neck", "fermat", 1, 0.98), ("uneven frame", "fermat", 2, 0.98), ("notch", "raster", 2, 0.99),
    ],
)  # fmt: skip
def test_arms_necks_and_frames_are_covered_in_few_strokes(shape, pattern, strokes, share, tmp_path):
    plan = PlanConfig(pattern=pattern, stepover_m=STEP, raster_direction=(1.0, 0.0, 0.0))
    figures = plan_of(plate(OUTLINES[shape]), tmp_path / "part.stl", plan).figures
    assert figures["retracts"] <= strokes
    assert figures["self_crossings"] == 0
    assert figures["coverage_stepover"] > share


@pytest.mark.parametrize(("width", "pattern"), [(9.5, "contour"), (10.0, "spiral"), (10.0, "fermat")])
def test_a_strip_a_little_wider_than_a_step_over_gets_its_one_turn(width, pattern, tmp_path):
    plan, pad = PlanConfig(pattern=pattern, stepover_m=STEP), PadConfig(radius_m=0.5 * STEP, choice="given")
    figures = plan_of(block((120, width, 6)), tmp_path / "strip.stl", plan, pad).figures
    assert figures["retracts"] == 1
    assert figures["coverage_stepover"] > 0.98


def test_a_sphere_s_path_has_its_curvature_is_the_same_again_and_reports_growing_progress():
    path = shipped_plan("sphere_100").path
    assert path.curvature[path.process] == pytest.approx(10.0, rel=0.02)
    shares = []
    again = plan_path(region_of("sphere_100"), PlanConfig(stepover_m=STEP), shares.append)
    assert path.positions_work.tobytes() == again.positions_work.tobytes()
    assert shares == sorted(shares)
    assert 0.9 < shares[-1] <= 1.0


def test_small_holes_are_run_over_and_large_ones_are_not(tmp_path):
    drilled = [plate(SQUARE - shapely.box(-half, -half, half, half)) for half in (5, 25)]
    small, large = (plan_of(mesh, tmp_path / "part.stl", PlanConfig(stepover_m=STEP)) for mesh in drilled)
    assert (small.figures["bridged_holes"], small.figures["retracts"]) == (1, 1)
    assert large.figures["bridged_holes"] == 0
    flat = large.path.positions_work[large.path.process]
    assert np.abs(flat[:, :2]).max(axis=1).min() > 0.025


def test_more_force_covers_no_less():
    cap = region_of("sphere_100")
    path = plan_path(cap, PlanConfig(pattern="raster", stepover_m=0.03))
    light, firm = (measure_path(path, cap, 0.03, 0.01, force)["coverage"] for force in (1.0, 30.0))
    assert light < firm <= 1.0
    firmly = replace(path, force=np.full(len(path.s), 30.0))
    assert measure_path(firmly, cap, 0.03, 0.01, 1.0)["coverage"] >= light


def told(result):
    return [note for note in result.notes if "from the start asked for" in note]


@pytest.mark.parametrize(
    ("pattern", "name", "start", "within"),
    [
        ("spiral", "sphere_100", (0.0497, 0.0154, 0.02), 2.0), ("spiral", "plate", (0.09, 0.09, 0.02), 1.0),
        ("contour", "sphere_100", (0.0, -0.05, 0.03), 2.0), ("fermat", "freeform", (0.0, -0.1, 0.03), 5.0),
        ("raster", "cylinder", (0.07, 0.05, 0.022), 3.0),
    ],
)  # fmt: skip
def test_a_path_begins_near_its_start_and_says_where_if_two_step_overs_off(pattern, name, start, within):
    """Also near a corner; of a spiral the first turn runs half a step-over inside the border."""
    plan = PlanConfig(pattern=pattern, stepover_m=0.012, start=start, raster_direction=(0.0, 1.0, 0.0))
    result = plan_part(PartConfig(name), plan)
    away = result.path.positions_work[result.path.process][0] - start
    assert np.linalg.norm(away[:2]) < within * STEP
    assert bool(told(result)) == (np.linalg.norm(away) > 2.0 * STEP)


NARROW = {"region": "box:-13,-13,0,13,13,30", "pattern": "contour", "stepover_m": 0.05}


@pytest.mark.parametrize(
    ("name", "plan", "said"),
    [
        ("plate", {"stepover_m": 0.0}, "positive"),
        ("sphere_50", {"edge_margin_m": 0.05}, "left 50 mm inside .* further than about 29"),
        ("plate", {"edge_margin_m": 0.4}, "left 400 mm inside .* further than about (9[89]|100)"),
        ("plate", NARROW, r"too narrow for a step-over of 25 mm: .* \(or a larger --overlap\)"),
        ("plate", {"start": (5.0, 0.0, 0.02)}, r"is 4900 mm away from .* nearest point .* \(100, "),
    ],
)
def test_a_request_that_cannot_be_met_says_why(name, plan, said):
    """What the command line refuses by name is in tests/cli/test_plan.py"""
    with pytest.raises(PlanError, match=said):
        plan_part(PartConfig(name), PlanConfig(**plan))


def test_turns_a_pad_apart_and_an_outward_path_with_a_start_are_noted():
    plan = PlanConfig(stepover_m=0.016, start=(-0.09, 0.09, 0.02), order="outward")
    result = plan_part(PartConfig("plate"), plan)
    assert np.linalg.norm(result.path.positions_work[result.path.process][0, :2]) < 0.02
    assert "an outward path begins in the middle" in told(result)[0]
    apart = plan_part(PartConfig("plate"), PlanConfig(stepover_m=0.05))
    missed = sum(row.area_m2 for row in apart.area.left_out.values())
    assert apart.figures["coverage"] == pytest.approx(1.0 - missed / apart.figures["region_area_m2"])
    assert apart.figures["coverage"] < 0.99
    assert [note for note in apart.notes if "left out" in note]
    closer = plan_part(PartConfig("plate"), PlanConfig(stepover_m=0.025))
    assert not [note for note in closer.notes if "left out" in note]


def test_an_angle_of_narrow_legs_gets_the_pad_that_fits_and_keeps_what_was_asked_for(tmp_path):
    angle = union(block((150, 22.9, 8)), block((22.9, 120, 8), (-63.55, 48.5, 0)))
    angle.export(tmp_path / "angle.stl")
    part, plan = PartConfig(str(tmp_path / "angle.stl"), unit="mm", up="z"), PlanConfig(stepover_m=0.008)
    pads = [plan_part(part, plan, pad=PadConfig(choice=choice)) for choice in ("auto", "stepover")]
    assert [(result.tool.pad.radius_m, result.plan.stepover_m) for result in pads] == [
        (0.010, pytest.approx(0.0032)), (0.010, 0.008)]  # fmt: skip
    overlapping = plan_part(part, replace(plan, stepover_m=0.018))  # as --overlap 64 sets it
    assert overlapping.plan.stepover_m == pytest.approx(0.0072)
