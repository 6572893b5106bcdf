"""A recorded way of the tool becomes a path: tremor goes, the shape stays, points lie on the part."""

import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.errors import PlanError
from polish_sim.geometry import fit_surface, load_part
from polish_sim.hand_guiding.drag import Recording, Taught, simplified, teach_path
from polish_sim.models import workpiece_path
from tests.planning.shapes import to_polyline

RADIUS, SPEED = 0.08, 0.05


def circle(tremor: float = 0.0, still: float = 0.0, height: float = 0.02) -> Recording:
    """Once round a level circle at constant speed, held still before and after, with a tremor of 10 Hz."""
    duration = 2.0 * np.pi * RADIUS / SPEED
    t = np.arange(0.0, duration + 2.0 * still, 0.004)
    angle = np.clip((t - still) / duration, 0.0, 1.0) * 2.0 * np.pi
    radius = RADIUS + tremor * np.sin(2.0 * np.pi * 10.0 * t)
    positions = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(len(t), height)], axis=1)
    return Recording(t, positions)


def taught_on_plate(record: Recording) -> Taught:
    """On the shipped plate, level, its top at 20 mm."""
    return teach_path(record, fit_surface(load_part(workpiece_path("plate"))), 4.0, 0.0003, 0.002)


def off_circle(points: Array) -> Array:
    return np.abs(np.linalg.norm(points[:, :2], axis=1) - RADIUS)


@pytest.mark.parametrize("tremor", [0.0, 0.0005])
def test_a_hand_s_circle_comes_back_and_tremor_is_filtered_to_a_fifth(tremor):
    hand = circle(tremor)
    taught = taught_on_plate(hand)
    off = off_circle(taught.path.positions_work)[3:-3]
    rms = [np.sqrt(np.mean(gap**2)) for gap in (off, off_circle(hand.positions))]
    assert rms[0] < 0.2 * rms[1] if tremor else off.max() < 1e-4
    assert taught.path.length_m == pytest.approx(2.0 * np.pi * RADIUS, rel=5e-3)
    assert np.diff(taught.path.s).max() < 0.0025


def test_standing_still_is_no_path_a_hand_that_hardly_moves_teaches_none_and_a_line_is_simplified():
    taught = taught_on_plate(circle(still=3.0))
    assert taught.path.length_m == pytest.approx(2.0 * np.pi * RADIUS, rel=0.02)
    assert np.diff(taught.path.s).min() > 0.001
    with pytest.raises(PlanError, match="too little to teach a path"):
        taught_on_plate(circle()._replace(positions=0.01 * circle().positions))
    # No point is further from the simplified line than asked.
    points, tolerance = circle(tremor=0.0005).positions, 1e-3
    corners = simplified(points, tolerance)
    assert len(corners) < 0.02 * len(points)
    assert to_polyline(points, points[corners]).max() <= tolerance + 1e-12


def test_on_a_sphere_points_lie_on_it_and_axes_are_its_normals():
    mesh = load_part(workpiece_path("sphere_300"))
    surface, low, high = fit_surface(mesh), mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    record = circle(height=float(high[2]) - 0.3 + np.sqrt(0.3**2 - RADIUS**2) + 0.002)
    record = record._replace(positions=record.positions + [*(0.5 * (low + high)[:2]), 0.0])
    found = teach_path(record, surface, 4.0, 0.0003, 0.002)
    # The shipped calotte is a sphere of 300 mm; the hand was 2 mm above it.
    assert found.off_surface == pytest.approx(0.002, abs=3e-4)
    again = surface.closest(found.path.positions_work)
    np.testing.assert_allclose(again.positions, found.path.positions_work, atol=1e-9)
    np.testing.assert_allclose(np.sum(again.normals * found.path.axes_work, axis=1), 1.0, atol=1e-6)
