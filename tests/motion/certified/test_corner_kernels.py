"""Corner kernels: limits and tolerances held, known corners, and how much time they lose."""

import numpy as np
import pytest

from polish_sim.motion.certified.connector import Peaks
from polish_sim.motion.certified.corner import corner_kernel, corner_shapes, time_lost
from polish_sim.motion.certified.kernel import Corner, Figures, Kernel, side_of

SHAPES = corner_shapes()
SPEED, ACCELERATION, JERK, TOLERANCE = 0.05, 0.5, 10.0, 2e-5
AXIS = np.radians([10.0, 100.0, 2000.0, 0.02])


def kernels(weights, limits):
    """Kernels of n corners: figures (n, 4), durations (n, P), remaining and gone (n, P, 4)."""
    figures, filled = np.zeros((len(weights), 4)), np.zeros(len(weights), Kernel.dtype)
    for i, (w, m) in enumerate(zip(np.asarray(weights, float), np.asarray(limits, float), strict=True)):
        one, two = np.sqrt(w[:2])
        tip = side_of(one, two, w[2] / max(one * two, 1e-300), Peaks(*m[:3]), m[3], False)
        axis = side_of(w[3], w[4], w[5], Peaks(*m[4:7]), m[7], True)
        figures[i] = corner_kernel(Corner(tip, axis, Peaks(*m[8:11]), (w[6], w[7])), SHAPES, filled[i])
    return figures, filled["durations"], filled["remaining"], filled["gone"]


def usual_limits(n, tolerance=TOLERANCE):
    lines = [SPEED, ACCELERATION, JERK]
    return np.tile([*lines, tolerance, *AXIS, *lines], (n, 1))


def random_corners(rng, n):
    """Weights and limits over many orders of magnitude, sides that rest, reversals, tiny turns."""
    turn = rng.choice([0.0, 1.0, 2.0], n, p=[0.05, 0.9, 0.05])
    turn = np.where(turn == 0.0, 10.0 ** rng.uniform(-6, -1, n), np.where(turn == 2.0, np.pi, rng.uniform(0, np.pi, n)))
    scale = np.where(rng.random((n, 2)) < 0.3, rng.random((n, 2)), 1.0) * (rng.random((n, 2)) > 0.03)
    axis = np.where(rng.random((n, 2)) < 0.5, 0.0, 3.5 * rng.random((n, 2)) ** 2)
    axis = np.where((scale == 0.0) & (axis == 0.0), 1.0, axis)
    whole = np.maximum(scale, axis * SPEED / AXIS[0])
    scale, axis = scale / whole, axis / whole
    cosine = np.cos(np.pi * rng.random(n))
    spans = 10.0 ** rng.uniform(-5.0, 0.0, (n, 2))
    weights = np.column_stack([scale**2, scale[:, 0] * scale[:, 1] * np.cos(turn), axis, cosine, spans])
    limits = usual_limits(n)
    limits[:, 3] *= 10.0 ** rng.uniform(-2, 1.5, n)
    limits[:, 7] *= 10.0 ** rng.uniform(-1, 1.5, n)
    limits[:, :3] *= 10.0 ** rng.uniform(-0.5, 0.5, (n, 3))
    limits[:, 8:] *= 10.0 ** rng.uniform(-0.7, 0.0, (n, 3))
    return weights, limits


def sampled(pieces, durations, order, points=9):
    """Derivative of the cubic pieces at ``points`` places in each, shape (n, P points)."""
    t = np.linspace(0.0, 1.0, points) * durations[..., None]
    c = pieces[:, :, None, :]
    value = [
        c[..., 0] + t * (c[..., 1] + t * (c[..., 2] + t * c[..., 3])),
        c[..., 1] + t * (2 * c[..., 2] + 3 * t * c[..., 3]),
        2 * c[..., 2] + 6 * t * c[..., 3],
        6 * c[..., 3] + 0 * t,
    ][order]
    return value.reshape(len(pieces), -1)


