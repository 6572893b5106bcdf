"""The fastest way round a corner as a convex programme: half a motion, symmetric about the corner's middle.

Units of acceleration and jerk are their limits: lengths in A^3/J^2, times in A/J. Frame: the vertex is the
origin, x along the bisector of the two directions, y towards the inside. The motion comes from far away along
the first line at full speed; acceleration is linear in each piece of time. Speed, acceleration and jerk are
bounded in norm, the distance to the line by the tolerance: all convex in the accelerations, and so is the
distance that is left to the vertex at the start. Maximising it in a given time is losing the least. Needs the
solver of the extra `bench`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import clarabel
import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

Array = NDArray[np.float64]

VERTEX_SHARE = 2.0
SKEW = 4.0
"""Most a'' - b'' and its rate may be: else they would not be unique where the path turns back."""


class Corner(NamedTuple):
    """At unit acceleration and jerk."""

    angle: float
    """The path turns by [rad], in (0, pi)."""
    tolerance: float
    """Distance from the two lines."""
    speed: float
    """Speed limit."""


class HalfMotion(NamedTuple):
    """Solution of the programme."""

    lost: float
    """Time lost by the whole corner."""
    accelerations: Array
    """At the knots of the free pieces, shape (m + 1, 2)."""
    slowing: float
    """Deceleration along the line where the free pieces begin."""


class _Programme:
    """Rows of linear and cone constraints on (accelerations x, y of every knot, distance, feet)."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.rows: dict[str, list[tuple[Array, float]]] = {"zero": [], "positive": []}
        self.balls: list[list[tuple[Array, float]]] = []

    def vanish(self, row: Array, value: float = 0.0) -> None:
        self.rows["zero"].append((row, value))

    def positive(self, row: Array, value: float = 0.0) -> None:
        self.rows["positive"].append((row, value))

    def within(self, radius: float, *parts: tuple[Array, float]) -> None:
        self.balls.append([(np.zeros(self.count), radius), *parts])

    def maximise(self, row: Array, smoothing: Array) -> tuple[Array, bool]:
        cones = [
            clarabel.ZeroConeT(len(self.rows["zero"])),
            clarabel.NonnegativeConeT(len(self.rows["positive"])),
        ]
        cones += [clarabel.SecondOrderConeT(len(ball)) for ball in self.balls]
        lines = self.rows["zero"] + self.rows["positive"] + [line for ball in self.balls for line in ball]
        matrix = sparse.csc_matrix(-np.array([line[0] for line in lines]))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        quadratic = sparse.csc_matrix(np.triu(smoothing))
        values = np.array([line[1] for line in lines])
        solution = clarabel.DefaultSolver(quadratic, -row, matrix, values, cones, settings).solve()
        return np.array(solution.x), str(solution.status) in ("Solved", "AlmostSolved")


class _Integrals(NamedTuple):
    """Velocity and position at times, linear in the knots' accelerations, shape (n, knots) each."""

    times: Array
    velocity: Array
    position: Array


def _integrate(durations: Array, straight: int, samples: int) -> tuple[_Integrals, _Integrals]:
    """Integrals at the knots, and at ``samples`` places in every piece, one in the first ``straight``."""
    knots = len(durations) + 1
    starts = np.concatenate([[0.0], np.cumsum(durations)])
    velocity, position = np.zeros((knots, knots)), np.zeros((knots, knots))
    inner: list[tuple[float, Array, Array]] = []
    for k, dt in enumerate(durations):
        places = samples if k >= straight else 1
        for t in dt * np.arange(1, places + 1) / places:
            v, p = velocity[k].copy(), position[k] + t * velocity[k]
            v[k : k + 2] += [t - t * t / (2 * dt), t * t / (2 * dt)]
            p[k : k + 2] += [t * t / 2 - t**3 / (6 * dt), t**3 / (6 * dt)]
            inner.append((starts[k] + t, v, p))
        velocity[k + 1], position[k + 1] = inner[-1][1], inner[-1][2]
    times, v, p = (np.array(list(part)) for part in zip(*inner, strict=True))
    return _Integrals(starts, velocity, position), _Integrals(times, v, p)


