"""A part turned and moved gets the path turned and moved; plans of parts of chance hold what all must."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.random_draw import draw_part
from benchmarks.random_parts import exact_mesh, examine, find_faults, mesh_of
from polish_sim.config import PlanConfig
from polish_sim.geometry import fit_surface, select_region
from polish_sim.models.parts import Block, parts
from polish_sim.models.solids import rectangle_grid
from polish_sim.planning import plan_mesh, plan_path
from tests.planning.shapes import UP, Array

SAME_M, SAME_AXIS = 1e-6, 1e-3
"""Points and tool axes of the same path differ by no more than this: a bend of 1 mm radius within SAME_M."""


class Body(NamedTuple):
    """A mesh and its up, before it is put anywhere."""

    vertices: Array
    faces: NDArray[np.int64]
    up: Array

    @property
    def size(self):
        return float(np.ptp(self.vertices, axis=0).max())


UPRIGHT = {
    "saddle": Block(parts()["saddle"].shape, rectangle_grid(0.160, 0.160, 0.010)),
    "ring": replace(parts()["wheel_hub_rim"], spacing=0.006),
}


@cache
def body(name):
    """Of a shipped part, coarser, or of a random one by its seed."""
    if name in UPRIGHT:
        solid = UPRIGHT[name].build()
        return Body(solid.vertices, solid.faces, UP)
    part = draw_part(int(name.removeprefix("random ")))
    return Body(part.solid.vertices - part.solid.vertices.mean(axis=0), part.solid.faces, part.up)


def mesh_at(found, turn, shift):
    return exact_mesh(found.vertices @ turn.T + shift, found.faces, turn @ found.up)


def planned(mesh, size, pattern):
    step = size / 12.0
    plan = PlanConfig(pattern=pattern, stepover_m=step, bridge_m=0.5 * step, clearance_m=2.0 * step)
    return plan_path(select_region(fit_surface(mesh), mesh), plan)


# Rounding still decides where some lines of a raster end on symmetric parts: they differ by 1e-6 to 4e-4 m.
CASES = [
    ("saddle", "contour", 1), ("ring", "fermat", 3), ("random 9", "spiral", 4),
    ("random 26", "contour", 5), ("random 26", "raster", 6),
]  # fmt: skip


@pytest.mark.parametrize(("name", "pattern", "seed"), CASES)
def test_a_turned_and_moved_part_gets_the_turned_and_moved_path(name, pattern, seed):
    turn = Rotation.random(random_state=seed).as_matrix()
    shift = np.random.default_rng(seed).uniform(-0.3, 0.3, 3)
    found = body(name)
    poses = (np.eye(3), 0.0), (turn, shift)
    first, second = (planned(mesh_at(found, *pose), found.size, pattern) for pose in poses)
    assert len(first.s) == len(second.s)
    away = second.positions_work - (first.positions_work @ turn.T + shift)
    assert np.linalg.norm(away, axis=1).max() < SAME_M
    assert np.linalg.norm(second.axes_work - first.axes_work @ turn.T, axis=1).max() < SAME_AXIS
    assert (first.segment == second.segment).all()
    assert (first.pass_index == second.pass_index).all()


@pytest.mark.parametrize("pattern", ["spiral", "fermat"])
def test_a_part_twice_as_large_gets_a_path_twice_as_large(pattern):
    found = body("saddle")
    sizes = found, found._replace(vertices=2.0 * found.vertices)
    paths = (planned(mesh_at(part, np.eye(3), 0.0), part.size, pattern) for part in sizes)
    small, big = (path.positions_work for path in paths)
    # Points lie a millimetre apart on both; the lines they lie on are the same.
    apart = [cKDTree(2.0 * small).query(big)[0], cKDTree(big).query(2.0 * small)[0]]
    assert max(distance.max() for distance in apart) < 2.5e-3


@pytest.mark.parametrize(
    ("seed", "pattern"),
    [
        (105, "spiral"),
        (90084, "spiral"),  # a long strip that a spiral leaves in the middle gets a line of its own
        (90144, "contour"),  # the tool comes down again where it went up: no point comes twice
        (90192, "fermat"),  # through a crescent between turns of two borders, too narrow for a loop
    ],
)
def test_a_random_part_is_covered_on_its_surface_without_crossings(seed, pattern):
    outcome = examine(seed, pattern)
    assert outcome.coverage > 0.99
    assert not outcome.refusal
    assert not outcome.faults


def test_a_plan_that_is_wrong_is_found_out():
    """The checks can fail: the same plan with a figure spoilt, or a point of the approach in the part."""
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
