"""Any path measured on a part: ours, hand-made ones, and those that do not belong there; the step-over."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.errors import PlanError
from polish_sim.planning import inspect_path, measure_given_path, plan_part
from polish_sim.planning.quality.areas import FAR
from polish_sim.planning.quality.spacing import guess_stepover, measure_stepover
from tests.planning.shapes import level, path_through, shipped_plan

PLATE = PartConfig("plate", up="z")
TOP, STEP = 0.02, 0.008


def raster(spacing=0.01, reach=0.1, top=TOP):
    """Lines across the whole plate, two points each."""
    rows = np.arange(-0.1 + 0.5 * spacing, 0.1, spacing)
    ends = [[(-reach, y, top), (reach, y, top)][:: (-1) ** k] for k, y in enumerate(rows)]
    return path_through(np.concatenate(ends))


def with_axes(path, rows):
    """The path with the tool axis turned round at some of its points."""
    axes = path.axes_work.copy()
    axes[rows] *= -1.0
    return replace(path, axes_work=axes)


def test_a_full_raster_covers_the_plate_half_of_one_covers_half_of_it_and_its_step_over_is_found_and_said():
    inspected = inspect_path(raster(), PLATE)
    # Twenty lines of 0.2 m and nineteen steps of 10 mm on 0.04 m^2; no lead, no lift.
    known = {
        "coverage_stepover": 1.0, "coverage": 1.0, "self_crossings": 0, "lifts": 0, "path_length_m": 4.19,
        "length_ratio": 4.19 * 0.01 / 0.04, "cycle_time_s": 419.0, "time_in_contact_s": 419.0,
        "sharpest_corner_rad": np.pi / 2, "max_axis_rate_rad_m": 0.0,
    }  # fmt: skip
    assert {name: inspected.figures[name] for name in known} == pytest.approx(known, rel=1e-9)
    found = [inspected.figures[f"stepover_{name}_m"] for name in ("expected", "min", "mean", "max")]
    assert found == pytest.approx([0.01] * 4, rel=1e-6)
    assert inspected.figures["overlap"] == pytest.approx(0.8)
    assert any(note.startswith("step-over taken from the path: 10 mm") for note in inspected.notes)
    full = raster()
    found = inspect_path(full.rows(full.positions_work[:, 1] < 0.0), PLATE, PlanConfig(stepover_m=0.01))
    # Ten lines of 10 mm, 0.05 step-overs more on the open side.
    assert found.figures["coverage_stepover"] == pytest.approx(0.5 * 1.005, abs=0.002)
    assert found.figures["coverage"] == pytest.approx((0.095 + 0.025) / 0.2, abs=0.01)


def test_a_path_run_twice_is_under_the_pad_twice_as_long_and_a_place_gone_over_often_over_polished():
    once = raster().positions_work
    twice = np.concatenate([once, once[::-1][1:]])
    spot = [(x, 0.0, TOP) for _ in range(12) for x in (-0.01, 0.01)]
    often = np.concatenate([once, [[0.0, 0.095, TOP]], np.array(spot)])
    plan = PlanConfig(stepover_m=0.01)
    one, two, much = (inspect_path(path_through(way), PLATE, plan).figures for way in (once, twice, often))
    assert two["exposure_mean_s"] == pytest.approx(2.0 * one["exposure_mean_s"], rel=1e-9)
    assert two["exposure_cv"] == pytest.approx(one["exposure_cv"], rel=1e-9)
    assert two["self_crossings"] == 0
    stadium = np.pi * 0.025**2 + 0.05 * 0.02
    assert 0.5 * stadium < much["over_polished_area_m2"] < 1.05 * stadium


@pytest.mark.parametrize("spacing", [0.003, 0.03])
def test_the_step_over_is_guessed_at_any_scale_and_in_any_frame(spacing):
    path = raster(spacing)
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    moved = path_through(path.positions_work @ turn.T, path.axes_work @ turn.T)
    assert guess_stepover(moved) == pytest.approx(spacing, rel=1e-6)


def test_our_own_plan_inspected_gives_the_figures_it_was_planned_with():
    plan = shipped_plan("sphere_100")
    found = inspect_path(plan.path, PartConfig("sphere_100"), plan.plan).figures
    for name in ("coverage_stepover", "stepover_mean_m", "path_length_m", "self_crossings", "cycle_time_s"):
        assert found[name] == plan.figures[name]
    assert found["coverage"] == pytest.approx(plan.figures["coverage"], abs=1e-3)
    assert found["exposure_cv"] == pytest.approx(plan.figures["exposure_cv"], rel=0.02)
    assert guess_stepover(plan.path) == pytest.approx(0.008, rel=0.02)
    # On a sphere the tool axis turns by one over its radius.
    assert found["max_axis_rate_rad_m"] == pytest.approx(1.0 / 0.1, rel=0.01)
    assert found["max_axis_lean_rad"] < 0.02
    assert found["unreachable_area_m2"] == 0.0


def test_what_a_leaning_pad_leaves_out_at_the_border_an_overrun_polishes_as_its_note_says():
    lean = PlanConfig(stepover_m=0.03, tilt_angle_rad=np.radians(9.0))
    left = plan_part(PartConfig("plate"), lean)
    assert any("at the border; --overrun" in note for note in left.notes)
    over = plan_part(PartConfig("plate"), replace(lean, overrun_m=0.015))
    areas = [plan.figures["left_out"].get("at the border", 0.0) for plan in (left, over)]
    assert areas[0] > 0.006
    assert areas[1] < 0.0005
    assert not any("--overrun" in note for note in over.notes)


def test_a_plan_with_an_overrun_lies_on_its_part_and_its_bare_table_too_when_inspected():
    """Past the rim it runs along the tangent: off the part itself by more than a millimetre."""
    part, plan = PartConfig("freeform"), PlanConfig(overrun_m=0.015, stepover_m=0.016)
    planned = plan_part(part, plan)
    found, bare = inspect_path(planned.path, part, planned.plan), inspect_path(planned.path, part)
    for name in ("coverage_stepover", "path_length_m", "coverage"):
        assert found.figures[name] == pytest.approx(planned.figures[name], abs=1e-3)
    for figures in (found.figures, bare.figures):
        assert 0.005 < figures["beyond_part_max_m"] < 0.015
        assert figures["height_above_part_max_m"] < 1e-5
    with pytest.raises(PlanError, match=r"beyond .* plan\.overrun_m"):
        measure_given_path(planned.path, part, PlanConfig(stepover_m=0.016))
    lifted = replace(planned.path, positions_work=planned.path.positions_work + [0.0, 0.0, 0.003])
    with pytest.raises(PlanError, match="lifted off by"):
        inspect_path(lifted, part, planned.plan)
    # Past the border of a box more than half of it runs on what is the part's, but not the region's.
    part, pad = PartConfig("plate"), PadConfig(radius_m=0.006, choice="given")
    plan = PlanConfig(region="box:-15,-15,0,15,15,30", overrun_m=0.009, stepover_m=0.005)
    planned = plan_part(part, plan, pad=pad)
    found = inspect_path(planned.path, part, plan, pad=pad)
    assert found.figures["coverage"] == pytest.approx(planned.figures["coverage"], abs=1e-3)


def test_the_face_under_the_path_is_found_when_it_is_not_the_top_and_another_than_asked_for_is_refused():
    # The lower edge is chamfered by 2 mm.
    side = [(-0.1, y, z) for z in (0.004, 0.01, 0.016) for y in (-0.09, 0.09)]
    path = path_through(np.array(side)[[0, 1, 3, 2, 4, 5]], (-1.0, 0.0, 0.0))
    found = inspect_path(path, PLATE, pad=PadConfig(radius_m=0.005))
    assert found.figures["region_area_m2"] == pytest.approx(0.2 * 0.018, rel=1e-6)
    assert found.plan.region.startswith("point:-100,")
    with pytest.raises(PlanError, match="only 0% of the path lies on the region"):
        inspect_path(raster(), PLATE, PlanConfig(stepover_m=0.01, region="point:0,0,0"))


BAD = {
    "pressed in": (raster(top=TOP - 0.004), "pressed in already by 4.00 mm"),
    "lifted off": (raster(top=TOP + 0.002), "lifted off by 2.00 mm"),
    "in metres": (path_through(1e-3 * raster().positions_work), "1000 times as large as the path"),
    "in inches": (path_through(25.4 * raster().positions_work), "25.4 times as large as the part"),
    "elsewhere": (path_through(raster().positions_work + [0.4, 0.0, 0.0]), "sideways up to 400.0 mm"),
    "upside down": (
        path_through(raster().positions_work * [0.045, 0.045, 1.0], (0.0, 0.0, -1.0)),
        "points into 'plate' along 100%.* Turn the axes round",
    ),
    "a quarter upside down": (with_axes(raster(), slice(0, 10)), "along 25% of the path, first at"),
    "stabbing once": (with_axes(raster(), 21), r"2.53% of the path, first at \(0, 5, 20\) mm"),
    "in the air": (replace(raster(), segment=np.zeros(40, dtype=np.int8)), "no points in contact"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_path_that_does_not_belong_on_the_part_is_refused_with_the_reason(case):
    path, reason = BAD[case]
    with pytest.raises(PlanError, match=reason):
        inspect_path(path, PLATE)
    with pytest.raises(PlanError, match=reason):
        measure_given_path(path, PLATE, PlanConfig())


def test_how_far_a_tool_leans_is_said_of_a_path_that_is_inspected_or_run():
    leaning = path_through(raster().positions_work, (np.sin(0.2), 0.0, np.cos(0.2)))
    given = measure_given_path(leaning, PLATE, PlanConfig(), pad=PadConfig(radius_m=0.005))
    for notes in (inspect_path(leaning, PLATE).notes, given.notes):
        assert any("leans up to 11 deg" in note for note in notes)


def test_a_path_whose_sides_only_meet_at_a_corner_has_no_step_over():
    corner = path_through(np.array([(-0.05, -0.05, TOP), (0.05, -0.05, TOP), (0.05, 0.05, TOP)]))
    found = inspect_path(corner, PLATE, PlanConfig(stepover_m=0.05))
    planned = measure_given_path(corner, PLATE, PlanConfig(stepover_m=0.05))
    for figures in (found.figures, planned.figures):
        assert np.isnan([figures["stepover_mean_m"], figures["overlap"]]).all()


def test_one_turn_has_no_step_over_and_no_note_on_what_lies_further_from_it():
    t = np.linspace(0.0, 2.0 * np.pi, 361)
    loop = path_through(np.column_stack([0.06 * np.cos(t), 0.015 * np.sin(t), np.full(361, TOP)]))
    assert guess_stepover(loop) is None
    given = measure_given_path(loop, PLATE, PlanConfig(stepover_m=0.008))
    assert given.figures["beyond_stepover_area_m2"] > 0.004
    assert not any(note.startswith(FAR) for note in given.notes)


def archimedes(turns, count=6000):
    angle = np.linspace(2.0 * np.pi, 2.0 * np.pi * (turns + 1), count)
    radius = STEP * angle / (2.0 * np.pi)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)[::-1]


def zigzag(lines, spacing, length=0.2):
    x = np.linspace(0.0, length, 200)
    rows = [np.column_stack([x[:: (-1) ** k], np.full(200, k * spacing)]) for k in range(lines)]
    return np.concatenate(rows)


def test_the_spacing_of_known_lines_is_measured_even_uneven_and_of_separate_runs():
    """The nearest distance between turns of pitch p at radius r is p cos(p / 2 pi r), a little below p."""
    found = measure_stepover([level(archimedes(12))], STEP)
    assert found.mean_m == pytest.approx(STEP, rel=0.01)
    assert found.p5_m > 0.98 * STEP
    assert found.p95_m < 1.002 * STEP
    assert found.excluded < 0.05
    points = zigzag(9, 0.008)
    points[:, 1] += 0.2 * np.maximum(points[:, 1] - 0.032, 0.0)
    found = measure_stepover([level(points)], STEP)
    assert found.p95_m == pytest.approx(0.0096, rel=0.01)
    assert found.p5_m == pytest.approx(0.008, rel=0.01)
    x = np.linspace(0.0, 0.2, 300)
    runs = [level(np.stack([x, np.full(300, y)], axis=1)) for y in (0.0, 0.007, 0.014)]
    assert measure_stepover(runs, STEP).mean_m == pytest.approx(0.007, abs=1e-9)
    assert np.isnan(measure_stepover(runs[:1], STEP).mean_m)


def test_corners_of_a_square_spiral_and_the_turn_around_a_spiral_s_end_are_left_out_and_nothing_else():
    corners = [
        (0, 0), (10, 0), (10, 10), (0, 10), (0, 1), (9, 1), (9, 9), (1, 9), (1, 2), (8, 2), (8, 8), (2, 8),
    ]  # fmt: skip
    points = STEP * np.concatenate([np.linspace(a, b, 300) for a, b in pairwise(corners)])
    found = measure_stepover([level(points)], STEP)
    assert found.p95_m == pytest.approx(STEP, rel=0.03)
    assert 0.05 < found.excluded < 0.4
    # In along one arm, out along another between its turns: the end lies beside the beginning.
    arm = archimedes(12)
    radius = np.linalg.norm(arm, axis=1, keepdims=True)
    inward = arm[radius[:, 0] > 3.0 * STEP]
    between = (arm * (1.0 - 0.5 * STEP / radius))[radius[:, 0] > 3.0 * STEP]
    both = measure_stepover([level(np.concatenate([inward, between[::-1]]))], 0.5 * STEP)
    alone = measure_stepover([level(arm)], STEP)
    assert both.excluded < 0.02
    assert 0.0 < alone.excluded < 0.02
    assert measure_stepover([level(zigzag(3, STEP))], STEP).excluded < 0.15
