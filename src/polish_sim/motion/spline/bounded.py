"""What is limited along a curve: tip, tool axis and joints, differentiated to its parameter.

With u the parameter, b = u'^2 and X1, X2, X3 a quantity's derivatives to u, in time

    speed  X1 u'      acceleration  X2 b + X1 b_u / 2      jerk  u' (X3 b + 3/2 X2 b_u + X1 b_uu / 2)

where b_u and b_uu are derivatives to u: but for u', linear in b.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.rules.schedule import turning
from polish_sim.motion.segment_rates import joint_motion
from polish_sim.motion.spline.curve import CurveRates

PLANNED_SHARE = 0.97  #: Of acceleration and jerk limits planned with: the curve continues between the places looked at
SLOWEST_TURN = 1e-9  #: A rate below this counts as this: what does not move bounds nothing


class Bounded(NamedTuple):
    """One quantity at n places of a curve."""

    rates: Array  #: X1, X2, X3, shape (3, n, d)
    limits: Array  #: Largest Euclidean norm of its speed, acceleration and jerk that is planned with, shape (3,)


def bounded_quantities(rates: CurveRates, limits: SmoothingLimits, arm: Arm | None) -> list[Bounded]:
    """Tip, tool axis and, with an arm, its six joints.

    Raises:
        ReachError: The arm cannot reach a place, or is singular there.
    """
    turned = turning(rates.axes.swapaxes(0, 1)).swapaxes(0, 1)
    found = [
        _bounded(rates.tips[1:], limits.tip_speed, limits.tip_acceleration, limits.tip_jerk),
        _bounded(turned, limits.axis_speed, limits.axis_acceleration, limits.axis_jerk),
    ]
    if arm is not None:
        joints = joint_motion(rates.tips[0], rates.rotations, rates.tips[1:], rates.spins, arm)
        moved = np.stack([joints.first, joints.second, joints.third])
        most = zip(limits.joint_speed, limits.joint_acceleration, limits.joint_jerk, strict=True)
        found += [_bounded(moved[:, :, j : j + 1], *each) for j, each in enumerate(most)]
    return found


def speed_cap(quantity: Bounded) -> Array:
    """Largest u' a quantity's speed limit allows [m/s], shape (n,)."""
    return _over(quantity.limits[0], quantity.rates[0])


def steady_cap(quantity: Bounded) -> Array:
    """Largest constant u' its three limits allow [m/s], shape (n,)."""
    most = [_over(limit, rate) for limit, rate in zip(quantity.limits, quantity.rates, strict=True)]
    return np.minimum(most[0], np.minimum(np.sqrt(most[1]), np.cbrt(most[2])))


def jerk_from_rest(quantities: list[Bounded]) -> float:
    """Largest third derivative of u from rest at either end [m/s^3]."""
    return min(float(_over(each.limits[2], each.rates[0, [0, -1]]).min()) for each in quantities)


def at_ends(quantity: Bounded) -> Bounded:
    """The quantity at its first and last place."""
    return Bounded(quantity.rates[:, [0, -1]], quantity.limits)


def time_factors(quantity: Bounded, speed: Array, acceleration: Array, jerk: Array) -> Array:
    """How much more time a passage must take for a quantity to keep its limits, wholly used, place by place.

    Args:
        quantity: At n places.
        speed: u' there [m/s], shape (n,).
        acceleration: Second derivative [m/s^2], shape (n,).
        jerk: Third derivative [m/s^3], shape (n,).

    Returns:
        The factors, shape (n,); up to 1 it keeps them.
    """
    x1, x2, x3 = quantity.rates
    v, a, j = speed[:, None], acceleration[:, None], jerk[:, None]
    moved = (x1 * v, x2 * v**2 + x1 * a, x3 * v**3 + 3.0 * x2 * v * a + x1 * j)
    over = [np.linalg.norm(each, axis=1) / limit for each, limit in zip(moved, quantity.limits, strict=True)]
    return np.asarray(np.maximum.reduce([over[0], np.sqrt(PLANNED_SHARE * over[1]), np.cbrt(PLANNED_SHARE * over[2])]))


def _bounded(rates: Array, speed: float, acceleration: float, jerk: float) -> Bounded:
    return Bounded(rates, np.array([speed, PLANNED_SHARE * acceleration, PLANNED_SHARE * jerk]))


def _over(limit: float, rates: Array) -> Array:
    return np.asarray(limit / np.maximum(np.linalg.norm(rates, axis=-1), SLOWEST_TURN))
