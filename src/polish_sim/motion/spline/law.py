"""The fastest law of time along a curve whose quantities keep their limits (Bounded -> u'^2; layer 6).

The unknown is b = u'^2, a quadratic spline of u that is to be as large as possible everywhere. Acceleration is linear
in b. Jerk is u' times something linear: that something has to stay below limit / sqrt(b), and the tangent of
1 / sqrt(b) at the last solution is below it for every b. So each round is a linear programme whose solution keeps
what was asked for; asked for are, round by round, the directions in which a vector has come near its limit or beyond.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.spline.bounded import Bounded, speed_cap, steady_cap
from polish_sim.motion.spline.program import Rows, join_rows, maximize
from polish_sim.motion.spline.squares import Squares, control_values, squares_on
from polish_sim.motion.spline.terms import Terms, along_the_way, beyond, rows_of, terms_of

Array = NDArray[np.float64]

MOST_ROUNDS = 20
KEPT = 1.01
"""Excess over what is planned with at which the rounds end."""
LEAST = 1e-6
"""Least share of a first guess a control value is taken for."""


class Launch(NamedTuple):
    """Constant jerk from rest, and mirrored at the other end into rest."""

    jerk: float
    """[m/s^3]."""
    duration: float
    """[s]."""

    @property
    def way(self) -> float:
        """[m]."""
        return self.jerk * self.duration**3 / 6.0

    @property
    def speed(self) -> float:
        """At its end [m/s]."""
        return 0.5 * self.jerk * self.duration**2

    @property
    def acceleration(self) -> float:
        """At its end [m/s^2]."""
        return self.jerk * self.duration


class Law(NamedTuple):
    """b(u) between the launches."""

    squares: Squares
    controls: Array
    """Its control values [m^2/s^2], shape (n + 1,)."""
    launch: Launch


def plan_law(knots: Array, caps: Array, quantities: list[Bounded], launch: Launch) -> Law:
    """The fastest law.

    Args:
        knots: Of b, from the end of the launch to the start of the landing [m], shape (n,).
        caps: Largest u' wanted there [m/s], positive, shape (n,).
        quantities: At the knots.
        launch: How the motion begins; the landing is its mirror image.

    Returns:
        The law; it keeps the limits at the knots but for ``KEPT``.
    """
    squares = squares_on(knots)
    caps = np.minimum.reduce([caps, *(speed_cap(each) for each in quantities)])
    most = np.concatenate([caps[:1], np.minimum(caps[:-1], caps[1:]), caps[-1:]]) ** 2
    size = np.minimum(most, control_values(squares, envelope(knots, caps, quantities, launch) ** 2))
    fixed = np.zeros(len(size), dtype=bool)
    for two, span in (([0, 1], knots[1] - knots[0]), ([-1, -2], knots[-1] - knots[-2])):
        # Value and slope where the launch hands over.
        size[two] = launch.speed**2 + np.array([0.0, launch.acceleration * span])
        fixed[two] = True
    most = np.maximum(most, size)
    terms: list[Terms] = [each for quantity in quantities for each in terms_of(squares, quantity)]
    asked = [along_the_way(each) for each in terms]
    controls = size
    for _ in range(MOST_ROUNDS):
        rows = join_rows([_bounds(most, size, fixed), *(rows_of(each, controls, size, fixed) for each in asked)])
        shares = maximize(np.ones(len(size)), rows)
        if shares is None:
            break
        controls = size * np.where(fixed, 1.0, np.maximum(shares, LEAST))
        found = [beyond(each, controls) for each in terms]
        asked += [cuts for _, cuts in found]
        if max(excess for excess, _ in found) <= KEPT:
            break
    return Law(squares, controls, launch)


def envelope(u: Array, caps: Array, quantities: list[Bounded], launch: Launch) -> Array:
    """Speeds a motion without a limit of tangential jerk could have [m/s], shape (n,), positive."""
    square = np.minimum.reduce([caps, *(steady_cap(each) for each in quantities)]) ** 2
    square[[0, -1]] = np.minimum(square[[0, -1]], launch.speed**2)
    tip = quantities[0]
    gain = 2.0 * tip.limits[1] / np.maximum(np.linalg.norm(tip.rates[0], axis=1), 1e-3)
    for rows, before in ((range(1, len(u)), -1), (range(len(u) - 2, -1, -1), 1)):
        for row in rows:
            square[row] = min(square[row], square[row + before] + gain[row] * abs(u[row] - u[row + before]))
    return np.sqrt(square)


def _bounds(most: Array, size: Array, fixed: NDArray[np.bool_]) -> Rows:
    """0 <= b <= most, in unknowns b / size; fixed ones at most 1."""
    n = np.arange(len(size))
    factors = np.zeros((2 * len(n), 3))
    factors[: len(n), 1], factors[len(n) :, 1] = np.where(fixed, 1.0, size / most), -1.0
    return Rows(np.concatenate([n, n]), factors, np.concatenate([np.ones(len(n)), np.zeros(len(n))]))
