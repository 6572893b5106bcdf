"""Parts of chance: every plan of them holds what every plan must hold; a few of the benchmark's two
hundred."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmarks.random_draw import draw_part
from benchmarks.random_parts import examine, find_faults, mesh_of
from polish_sim.planning import plan_mesh

SEEDS = (6, 105)  #: A few quick ones; `python -m benchmarks.random_parts` takes two hundred


@pytest.mark.parametrize("seed", SEEDS)
def test_a_random_part_is_covered_on_its_surface_without_crossings(seed):
    outcome = examine(seed)
    assert not outcome.refusal
    assert not outcome.faults


def test_a_long_strip_that_a_spiral_leaves_in_the_middle_gets_a_line_of_its_own():
    """Led into from the loop beside it, the line crosses that loop: it was taken back, strip and all."""
    assert examine(90084).coverage > 0.99


def test_fermat_goes_through_a_long_place_between_turns_of_two_borders():
    """Between them a ring with a hole in it leaves a crescent wider than a step-over and too narrow for a
    loop."""
    outcome = examine(90192, "fermat")
    assert outcome.coverage > 0.99
    assert not outcome.faults


def test_no_point_comes_twice_where_the_tool_comes_down_again_where_it_went_up():
    part = draw_part(90144, "contour")
    path = plan_mesh(mesh_of(part), part.plan, pad=part.pad).path
    assert (np.diff(path.s) > 0.0).all()


def test_the_generator_makes_closed_solids_and_the_same_ones_again():
    for seed in range(8):
        part = draw_part(seed)
        solid = trimesh.Trimesh(part.solid.vertices, part.solid.faces, process=False)
        assert solid.is_watertight
        assert solid.is_winding_consistent
        assert solid.volume > 0.0
        assert draw_part(seed).triangles.tobytes() == part.triangles.tobytes()


def test_a_plan_that_is_wrong_is_found_out():
    """The checks can fail: the same plan with one figure spoilt, and with a point of the approach in the
    part."""
    part = draw_part(6)
    result = plan_mesh(mesh_of(part), part.plan, pad=part.pad)
    assert not list(find_faults(part, result))
    result.figures["self_crossings"] = 1
    result.figures["coverage_stepover"] = np.nan
    assert [fault.split()[-1] for fault in find_faults(part, result)] == ["crossings", "nan"]
    free = np.flatnonzero(~result.path.process)
    positions = result.path.positions_work.copy()
    positions[free] = part.solid.vertices.mean(axis=0)
    object.__setattr__(result.path, "positions_work", positions)
    assert any("inside" in fault for fault in find_faults(part, result))
