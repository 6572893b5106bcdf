"""Exact peaks of a corner kernel's speed, acceleration and jerk, and proven bounds on its deviation (layer 6).

Tip and tool axis both move as ``-a(t) r1 + b(t) r2``, planar vectors r1, r2 per generalised length (the axis to first
order). Along a cubic piece jerk is constant, the norm of the acceleration convex, the speed below its control points.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_shapes import HALF, PIECES

Array = NDArray[np.float64]


class Pair(NamedTuple):
    """Two vectors per generalised length: the rates on the old and on the new segment."""

    first: float
    """Length of r1."""
    second: float
    """Length of r2."""
    cosine: float
    """Of the turn between them."""
    sine: float
    """Of the turn, never less than it is."""
    old_way: float
    """Length of the whole old segment, in the pair's unit."""
    new_way: float


class Peaks(NamedTuple):
    """Largest norms over a kernel."""

    speed: float
    acceleration: float
    jerk: float


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def pair_of(first: float, second: float, cosine: float, spans: tuple[float, float]) -> Pair:
    """Make a pair; the sine is rounded up so that nothing is taken for straight that is not.

    Args:
        first: Length of r1.
        second: Length of r2.
        cosine: Of the turn.
        spans: Generalised lengths of both segments.

    Returns:
        The pair.
    """
    cosine = min(max(cosine, -1.0), 1.0) if first > 0.0 and second > 0.0 else 0.0
    sine = math.sqrt(1.0 - cosine * cosine + 1e-15)
    return Pair(float(first), float(second), cosine, sine, first * spans[0], second * spans[1])


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def norm_squared(pair: Pair, a: float, b: float) -> float:
    """Squared length of -a r1 + b r2, rounding kept from making it negative."""
    x, y = pair.first * a, pair.second * b
    return max((x - y) ** 2 + 2.0 * x * y * (1.0 - pair.cosine), 0.0)


@njit(cache=True, error_model="numpy", _nrt=False)
def measure_peaks(pair: Pair, durations: Array, remaining: Array, gone: Array) -> Peaks:
    """Bounds on the norms of the first three derivatives: acceleration and jerk exact, speed by control points.

    Args:
        pair: What moves.
        durations: Shape (PIECES,).
        remaining: c0 .. c3 of a, shape (PIECES, 4).
        gone: c0 .. c3 of b, shape (PIECES, 4).

    Returns:
        The peaks.
    """
    speed = acceleration = jerk = 0.0
    for p in range(PIECES if pair.first != pair.second else HALF):
        dt = durations[p]
        a1, a2, a3 = remaining[p, 1], remaining[p, 2], remaining[p, 3]
        b1, b2, b3 = gone[p, 1], gone[p, 2], gone[p, 3]
        jerk = max(jerk, norm_squared(pair, a3, b3))
        acceleration = max(acceleration, norm_squared(pair, a2, b2))
        acceleration = max(acceleration, norm_squared(pair, a2 + 3.0 * a3 * dt, b2 + 3.0 * b3 * dt))
        speed = max(speed, norm_squared(pair, a1, b1), norm_squared(pair, a1 + a2 * dt, b1 + b2 * dt))
        end_a, end_b = a1 + dt * (2.0 * a2 + 3.0 * a3 * dt), b1 + dt * (2.0 * b2 + 3.0 * b3 * dt)
        speed = max(speed, norm_squared(pair, end_a, end_b))
    return Peaks(math.sqrt(speed), 2.0 * math.sqrt(acceleration), 6.0 * math.sqrt(jerk))


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _largest(c0: float, c1: float, c2: float, c3: float, dt: float) -> float:
    """Largest absolute value of a cubic over [0, dt]."""
    largest = max(abs(c0), abs(c0 + dt * (c1 + dt * (c2 + dt * c3))))
    inside = c2 * c2 - 3.0 * c1 * c3
    if inside > 0.0:
        # Both roots of the derivative without cancellation: q / (3 c3) and c1 / q.
        q = -(c2 + math.copysign(math.sqrt(inside), c2))
        for t in (q / (3.0 * c3) if c3 != 0.0 else 0.0, c1 / q if q != 0.0 else 0.0):
            if 0.0 < t < dt:
                largest = max(largest, abs(c0 + t * (c1 + t * (c2 + t * c3))))
    return largest


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _highest_control(c0: float, c1: float, c2: float, c3: float, dt: float) -> float:
    """Largest control value of a cubic over [0, dt]: nowhere is it higher."""
    first, second = c0 + c1 * dt / 3.0, c0 + (2.0 * c1 + c2 * dt) * dt / 3.0
    return max(c0, first, second, c0 + dt * (c1 + dt * (c2 + dt * c3)))


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _beside(pair: Pair, swap: bool, bend: float, near: Array, far: Array, dt: float) -> float:
    """Bound on a piece's distance to one of the two segments, the one it is going along.

    Args:
        pair: What moves.
        swap: Whether it is the new segment.
        bend: Allowance for the axis moving on a sphere [rad].
        near: Progress along that segment, c0 .. c3.
        far: Along the other one.
        dt: Duration of the piece.

    Returns:
        Bound on the distance: across, and past either end where the foot is not on the segment.
    """
    r1, r2 = (pair.second, pair.first) if swap else (pair.first, pair.second)
    across = _largest(far[0], far[1], far[2], far[3], dt) * r2 * pair.sine
    along = r2 * pair.cosine
    c0, c1 = along * far[0] - r1 * near[0], along * far[1] - r1 * near[1]
    c2, c3 = along * far[2] - r1 * near[2], along * far[3] - r1 * near[3]
    beyond = _highest_control(c0, c1, c2, c3, dt)
    behind = _highest_control(-c0, -c1, -c2, -c3, dt) - (pair.new_way if swap else pair.old_way)
    past = max(beyond, behind) + bend
    return math.hypot(across, past) if past > 0.0 else across


@njit(cache=True, error_model="numpy", _nrt=False)
def bound_deviation(pair: Pair, bend: float, durations: Array, remaining: Array, gone: Array) -> float:
    """Bound on the distance of a kernel's motion from its two segments.

    Args:
        pair: What moves.
        bend: Allowance added beyond the vertex for the axis moving on a sphere [rad]; 0 for the tip.
        durations: Shape (PIECES,).
        remaining: c0 .. c3 of a, shape (PIECES, 4).
        gone: c0 .. c3 of b, shape (PIECES, 4).

    Returns:
        The bound, in the pair's unit.
    """
    deviation = 0.0
    symmetric = pair.first == pair.second and pair.old_way == pair.new_way
    for p in range(HALF if symmetric else PIECES):
        old = _beside(pair, False, bend, remaining[p], gone[p], durations[p])
        if old > deviation:
            deviation = max(deviation, min(old, _beside(pair, True, bend, gone[p], remaining[p], durations[p])))
    return deviation


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def distance_from_vertex(pair: Pair, remaining: Array, gone: Array) -> float:
    """Distance from the vertex in the middle of a kernel."""
    return math.sqrt(norm_squared(pair, remaining[HALF, 0], gone[HALF, 0]))
