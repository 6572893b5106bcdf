"""What the pad reaches: closed forms of the elastic foundation, and shares of areas that can be counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.config import PadConfig
from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.ground.triangulation import triangulate
from polish_sim.planning.quality.coverage import PadSteps, pad_depths, strict_share, strictly_covered, time_under_pad
from tests.planning.shapes import region_of

PAD = PadConfig()
R, K, F = PAD.radius_m, PAD.stiffness_n_m, 20.0


def test_on_a_plane_the_pad_sinks_in_by_force_over_stiffness():
    assert pad_depths(np.zeros((1, 2)), PAD, F) == pytest.approx([F / K], rel=1e-12)


@pytest.mark.parametrize("radius", [0.05, 0.1])
def test_on_a_tight_sphere_only_a_spot_touches(radius):
    """With depth d the spot's radius is sqrt(2 R_s d) and the force K d^2 R_s / R^2."""
    depth = np.sqrt(F * R**2 / (K * radius))
    assert pad_depths(np.full((1, 2), 1.0 / radius), PAD, F) == pytest.approx([depth], rel=0.01)


def test_on_a_gentle_sphere_the_whole_pad_touches():
    """The mean compression is F / K, so the middle goes R^2 / (4 R_s) deeper."""
    assert pad_depths(np.full((1, 2), 1.0), PAD, F) == pytest.approx([F / K + R**2 / 4.0], rel=0.01)


def test_in_a_hollow_the_middle_stays_off():
    assert pad_depths(np.full((1, 2), -1.0), PAD, F) == pytest.approx([F / K - R**2 / 4.0], rel=0.01)


def line(count=400):
    x = np.linspace(-0.1, 0.1, count)
    return np.stack([x, 0.0 * x, np.full(count, 0.02)], axis=1), np.tile([0.0, 0.0, 1.0], (count, 1))


def test_one_line_across_a_plate_covers_a_stripe():
    mesh = triangulate(region_of("plate").surface, 0.002)
    positions, normals = line()
    share = strict_share(mesh, int(mesh.owners.max()) + 1, [Curve(positions, normals, False)], 0.04)
    assert share == pytest.approx(2 * 0.55 * 0.04 / 0.2, abs=6e-4)


def test_the_pad_on_a_plate_covers_a_stripe_of_its_diameter():
    mesh = triangulate(region_of("plate").surface, 0.002)
    positions, normals = line()
    count = len(positions) - 1
    steps = PadSteps(positions[:-1], positions[1:], normals[1:], np.full(count, F / K), np.ones(count))
    covered = time_under_pad(mesh.vertices, mesh.normals, steps, R) > 0.0
    assert mesh.vertex_areas[covered].sum() == pytest.approx(2 * R * 0.2, rel=0.03)


def test_the_other_side_of_the_part_is_not_covered():
    mesh = triangulate(region_of("plate").surface, 0.004)
    positions, normals = line()
    assert not strictly_covered(mesh.vertices, mesh.normals, [Curve(positions, -normals, False)], 0.04).any()
