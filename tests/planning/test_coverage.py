"""What the pad reaches and for how long: closed forms of the elastic foundation, areas and times counted by
hand."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.config import PadConfig, PlanConfig, ProcessConfig
from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.ground.ground import prepare_ground
from polish_sim.planning.ground.points import thin
from polish_sim.planning.ground.triangulation import triangulate
from polish_sim.planning.quality.coverage import (
    PadSteps,
    pad_depths,
    pad_steps,
    strict_share,
    strictly_covered,
    time_under_pad,
)
from polish_sim.planning.quality.located import locate, with_points_between
from tests.planning.shapes import UP, path_through, region_of

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


# Time under the pad against closed forms, and its invariants.


def flat_steps(points, feed):
    """Steps of the pad over a plane, pressed in a little."""
    points = np.asarray(points, dtype=float)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    count = len(length)
    return PadSteps(points[:-1], points[1:], np.tile(UP, (count, 1)), np.full(count, 1e-3), length / feed)


def on_plane(xy):
    return np.column_stack([xy, np.zeros(len(xy))])


def test_a_straight_line_gives_2_sqrt_r2_minus_y2_over_the_feed():
    y = np.linspace(-1.2 * R, 1.2 * R, 49)
    points = on_plane(np.column_stack([np.full(49, 0.003), y]))
    steps = flat_steps(on_plane(np.column_stack([np.linspace(-0.1, 0.1, 37), np.zeros(37)])), 0.01)
    times = time_under_pad(points, np.tile(UP, (49, 1)), steps, R)
    assert times == pytest.approx(2.0 * np.sqrt(np.maximum(R**2 - y**2, 0.0)) / 0.01, abs=1e-9)


def test_on_a_circle_the_middle_is_under_the_pad_all_the_time_within_reach_and_never_beyond():
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    middle, normal = np.zeros((1, 3)), UP[None]
    for radius, share in ((0.9 * R, 1.0), (1.1 * R, 0.0)):
        circle = on_plane(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        steps = flat_steps(circle, 0.01)
        assert time_under_pad(middle, normal, steps, R)[0] == pytest.approx(
            share * steps.times.sum(), rel=1e-12
        )


def test_the_area_integral_of_the_time_is_pad_area_times_duration():
    rng = np.random.default_rng(1)
    places = on_plane(rng.uniform(-0.08, 0.08, (200_000, 2)))
    steps = flat_steps(on_plane([[-0.03, 0.0], [0.03, 0.01], [0.0, 0.03]]), 0.01)
    times = time_under_pad(places, np.tile(UP, (len(places), 1)), steps, R)
    assert times.mean() * 0.16**2 == pytest.approx(np.pi * R**2 * steps.times.sum(), rel=0.01)


def test_the_time_does_not_depend_on_the_frame():
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    places = on_plane(rng.uniform(-0.08, 0.08, (3000, 2)))
    steps = flat_steps(on_plane([[-0.03, 0.0], [0.03, 0.01], [0.0, 0.03]]), 0.01)
    moved = PadSteps(
        *(a @ turn.T + shift for a, shift in zip(steps[:3], (0.3, 0.3, 0.0), strict=True)), *steps[3:]
    )
    there = time_under_pad(places, np.tile(UP, (3000, 1)), steps, R)
    here = time_under_pad(places @ turn.T + 0.3, np.tile(turn @ UP, (3000, 1)), moved, R)
    assert here == pytest.approx(there, abs=1e-9)


def test_feed_and_long_chords_of_a_path_count():
    """Twice as fast on the second half: half the time there; two points a line are as good as many."""
    ground = prepare_ground(region_of("plate"), PlanConfig())
    feed = np.array([0.01, 0.01, 0.02, 0.02])
    ends = [[-0.08, 0.0, 0.02], [-1e-4, 0.0, 0.02], [1e-4, 0.0, 0.02], [0.08, 0.0, 0.02]]
    on = locate(ground, path_through(ends, feed=feed), ProcessConfig())
    steps = pad_steps(on, PAD)
    places = np.array([[-0.04, 0.01, 0.02], [0.04, 0.01, 0.02]])
    times = time_under_pad(places, np.tile(UP, (2, 1)), steps, R)
    whole = 2.0 * np.sqrt(R**2 - 0.01**2) / 0.01
    assert times == pytest.approx([whole, 0.5 * whole], rel=1e-6)


def test_points_between_leave_the_polyline_as_it_is():
    path = path_through([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.05, 0.0013, 0.0], [0.02, 0.03, 0.0]])
    dense = with_points_between(path)
    assert dense.s[-1] == pytest.approx(path.s[-1], rel=1e-14)
    assert np.diff(dense.s).max() < 2e-3 + 1e-12
    assert {tuple(row) for row in path.positions_work} <= {tuple(row) for row in dense.positions_work}


def test_a_tilted_pad_sinks_in_until_it_carries_the_force():
    """Touching all over, a tilt changes nothing: lifted springs on one side press as much more on the
    other."""
    small = 0.5 * 20.0 / PAD.stiffness_n_m / R
    assert pad_depths(np.zeros((1, 2)), PAD, 20.0, np.array([[small, 0.0]])) == pytest.approx(
        [1e-3], rel=1e-3
    )


def test_a_strongly_tilted_pad_stands_on_its_edge():
    """At a slope of 0.5 only a segment of the disc touches; the springs there carry the force."""
    depth = pad_depths(np.zeros((1, 2)), PAD, 20.0, np.array([[0.5, 0.0]]))[0]
    assert depth < -0.004
    x = np.linspace(-R, R, 200_001)
    pressure = PAD.stiffness_n_m / (np.pi * R**2) * np.maximum(depth + 0.5 * x, 0.0)
    assert np.trapezoid(pressure * 2.0 * np.sqrt(R**2 - x**2), x) == pytest.approx(20.0, rel=0.05)


def test_thinned_points_are_apart_and_leave_nothing_out():
    points = np.random.default_rng(3).uniform(0.0, 0.1, (5000, 3)) * [1.0, 1.0, 0.1]
    some = thin(points, 0.004)
    kept = points[some.kept]
    gaps = np.linalg.norm(kept[:, None] - kept, axis=2) + np.eye(len(kept))
    assert gaps.min() >= 0.004
    assert np.linalg.norm(points - kept[some.stands_for], axis=1).max() < 0.004