def planar(first, second, turn, a, b):
    """-a r1 + b r2 in the plane, r1 along x."""
    first, second, turn = first[:, None], second[:, None], turn[:, None]
    return np.stack([-a * first + b * second * np.cos(turn), b * second * np.sin(turn)], axis=-1)


def distance_to_sides(points, turn, ways):
    """Distance to the segment that comes along x to the origin, or the one that leaves at ``turn``; both lengths."""
    leaving = np.stack([np.cos(turn), np.sin(turn)], axis=-1)[:, None, :]
    distances = []
    for direction, way in zip((np.array([-1.0, 0.0]), leaving), ways.T, strict=True):
        along = np.clip((points * direction).sum(-1), 0.0, way[:, None])
        distances.append(np.linalg.norm(points - along[..., None] * direction, axis=-1))
    return np.minimum(*distances)


def test_limits_and_tip_tolerance_hold_on_random_corners(rng):
    weights, limits = random_corners(rng, 5000)
    figures, durations, remaining, gone = kernels(weights, limits)
    first, second = np.sqrt(weights[:, 0]), np.sqrt(weights[:, 1])
    turn = np.arccos(np.clip(weights[:, 2] / np.maximum(first * second, 1e-300), -1, 1))
    assert np.isfinite(figures).all()
    for sides, most in (
        ((first, second, turn), limits[:, :3]),
        ((weights[:, 3], weights[:, 4], np.arccos(weights[:, 5])), limits[:, 4:7]),
    ):
        for order in (1, 2, 3):
            a, b = sampled(remaining, durations, order), sampled(gone, durations, order)
            norm = np.linalg.norm(planar(*sides, a, b), axis=-1).max(axis=1)
            assert (norm <= most[:, order - 1] * (1 + 1e-9)).all()
    ways = np.column_stack([first, second]) * weights[:, 6:8]
    tip = planar(first, second, turn, sampled(remaining, durations, 0), sampled(gone, durations, 0))
    assert (distance_to_sides(tip, turn, ways).max(axis=1) <= limits[:, 3] * (1 + 1e-9)).all()
    assert (np.linalg.norm(tip, axis=-1).min(axis=1) <= 2.0 * limits[:, 3] * (1 + 1e-9)).all()
    size, speed, acceleration, _duration = figures.T
    assert (speed + 0.5 * acceleration**2 / limits[:, 10] <= limits[:, 8] * (1 + 1e-9)).all()
    assert (acceleration <= limits[:, 9] * (1 + 1e-9)).all()
    assert (acceleration >= 0.0).all()
    assert (size >= 0.0).all()
    assert (speed > 0.0).all()


def test_smaller_kernels_of_the_family_hold_too(rng):
    weights, limits = random_corners(rng, 500)
    _figures, durations, remaining, gone = kernels(weights, limits)
    share = rng.random(500)[:, None] ** 2
    powers = share[:, :, None] ** (1.0 - np.arange(4) / 3.0)
    first, second = np.sqrt(weights[:, 0]), np.sqrt(weights[:, 1])
    turn = np.arccos(np.clip(weights[:, 2] / np.maximum(first * second, 1e-300), -1, 1))
    times = durations * np.cbrt(share)
    for order in (1, 2, 3):
        a, b = (sampled(pieces * powers, times, order) for pieces in (remaining, gone))
        norm = np.linalg.norm(planar(first, second, turn, a, b), axis=-1).max(axis=1)
        assert (norm <= limits[:, order - 1] * (1 + 1e-9)).all()


def turned(axis, angles, vectors):
    """Rodrigues: ``vectors`` (n, 3) turned about the unit ``axis`` by ``angles`` (n,)."""
    along = np.outer(vectors @ axis, axis) * (1 - np.cos(angles))[:, None]
    return vectors * np.cos(angles)[:, None] + np.cross(axis, vectors) * np.sin(angles)[:, None] + along


