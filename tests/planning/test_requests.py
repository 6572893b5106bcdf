"""What can be asked for: one call per pattern, where a path begins, and requests that cannot be met."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from polish_sim import measure_path
from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.errors import PlanError
from polish_sim.planning import plan_part, plan_path
from tests.planning.shapes import region_of

STEP = 0.008


def test_more_force_covers_no_less():
    cap = region_of("sphere_100")
    path = plan_path(cap, PlanConfig(pattern="raster", stepover_m=0.03))
    light, firm = (
        measure_path(path, cap, 0.03, pad_radius=0.01, contact_force=n)["coverage"] for n in (1.0, 30.0)
    )
    assert light < firm <= 1.0
    firmly = replace(path, force=np.full(len(path.s), 30.0))
    assert measure_path(firmly, cap, 0.03, 0.01, 1.0)["coverage"] >= light


def told(result):
    return [note for note in result.notes if "from the start asked for" in note]


@pytest.mark.parametrize(
    ("pattern", "name", "start", "within"),
    [
        ("spiral", "sphere_100", (0.0497, 0.0154, 0.02), 2.0),
        ("spiral", "plate", (0.09, 0.09, 0.02), 1.0),
        ("contour", "sphere_100", (0.0, -0.05, 0.03), 2.0),
        ("fermat", "freeform", (0.0, -0.1, 0.03), 5.0),
        ("raster", "cylinder", (0.07, 0.05, 0.022), 3.0),
    ],
)
def test_a_path_begins_near_its_start_and_says_where_if_that_is_two_step_overs_off(
    pattern, name, start, within
):
    """Also near a corner; of a spiral the first turn runs half a step-over inside the border."""
    plan = PlanConfig(pattern=pattern, stepover_m=STEP, start=start, raster_direction=(0.0, 1.0, 0.0))
    result = plan_part(PartConfig(name), plan)
    away = result.path.positions_work[result.path.process][0] - start
    flat = np.linalg.norm(away[:2])
    assert flat < within * STEP
    assert bool(told(result)) == (np.linalg.norm(away) > 2.0 * STEP)


def test_an_outward_path_says_that_it_begins_in_the_middle():
    plan = PlanConfig(stepover_m=0.016, start=(-0.09, 0.09, 0.02), order="outward")
    result = plan_part(PartConfig("plate"), plan)
    assert np.linalg.norm(result.path.positions_work[result.path.process][0, :2]) < 0.02
    assert "an outward path begins in the middle" in told(result)[0]


#: What the command line refuses by name is in tests/cli/test_plan.py
BAD = {
    "no step-over": (PartConfig("plate"), PlanConfig(stepover_m=0.0), "positive"),
    "a margin that leaves nothing": (
        PartConfig("sphere_50"),
        PlanConfig(edge_margin_m=0.05),
        "nothing of the region is left 50 mm inside its border",
    ),
    "a start far off": (
        PartConfig("plate"),
        PlanConfig(stepover_m=0.016, start=(5.0, 0.0, 0.02)),
        r"is 4900 mm away from the part\. The nearest point of the part is \(100, ",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_request_that_cannot_be_met_says_why(case):
    part, plan, text = BAD[case]
    with pytest.raises(PlanError, match=text):
        plan_part(part, plan)


def test_turns_a_pad_apart_say_what_they_leave_and_closer_ones_do_not():
    apart = plan_part(PartConfig("plate"), PlanConfig(stepover_m=0.05))
    missed = sum(row.area_m2 for row in apart.area.left_out.values())
    assert apart.figures["coverage"] == pytest.approx(1.0 - missed / apart.figures["region_area_m2"])
    assert apart.figures["coverage"] < 0.99
    assert [note for note in apart.notes if "left out" in note]
    closer = plan_part(PartConfig("plate"), PlanConfig(stepover_m=0.025))
    assert not [note for note in closer.notes if "left out" in note]


def test_an_angle_of_narrow_legs_gets_the_pad_that_fits_and_keeps_what_was_asked_for(tmp_path):
    legs = [trimesh.creation.box((150, 22.9, 8)), trimesh.creation.box((22.9, 120, 8))]
    legs[1].apply_translation((-63.55, 48.5, 0))
    trimesh.boolean.union(legs).export(tmp_path / "angle.stl")
    part, plan = PartConfig(str(tmp_path / "angle.stl"), unit="mm", up="z"), PlanConfig(stepover_m=0.008)
    pads = [plan_part(part, plan, pad=PadConfig(choice=choice)) for choice in ("auto", "stepover", "given")]
    assert [(result.tool.pad.radius_m, result.plan.stepover_m) for result in pads] == [
        (0.010, pytest.approx(0.0032)), (0.010, 0.008), (0.025, 0.008)]  # fmt: skip
