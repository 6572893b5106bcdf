"""Every cm^2 of the region asked for is polished, or left out for one reason."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from polish_sim.config import PadConfig, PartConfig, PlanConfig, ProcessConfig
from polish_sim.planning import PlanResult, plan_part
from polish_sim.planning.part_plan import LEFT_OUT, Mend
from polish_sim.planning.quality.areas import CutOut
from polish_sim.planning.quality.figures import account_area
from polish_sim.planning.quality.tool_room import BEHIND_PAD
from polish_sim.planning.toolpath import RETRACT


def planned(folder, solid, pad_mm=50.0, **plan) -> PlanResult:
    file = folder / "part.stl"
    solid.export(file)
    pad = PadConfig(radius_m=5e-4 * pad_mm, choice="given")
    return plan_part(PartConfig(str(file), unit="mm", up="z"), PlanConfig(**plan), pad=pad)


def test_rows_add_up_to_the_region_and_name_the_wall_the_narrow_component_and_what_was_cut(tmp_path):
    wall = trimesh.creation.box((40, 120, 90)).apply_translation((110, 0, 40))
    strip = trimesh.creation.box((120, 15, 10)).apply_translation((0, 100, 0))
    result = planned(tmp_path, trimesh.boolean.union([trimesh.creation.box((200, 120, 10)), wall, strip]),
                     region="box:-200,-200,-1,90,200,6")  # fmt: skip
    m = result.figures
    assert m["region_area_m2"] == pytest.approx(0.190 * 0.120 + 0.120 * 0.015, rel=1e-3)
    assert m["polished_area_m2"] + m["left_out_area_m2"] == pytest.approx(m["region_area_m2"], rel=1e-9)
    assert sum(m["left_out"].values()) == pytest.approx(m["left_out_area_m2"], rel=1e-12)
    assert m["coverage"] == pytest.approx(m["polished_area_m2"] / m["region_area_m2"])
    assert m["left_out"]["component narrower than half the pad"] == pytest.approx(0.120 * 0.015, rel=0.02)
    # The spindle's housing, 32.5 mm in radius, keeps 1 mm from the wall.
    middle = next(body for body in BEHIND_PAD if body.name == "spindle").radius + 0.001
    strip_m2 = 0.120 * (middle - 0.025)
    assert 0.9 * strip_m2 < m["left_out"]["spindle too near the part"] < 1.1 * strip_m2 + 2 * 0.22 * 0.025**2


def test_what_is_cut_out_of_a_path_afterwards_takes_its_reason(tmp_path):
    result = planned(
        tmp_path, trimesh.creation.box((240, 120, 10)), pattern="raster", raster_direction=(0.0, 1.0, 0.0)
    )
    assert result.figures["left_out"].get("shakes", 0.0) == 0.0
    path = result.path
    shaking = path.process & (np.abs(path.positions_work[:, 0]) < 0.06)
    rest, cut = path.rows(~shaking), CutOut("shakes", path.positions_work[shaking])
    # A lift stands where the stretch was: else both sides of it would be one stroke.
    lifted = rest.segment.copy()
    lifted[np.flatnonzero(np.diff(rest.s) > 0.01)] = RETRACT
    rest = type(rest)(**{**vars(rest), "segment": lifted})
    account = account_area(result.ready.asked, rest, ProcessConfig(), result.tool.pad, [cut])
    # 120 mm less the two radii the pad covers from the turns on either side.
    assert account.figures["left_out"]["shakes"] == pytest.approx(0.120 * (0.120 - 0.050), rel=0.15)
    again = result.along(rest, [Mend(LEFT_OUT, "shakes", 0.0, 0.12, cut.positions)]).figures
    assert again["left_out"] == account.figures["left_out"]
    assert again["polished_area_m2"] + again["left_out_area_m2"] == pytest.approx(
        again["region_area_m2"], rel=1e-9
    )
