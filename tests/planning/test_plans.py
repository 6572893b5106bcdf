"""Whole plans: what must hold at every point of every path, and the figures asked for."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from polish_sim.config import PartConfig, PlanConfig
from polish_sim.planning import plan_part, plan_path
from tests.planning.shapes import plan_of, plate, region_of, shipped_plan

STEP = 0.008
RING, HOLES = "wheel_hub_rim", "plate_two_holes"
WHOLE = ("plate", "freeform", "saddle", "cylinder", "sphere_100", RING)
"""Discs and rings; round two holes the region splits."""
PLANS = [
    *((name, "spiral", 1, 0.995) for name in WHOLE),
    *((name, "contour", 1, 0.995) for name in ("plate", "freeform")),
    *((name, "raster", 1, 0.995) for name in ("plate", "cylinder")),
    *((name, "fermat", 1, 0.995) for name in ("freeform", RING, HOLES)),
    *((name, "contour", 20, 0.995) for name in ("saddle", HOLES)),
    *((name, "raster", 4, 0.99) for name in (RING, HOLES)),
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
    # On curved places and over edges the pad is not in the part.
    assert (result.figures["pad_in_part_max_m"], result.figures["pad_in_part_length_m"]) == (0.0, 0.0)
    path, process = result.path, result.path.process
    foot = result.region.surface.closest(path.positions_work[process])
    assert np.linalg.norm(foot.positions - path.positions_work[process], axis=1).max() < 1e-9
    assert (foot.normals * path.axes_work[process]).sum(axis=1).min() > 1.0 - 1e-9
    assert np.linalg.norm(path.axes_work, axis=1) == pytest.approx(np.ones(len(path.s)), abs=1e-12)
    assert np.diff(path.s).min() > 0.0
    assert np.diff(path.s).max() < (1.5e-3 if pattern == "contour" else 1.2e-3)
    assert np.diff(path.pass_index).min() >= 0
    if pattern in ("spiral", "fermat") and name in ("plate", "freeform", "sphere_100", "cylinder"):
        # Each turn sweeps a stripe one step-over wide; turns are counted once, the seam a little twice.
        swept = result.figures["path_length_m"] * STEP
        assert swept == pytest.approx(
            result.figures["region_area_m2"], rel=0.03 if pattern == "spiral" else 0.05
        )
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


def test_the_axis_turns_smoothly_along_the_freeform():
    """Between neighbouring points the axis turns by no more than the tightest curvature of 1/50 mm allows."""
    path = shipped_plan("freeform").path
    turn = np.linalg.norm(np.diff(path.axes_work[path.process], axis=0), axis=1)
    step = np.linalg.norm(np.diff(path.positions_work[path.process], axis=0), axis=1)
    assert (turn / step).max() < 1.0 / 0.05


def test_curvature_along_the_path_is_the_spheres_and_the_same_request_gives_the_same_bytes():
    path = shipped_plan("sphere_100").path
    assert path.curvature[path.process] == pytest.approx(np.full(path.process.sum(), 10.0), rel=0.02)
    again = plan_part(PartConfig("sphere_100"), PlanConfig(stepover_m=STEP)).path
    assert path.positions_work.tobytes() == again.positions_work.tobytes()


def test_progress_is_reported_and_grows():
    shares = []
    plan_path(region_of("sphere_100"), PlanConfig(stepover_m=STEP), shares.append)
    assert shares == sorted(shares)
    assert 0.9 < shares[-1] <= 1.0


def test_small_holes_are_run_over_and_large_ones_are_not(tmp_path):
    drilled = [plate(SQUARE - shapely.box(-half, -half, half, half)) for half in (5, 25)]
    small, large = (plan_of(mesh, tmp_path / "part.stl", PlanConfig(stepover_m=STEP)) for mesh in drilled)
    assert (small.figures["bridged_holes"], small.figures["retracts"]) == (1, 1)
    assert large.figures["bridged_holes"] == 0
    flat = large.path.positions_work[large.path.process]
    assert np.abs(flat[:, :2]).max(axis=1).min() > 0.025
