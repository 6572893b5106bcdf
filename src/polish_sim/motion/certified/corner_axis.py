"""How fast the tool axis turns in a corner kernel: bounds in closed form (layer 6).

With the axis at exp(n2 beta) exp(-n1 alpha) o, its angular velocity is n2 beta' - m alpha' with m = exp(n2 beta) n1, so
its norm is that of -n1 alpha + n2 beta exactly. Taking out the spin and differentiating adds terms that carry
alpha sin(n1, n2) or a product of rates; they are bounded by the largest values of each factor.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_extent import KernelControls, most_of_vectors


class AxisCorner(NamedTuple):
    """What a corner does to the axis, per generalised length [rad/m]."""

    old: float
    """Angle the old segment turns by, per length."""
    new: float
    product: float
    """Of both turns as vectors: old new (n1.n2)."""
    sine: float
    """Of the angle between the two turn axes."""


class AxisExtent(NamedTuple):
    """Bounds of the axis' angular velocity without spin and its first two derivatives [rad/s..]."""

    speed: float
    acceleration: float
    jerk: float


@njit(cache=True, error_model="numpy")
def axis_extent(corner: AxisCorner, controls: KernelControls) -> AxisExtent:
    """Bound speed, acceleration and jerk of the tool axis over a corner kernel.

    Args:
        corner: How the axis turns on both sides.
        controls: The kernel's control points.

    Returns:
        Norms of w = o x o', w' and w'' [rad/s, rad/s^2, rad/s^3].
    """
    old, new, most = corner.old, corner.new, controls.most
    # Terms with an n1 x n2 in them vanish where one side does not turn.
    sine = corner.sine
    a, a1, a2 = old * most[0, 0], old * most[0, 1], old * most[0, 2]
    b1, b2 = new * most[1, 1], new * most[1, 2]
    speed = most_of_vectors(controls, 1, old, new, corner.product)
    acceleration = most_of_vectors(controls, 2, old, new, corner.product)
    acceleration += a * sine * b1 * (a1 + speed)
    along = most_of_vectors(controls, 3, old, new, corner.product)
    along += 2.0 * a2 * b1 * a * sine + a1 * sine * (b2 * a + b1 * b1)
    along += 2.0 * (b2 * a + a1 * b1) * sine * speed + b1 * a * sine * acceleration
    # The part along the axis itself: -o'.w', nothing where the turn keeps its axis.
    across = speed * acceleration if sine > 0.0 else 0.0
    return AxisExtent(speed, acceleration, math.sqrt(along * along + across * across))
