"""Planning by one call: arrays that do what the names say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polish_sim import measure_path, plan_contour, plan_fermat, plan_raster, plan_spiral
from polish_sim.config import PlanConfig
from polish_sim.planning import PATTERNS, plan_path
from tests.planning.shapes import region_of

STEPOVER = 0.01


@pytest.fixture(scope="module")
def cap():
    return region_of("sphere_100")


@pytest.mark.parametrize("plan", [plan_spiral, plan_contour, plan_fermat, plan_raster])
def test_every_pattern_has_its_call_and_lies_on_the_sphere(cap, plan):
    path = plan(cap, STEPOVER)
    assert path.positions_work.shape == path.axes_work.shape == (len(path.s), 3)
    away = np.linalg.norm(path.positions_work[path.process] - [0.0, 0.0, -0.065], axis=1)
    assert away == pytest.approx(0.1, abs=1e-5)
    assert measure_path(path, cap, STEPOVER)["coverage_stepover"] > 0.97


def test_every_registered_pattern_is_covered_by_a_call():
    assert set(PATTERNS) == {"spiral", "contour", "fermat", "raster"}


def test_a_call_is_the_plan_it_stands_for(cap):
    wishes = PlanConfig(pattern="raster", stepover_m=STEPOVER, raster_direction=(1.0, 1.0, 0.0), lead_in="arc")
    one = plan_raster(cap, STEPOVER, along=(1.0, 1.0, 0.0), plan=PlanConfig(lead_in="arc"))
    other = plan_path(cap, wishes)
    assert np.array_equal(one.positions_work, other.positions_work)


def test_order_and_start_are_passed_on(cap):
    outward = plan_spiral(cap, STEPOVER, order="outward")
    first, last = outward.positions_work[outward.process][[0, -1]]
    assert np.hypot(*first[:2]) < np.hypot(*last[:2])
    begun = plan_spiral(cap, STEPOVER, start=(0.0, -0.05, 0.02))
    assert begun.positions_work[begun.process][0][1] < -0.04


def test_more_force_covers_no_less(cap):
    path = plan_raster(cap, 0.03)
    light, firm = (measure_path(path, cap, 0.03, pad_radius=0.01, contact_force=n)["coverage"] for n in (1.0, 30.0))
    assert light < firm <= 1.0
    assert measure_path(replace(path, force=np.full(len(path.s), 30.0)), cap, 0.03, 0.01, 1.0)["coverage"] >= light