def solve_half(
    corner: Corner, straight: Array, free: Array, samples: int, smoothing: float = 1e-4
) -> HalfMotion:
    """Solve the programme.

    Args:
        corner: The corner.
        straight: Durations of pieces along the line, from full speed, shape (n,).
        free: Durations of the pieces after them, up to the middle, shape (m,).
        samples: Places per piece where speed and distance are held.
        smoothing: Weight on the square of the jerk, to make solutions unique.

    Returns:
        The half motion.
    """
    durations = np.concatenate([straight, free])
    knots, first = len(durations) + 1, len(straight)
    at_knots, at_samples = _integrate(durations, first, samples)
    count = 2 * knots + 1 + len(at_samples.times)
    cosine, sine = math.cos(corner.angle / 2), math.sin(corner.angle / 2)
    along, across = np.array([cosine, -sine]), np.array([sine, cosine])
    programme = _Programme(count)

    def of_knots(weights: Array, axis: int, value: float = 0.0, distance: float = 0.0) -> tuple[Array, float]:
        row = np.zeros(count)
        row[axis : 2 * knots : 2] = weights
        row[2 * knots] = -distance * along[axis]
        return row, value * along[axis]

    def vector(weights: Array, value: float = 0.0, distance: float = 0.0) -> list[tuple[Array, float]]:
        return [of_knots(weights, axis, value, distance) for axis in (0, 1)]

    def towards(parts: list[tuple[Array, float]], direction: Array) -> tuple[Array, float]:
        return sum(d * p[0] for d, p in zip(direction, parts, strict=True)), sum(  # type: ignore[return-value]
            d * p[1] for d, p in zip(direction, parts, strict=True)
        )

    unit, v = np.eye(knots), corner.speed
    ends = len(at_samples.times) - 1
    position = [vector(at_samples.position[i], v * t, 1.0) for i, t in enumerate(at_samples.times)]
    velocity = [vector(at_samples.velocity[i], v) for i in range(ends + 1)]
    for part in vector(unit[0]):
        programme.vanish(*part)
    for part in (of_knots(unit[-1], 0), velocity[-1][1], position[-1][0]):
        programme.vanish(*part)
    for k in range(1, first + 1):
        programme.vanish(*towards(vector(unit[k]), across))
    row, value = position[-1][1]
    programme.positive(-row, VERTEX_SHARE * corner.tolerance - value)
    if first:
        programme.positive(*towards(vector(unit[first]), -along))
    for i in range(ends + 1):
        foot = np.zeros(count)
        foot[2 * knots + 1 + i] = 1.0
        programme.positive(foot)
        programme.positive(-position[i][0][0], -position[i][0][1])
        programme.within(v, *velocity[i])
        if at_samples.times[i] > at_knots.times[first]:
            near = [(part[0] + d * foot, part[1]) for d, part in zip(along, position[i], strict=True)]
            programme.within(corner.tolerance, *near)
    quadratic = np.zeros((count, count))
    for k in range(knots):
        programme.within(1.0, *vector(unit[k]))
        if k == knots - 1:
            continue
        change, dt = unit[k + 1] - unit[k], durations[k]
        programme.within(dt, *vector(change))
        if k >= first > 0:
            programme.within(SKEW * cosine, of_knots(unit[k], 0))
            programme.within(SKEW * cosine * dt, of_knots(change, 0))
            for axis in (0, 1):
                row = of_knots(change, axis)[0]
                quadratic += smoothing / dt * np.outer(row, row)
    farthest = np.zeros(count)
    farthest[2 * knots] = 1.0
    x, solved = programme.maximise(farthest, quadratic)
    if not solved:
        raise ArithmeticError(f"No solution for {corner}")
    accelerations = x[: 2 * knots].reshape(-1, 2)
    lost = 2.0 * (durations.sum() - x[2 * knots] / v)
    return HalfMotion(lost, accelerations[first:], float(-accelerations[first] @ along))


def braking_time(speed: float) -> float:
    """Time to stop from full speed, with a little to spare."""
    return 1.02 * (speed + 1.0 if speed >= 1.0 else 2.0 * math.sqrt(speed))


def least_time_lost(corner: Corner, pieces: int) -> float:
    """Time lost by the best motion with all its pieces free: what no kernel can beat, but for ever finer
    pieces."""
    turned = min(corner.angle, math.radians(178.0))
    total = max(braking_time(corner.speed) * 1.05, 0.3)
    none = np.zeros(0)
    return solve_half(corner._replace(angle=turned), none, np.full(pieces, total / pieces), 1, 0.0).lost
