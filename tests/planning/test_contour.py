"""Contour: closed loops one inside the other."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.config import PlanConfig
from polish_sim.planning.planner import plan_path
from tests.planning.shapes import region_of

STEP = 0.008


def loops_of(path):
    """Points of each pass in contact."""
    passes = path.pass_index[path.process]
    return [path.positions_work[path.process][passes == number] for number in np.unique(passes)]


def turning(loop):
    """Area swept about the z axis [m^2], positive counter-clockwise."""
    return 0.5 * np.sum(np.cross(loop[:-1], loop[1:])[:, 2])


@pytest.fixture(scope="module")
def disc():
    return region_of("sphere_100")


def contours(region, **keys):
    return plan_path(region, PlanConfig(pattern="contour", stepover_m=STEP, **keys))


def test_every_loop_comes_back_to_exactly_where_it_began(disc):
    for loop in loops_of(contours(disc)):
        again = (loop == loop[0]).all(axis=1)
        assert again.sum() == 2
        closed = loop[: np.flatnonzero(again)[1] + 1]
        radius = np.linalg.norm(closed[:, :2], axis=1)
        assert np.ptp(radius) < 0.02 * STEP + 0.02 * radius.mean()


@pytest.mark.parametrize(("order", "sign"), [("inward", 1.0), ("outward", -1.0)])
@pytest.mark.parametrize(("direction", "way"), [("conventional", 1.0), ("climb", -1.0)])
def test_what_is_not_done_yet_lies_on_the_left_unless_climbing(disc, order, sign, direction, way):
    loops = loops_of(contours(disc, order=order, direction=direction))
    sizes = [np.linalg.norm(loop[:, :2], axis=1).mean() for loop in loops]
    assert (np.diff(sizes) * sign < 0.0).all()
    assert all(turning(loop) * sign * way > 0.0 for loop in loops)