def distance_to_arc(points, start, end):
    """Angle between unit vectors (n, 3) and the great-circle arc between two others."""
    normal = np.cross(start, end) / np.linalg.norm(np.cross(start, end))
    foot = points - np.outer(points @ normal, normal)
    angle = np.arctan2(foot @ np.cross(normal, start), foot @ start)
    inside = (angle >= 0.0) & (angle <= np.arctan2(np.linalg.norm(np.cross(start, end)), start @ end))
    to_ends = [2.0 * np.arcsin(0.5 * np.linalg.norm(points - e, axis=1)) for e in (start, end)]
    return np.where(inside, np.abs(np.arcsin(np.clip(points @ normal, -1, 1))), np.minimum(*to_ends))


def test_axis_tolerance_holds_on_the_sphere(rng):
    weights, limits = random_corners(rng, 400)
    limits[:, 7] *= 10.0
    _figures, durations, remaining, gone = kernels(weights, limits)
    a, b = sampled(remaining, durations, 0), sampled(gone, durations, 0)
    vertex = np.array([0.0, 0.0, 1.0])
    for i in np.flatnonzero((weights[:, 3] > 0.0) & (weights[:, 4] > 0.0)):
        turn = np.arccos(weights[i, 5])
        n1, n2 = np.array([0.0, 1.0, 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
        before = turned(n1, -weights[i, 3] * a[i], np.tile(vertex, (a.shape[1], 1)))
        axes = turned(n2, weights[i, 4] * b[i], before)
        ends = turned(n1, np.array([-1.0]), vertex[None])[0], turned(n2, np.array([1.0]), vertex[None])[0]
        off = np.minimum(distance_to_arc(axes, ends[0], vertex), distance_to_arc(axes, vertex, ends[1]))
        assert off.max() <= limits[i, 7] * (1 + 1e-9)


def tip_corner(turn, tolerance=TOLERANCE):
    """Kernel of a corner without a turn of the axis, and the time it loses [s]."""
    out = kernels([[1.0, 1.0, np.cos(turn), 0.0, 0.0, 1.0, 1.0, 1.0]], usual_limits(1, tolerance))
    return out, time_lost(Figures(*out[0][0]), Peaks(SPEED, ACCELERATION, JERK))


def test_straight_on_loses_nothing():
    (figures, durations, *_), lost = tip_corner(0.0)
    assert tuple(figures[0]) == (0.0, pytest.approx(SPEED), 0.0, 0.0)
    assert durations.sum() == 0.0
    assert abs(lost) < 1e-12


def test_a_small_turn_is_passed_at_full_speed():
    (figures, *_), lost = tip_corner(np.radians(3.0))
    assert figures[0, 1] == pytest.approx(SPEED)
    assert abs(lost) < 1e-9


def test_no_tolerance_is_an_exact_stop():
    (figures, *_), lost = tip_corner(1.0, 0.0)
    assert tuple(figures[0]) == (0.0, 0.0, 0.0, 0.0)
    assert lost == pytest.approx(0.15)  # V/A + A/J


def test_a_reversal_need_not_let_go_of_its_acceleration():
    # Braking goes over into speeding up at A: its fall and rise are saved but for two rounded ends.
    _, lost = tip_corner(np.pi)
    assert 0.08 < lost < 0.105


@pytest.mark.parametrize(("degrees", "best"), [(30.0, 0.0763), (60.0, 0.0974), (90.0, 0.0925), (135.0, 0.0969)])
def test_a_corner_loses_little_more_than_the_best_motion_there_is(degrees, best):
    # Best: benchmarks.corner_bound, 160 free pieces. An exact stop loses 0.150 s.
    _, lost = tip_corner(np.radians(degrees))
    assert best - 2e-4 < lost < 1.04 * best


@pytest.fixture
def rng():
    return np.random.default_rng(5)
