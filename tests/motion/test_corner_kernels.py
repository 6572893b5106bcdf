"""Corner kernels: limits and tolerances held, known corners, and how much time they lose."""

import numpy as np
import pytest
from numba import njit

from polish_sim.motion.certified.corner import (
    PIECES,
    CornerLimits,
    CornerWeights,
    corner_kernel,
    corner_shapes,
)

SHAPES = corner_shapes()
SPEED, ACCELERATION, JERK, TOLERANCE = 0.05, 0.5, 10.0, 2e-5
AXIS = np.radians([10.0, 100.0, 2000.0, 0.02])


@njit
def round_corners(weights, limits, shapes, figures, durations, remaining, gone):
    for i in range(len(weights)):
        w, m = weights[i], limits[i]
        f = corner_kernel(
            CornerWeights(w[0], w[1], w[2], w[3], w[4], w[5]),
            CornerLimits(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9], m[10]),
            shapes,
            durations[i],
            remaining[i],
            gone[i],
        )
        figures[i, 0], figures[i, 1], figures[i, 2], figures[i, 3] = f.size, f.speed, f.acceleration, f.duration


def kernels(weights, limits):
    """Kernels of n corners: figures (n, 4), durations (n, P), remaining and gone (n, P, 4)."""
    n = len(weights)
    out = np.zeros((n, 4)), np.zeros((n, PIECES)), np.zeros((n, PIECES, 4)), np.zeros((n, PIECES, 4))
    round_corners(np.asarray(weights, float), np.asarray(limits, float), SHAPES, *out)
    return out


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
    weights = np.column_stack([scale**2, scale[:, 0] * scale[:, 1] * np.cos(turn), axis, cosine])
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


def distance_to_rays(points, turn):
    """Distance to the half line that comes along x to the origin, or the one that leaves at ``turn``."""
    leaving = np.stack([np.cos(turn), np.sin(turn)], axis=-1)[:, None, :]
    distances = []
    for direction in (np.array([-1.0, 0.0]), leaving):
        along = np.maximum((points * direction).sum(-1), 0.0)
        distances.append(np.linalg.norm(points - along[..., None] * direction, axis=-1))
    return np.minimum(*distances)


def test_limits_and_tip_tolerance_hold_on_random_corners(rng):
    weights, limits = random_corners(rng, 20000)
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
    tip = planar(first, second, turn, sampled(remaining, durations, 0), sampled(gone, durations, 0))
    assert (distance_to_rays(tip, turn).max(axis=1) <= limits[:, 3] * (1 + 1e-9)).all()
    assert (np.linalg.norm(tip, axis=-1).min(axis=1) <= 2.0 * limits[:, 3] * (1 + 1e-9)).all()
    size, speed, acceleration, _duration = figures.T
    assert (speed + 0.5 * acceleration**2 / limits[:, 10] <= limits[:, 8] * (1 + 1e-9)).all()
    assert (acceleration <= limits[:, 9] * (1 + 1e-9)).all()
    assert (acceleration >= 0.0).all()
    assert (size >= 0.0).all()
    assert (speed > 0.0).all()


@pytest.fixture
def rng():
    return np.random.default_rng(5)
