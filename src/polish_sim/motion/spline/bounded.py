"""What is limited along a curve: tip, tool axis and joints, differentiated to its parameter.

With u the parameter, b = u'^2 and X1, X2, X3 a quantity's derivatives to u, in time

    speed  X1 u'      acceleration  X2 b + X1 b_u / 2      jerk  u' (X3 b + 3/2 X2 b_u + X1 b_uu / 2)

where b_u and b_uu are derivatives to u: but for u', linear in b.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, by_slices
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.segment_rates import joint_motion
from polish_sim.motion.spline.curve import CurveRates

SLOWEST_TURN = 1e-9  #: A rate below this counts as this: what does not move bounds nothing
PARTS = 12
FIRST_PARTS = np.array([0, 3, *range(6, PARTS)])  #: Of tip, axis and six joints
SIZES = np.diff(FIRST_PARTS, append=PARTS)


class Bounded(NamedTuple):
    """Eight quantities, of 12 parts in all, at n places of a curve: tip (3), axis (3) and joints (1 each)."""

    rates: Array  #: X1, X2, X3, shape (3, n, 12)
    limits: Array  #: Largest Euclidean norms of speeds, accelerations and jerks, shape (3, 8)


def bounded_quantities(rates: CurveRates, limits: SmoothingLimits, arm: Arm | None) -> Bounded:
    """Tip, tool axis and, with an arm, its six joints.

    Raises:
        ReachError: The arm cannot reach a place, or is singular there.
    """
    known = np.zeros((3, len(rates.rotations), PARTS))
    known[:, :, :3], known[:, :, 3:6] = rates.tips[1:], rates.turns
    if arm is not None:
        known[:, :, 6:] = joint_motion(rates.tips[0], rates.rotations, rates.tips[1:], rates.spins, arm)[1:]
    return Bounded(known, limits.table)


def part_norms(parts: Array) -> Array:
    """Norms of the quantities made of parts (..., 12), shape (..., 8)."""
    return np.sqrt(np.add.reduceat(parts * parts, FIRST_PARTS, axis=-1))


def caps_of(bounded: Bounded) -> tuple[Array, Array]:
    """Largest u' the speed limits allow, and the largest constant one all limits allow [m/s], shape (n,)
    each."""
    most = bounded.limits[:, None] / np.maximum(part_norms(bounded.rates), SLOWEST_TURN)
    speed, acceleration, jerk = most.min(axis=2)
    return speed, np.minimum(speed, np.minimum(np.sqrt(acceleration), np.cbrt(jerk)))


def time_factors(bounded: Bounded, speed: Array, acceleration: Array, jerk: Array) -> Array:
    """How much more time a passage must take to keep the limits, wholly used, place by place.

    ``speed`` is u' at the n places [m/s], ``acceleration`` and ``jerk`` are its derivatives, shape (n,) each;
    the factors, shape (n,), are up to 1 where it keeps them.
    """
    factors = partial(_factors_of, bounded.limits)
    return by_slices(factors, *bounded.rates, speed, acceleration, jerk)  # type: ignore[no-any-return]


def _factors_of(limits: Array, x1: Array, x2: Array, x3: Array, *in_time: Array) -> Array:
    v, a, j = (each[:, None] for each in in_time)
    moved = np.stack([x1 * v, x2 * v * v + x1 * a, x3 * v**3 + 3.0 * x2 * v * a + x1 * j])
    over = part_norms(moved) / limits[:, None]
    return np.max([over[0], np.sqrt(over[1]), np.cbrt(over[2])], axis=(0, 2))  # type: ignore[no-any-return]
