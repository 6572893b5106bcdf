"""Joint speeds, accelerations and jerks of a corner kernel, bounded from the arm at the corner's way point (layer 6).

At the way point J0 q' = x1 and = x2 give the joints' rates g1, g2 per length along both segments. In the kernel the
joints do -g1 a^(n) + g2 b^(n), exactly, plus what comes from having moved away: the Jacobian differs from J0, the
segments' turns are composed, and links that turn accelerate. The Jacobian's change is taken along the straight way from
(0, 0) to (a, b): its first derivative there is exact (`drifts`), the second and all the rest are bounded by norms, with
the joints' own motion on the right side: a guess that implies something strictly smaller holds (`joint_enclosure`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_extent import KernelControls, most_of_sum
from polish_sim.motion.certified.joint_enclosure import fill_drift
from polish_sim.motion.joint_rates import ArmState, new_arm_state, solve_second

Array = NDArray[np.float64]


MOST_GUESSES = 12
HOPELESS = 1.25
"""A guess that implies so many times itself will not settle."""


class JointCorner(NamedTuple):
    """Work space for one corner: the arm at its way point and the bounds, by order 0-3 of time derivative."""

    arm: ArmState
    T: Array
    """T_base_tool, shape (4, 4)."""
    gains: Array
    """Norms of the inverse Jacobian's rows, linear and angular, and of the links [m], shape (3, 6)."""
    sides: Array
    """Joint rates per length of the old and the new segment, shape (2, 6)."""
    turns: Array
    """Norm of each link's turning per length of the old and the new segment [rad/m], shape (2, 6)."""
    drifts: Array
    """Sizes of inverse(J0) J' when the joints move along the old or the new segment, per length, shape (2, 6, 6)."""
    drift: Array
    """How much inverse(J0) J may differ from 1 in the kernel, to first order, shape (6, 6)."""
    straight: Array
    """Bounds of -g1 a + g2 b and its derivatives, shape (4, 6)."""
    extra: Array
    """Guessed bounds: of the second derivative of q on the straight way to (a, b), of what is added to speed,
    acceleration and jerk, and of the third derivative on the straight way, shape (5, 6)."""
    implied: Array
    """What the guess implies, shape (5, 6)."""
    composed: Array
    """Bounds of the angular motion that composing both turns adds [rad..], last that of the straight way's third
    derivative, shape (5,)."""
    bends: Array
    """Second derivatives of q at the way point, their sizes: by a, by b, mixed [rad/m^2], shape (3, 6)."""
    bent: Array
    """Size of the second derivative of q at the beginning of the straight way, shape (6,)."""


def new_joint_corner() -> JointCorner:
    """Fresh work space."""
    return JointCorner(
        new_arm_state(),
        np.zeros((4, 4)),
        np.zeros((3, 6)),
        np.zeros((2, 6)),
        np.zeros((2, 6)),
        np.zeros((2, 6, 6)),
        np.zeros((6, 6)),
        np.zeros((4, 6)),
        np.zeros((5, 6)),
        np.zeros((5, 6)),
        np.zeros(5),
        np.zeros((3, 6)),
        np.zeros(6),
    )


@njit(cache=True, error_model="numpy")
def fill_sides(corner: JointCorner, twists: Array) -> None:
    """Write gains, joint rates, link turns and drifts of both sides.

    Args:
        corner: With the arm placed at the way point.
        twists: (linear; angular) motion of the tool per length, of the old and the new segment, shape (2 or more, 6).
    """
    inverse, links, axes = corner.arm.inverse, corner.arm.links, corner.arm.axes
    for i in range(6):
        corner.gains[0, i] = math.sqrt(inverse[i, 0] ** 2 + inverse[i, 1] ** 2 + inverse[i, 2] ** 2)
        corner.gains[1, i] = math.sqrt(inverse[i, 3] ** 2 + inverse[i, 4] ** 2 + inverse[i, 5] ** 2)
        corner.gains[2, i] = math.sqrt(links[i, 0] ** 2 + links[i, 1] ** 2 + links[i, 2] ** 2)
    for side in range(2):
        x, y, z = 0.0, 0.0, 0.0
        for i in range(6):
            rate = 0.0
            for j in range(6):
                rate += inverse[i, j] * twists[side, j]
            corner.sides[side, i] = rate
            x, y, z = x + rate * axes[i, 0], y + rate * axes[i, 1], z + rate * axes[i, 2]
            corner.turns[side, i] = math.sqrt(x * x + y * y + z * z)
        fill_drift(corner.arm, corner.sides[side], corner.drifts[side])
    _fill_bends(corner)


@njit(cache=True, error_model="numpy")
def _fill_bends(corner: JointCorner) -> None:
    """Write ``bends``: with the tool's own acceleration zero, q'' at rates g1, g2 and g2 - g1."""
    arm, bends = corner.arm, corner.bends
    for row in range(3):
        for i in range(6):
            arm.twists[1, i] = 0.0
            g1, g2 = corner.sides[0, i], corner.sides[1, i]
            arm.rates[0, i] = g1 if row == 0 else (g2 if row == 1 else g2 - g1)
        solve_second(arm)
        for i in range(6):
            bends[row, i] = arm.rates[1, i]
    for i in range(6):
        mixed = bends[2, i] - bends[0, i] - bends[1, i]
        bends[0, i], bends[1, i], bends[2, i] = abs(bends[0, i]), abs(bends[1, i]), abs(mixed)


@njit(cache=True, error_model="numpy")
def fill_straight(corner: JointCorner, controls: KernelControls) -> None:
    """Write the bounds of what the joints do without having moved away from the way point."""
    for i in range(6):
        for order in range(4):
            corner.straight[order, i] = most_of_sum(controls, order, corner.sides[0, i], corner.sides[1, i])


@njit(cache=True, error_model="numpy")
def fill_composed(corner: JointCorner, most: Array, turn: Array, roll: Array, sine: float) -> None:
    """Write what composing two turns and a roll adds to the angular motion -x1 a + x2 b and its derivatives.

    Args:
        corner: ``composed`` is written.
        most: Largest a, b, a + b and their derivatives, shape (3, 4).
        turn: Turn of the tool axis per length of old and new segment [rad/m], shape (2,).
        roll: Roll about it per length, shape (2,).
        sine: Of the angle between both turn axes.
    """
    a, a1, a2, a3 = turn[0] * most[0, 0], turn[0] * most[0, 1], turn[0] * most[0, 2], turn[0] * most[0, 3]
    b, b1, b2 = turn[1] * most[1, 0], turn[1] * most[1, 1], turn[1] * most[1, 2]
    p, q = abs(roll[0]), abs(roll[1])
    r, r1 = p * most[0, 0] + q * most[1, 0], p * most[0, 1] + q * most[1, 1]
    r2, r3 = p * most[0, 2] + q * most[1, 2], p * most[0, 3] + q * most[1, 3]
    away, swing = a + b, a1 + b1
    corner.composed[0] = a * b * sine + r * away
    corner.composed[4] = 2.0 * away * corner.composed[0]
    corner.composed[1] = a1 * b * sine + r1 * away
    corner.composed[2] = (a2 * b + a1 * b1) * sine + r2 * away + r1 * swing
    corner.composed[3] = (a3 * b + 2.0 * a2 * b1 + a1 * (b2 + b1 * b1)) * sine
    corner.composed[3] += r3 * away + 2.0 * r2 * swing + r1 * (a2 + b2 + 2.0 * swing * swing)


@njit(cache=True, error_model="numpy", forceinline=True)
def _of_both(most: Array, order: int, old: float, new: float) -> float:
    """Bound of old |a| + new |b|, or of their derivatives."""
    return min(old * most[0, order] + new * most[1, order], max(old, new) * most[2, order])


@njit(cache=True, error_model="numpy")
def fill_mixed_drift(corner: JointCorner, most: Array) -> None:
    """Write ``drift``, how much inverse(J0) J may differ from 1 in the kernel to first order, and ``bent``."""
    for i in range(6):
        for j in range(6):
            corner.drift[i, j] = _of_both(most, 0, corner.drifts[0, i, j], corner.drifts[1, i, j])
        a, b = most[0, 0], most[1, 0]
        corner.bent[i] = corner.bends[0, i] * a * a + corner.bends[1, i] * b * b + corner.bends[2, i] * a * b


@njit(cache=True, error_model="numpy")
def _imply(corner: JointCorner, most: Array) -> None:
    """Fill ``implied`` from the guess in ``extra``; orders: 0 the straight way, 1 to 3 speed, acceleration, jerk."""
    straight, extra, turns = corner.straight, corner.extra, corner.turns
    # Of the last link: turning along the straight way and its derivative, angular velocity and its derivative.
    t, t1, w, w1 = 0.0, 0.0, 0.0, 0.0
    # Sums over the axes so far: of the extra motion (s), of all motion times the axes' turning (m) and bending (z).
    s0, s1, s2, s3, s4, m1, m2, m3, m4 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    z1, z2, z3, z4, away, left_2, left_3, left_4 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    linear_4, linear_1, linear_2, linear_3 = 0.0, 0.0, 0.0, 0.0
    for k in range(6):
        e0, e4, q0, q1 = extra[0, k], extra[4, k], straight[0, k] + extra[0, k], straight[1, k] + extra[1, k]
        q2, q3 = straight[2, k] + extra[2, k], straight[3, k] + extra[3, k]
        bend = 0.5 * (t1 + t * t)
        away, m1, m2, m3, m4 = away + q0 * t, m1 + q1 * t, m2 + q2 * t, m3 + q3 * t, m4 + e4 * t
        z1, z2, z3, z4 = z1 + q1 * bend, z2 + q2 * bend, z3 + q3 * bend, z4 + e4 * bend
        left_4 += 2.0 * e0 * t + q0 * (t1 + t * t)
        left_2, left_3 = left_2 + q1 * w, left_3 + 2.0 * q2 * w + q1 * (w1 + w * w)
        s0, s1, s2, s3, s4 = s0 + e0, s1 + extra[1, k], s2 + extra[2, k], s3 + extra[3, k], s4 + e4
        old, new, length = turns[0, k], turns[1, k], corner.gains[2, k]
        t, t1 = _of_both(most, 0, old, new) + s0 + away, s0 + away
        sum_1 = _of_both(most, 1, old, new) + s1 + m1
        sum_2 = _of_both(most, 2, old, new) + s2 + m2
        sum_3 = _of_both(most, 3, old, new) + s3 + m3
        w, w1, bend = sum_1, sum_2 + left_2, 0.5 * (t1 + t * t)
        linear_4 += length * (left_4 + t * (3.0 * t1 + t * t) + z4 + m4 * t + (s4 + m4) * bend)
        linear_1 += length * (z1 + m1 * t + sum_1 * bend)
        linear_2 += length * (z2 + m2 * t + sum_2 * bend + left_2 + w * w)
        linear_3 += length * (z3 + m3 * t + sum_3 * bend + left_3 + w * (3.0 * w1 + w * w))
    angular_4, angular_1 = left_4 + z4 + corner.composed[4], z1 + corner.composed[1]
    angular_2, angular_3 = z2 + left_2 + corner.composed[2], z3 + left_3 + corner.composed[3]
    for i in range(6):
        linear, angular = corner.gains[0, i], corner.gains[1, i]
        d4, d1, d2, d3 = 0.0, 0.0, 0.0, 0.0
        for j in range(6):
            d, e1, e2, e3 = corner.drift[i, j], extra[1, j], extra[2, j], extra[3, j]
            d4, d1 = d4 + d * extra[4, j], d1 + d * (straight[1, j] + e1)
            d2, d3 = d2 + d * (straight[2, j] + e2), d3 + d * (straight[3, j] + e3)
        corner.implied[0, i] = corner.bent[i] + angular * corner.composed[0] + extra[4, i]
        corner.implied[4, i] = linear * linear_4 + angular * angular_4 + d4
        corner.implied[1, i] = linear * linear_1 + angular * angular_1 + d1
        corner.implied[2, i] = linear * linear_2 + angular * angular_2 + d2
        corner.implied[3, i] = linear * linear_3 + angular * angular_3 + d3


@njit(cache=True, error_model="numpy")
def confirm(corner: JointCorner, most: Array) -> bool:
    """Find bounds of what is added; False if the kernel is too large for the arm so near to a singularity.

    Args:
        corner: With sides, straight and composed filled; ``extra`` is written.
        most: Largest a, b, a + b and their derivatives, shape (3, 4).

    Returns:
        Whether a guess could be confirmed.
    """
    fill_mixed_drift(corner, most)
    for order in range(5):
        for i in range(6):
            corner.extra[order, i] = 0.0
    for guess in range(MOST_GUESSES):
        _imply(corner, most)
        confirmed, settling = True, True
        for order in range(5):
            for i in range(6):
                ratio = corner.implied[order, i] / corner.extra[order, i]
                confirmed, settling = confirmed and ratio < 1.0, settling and ratio < HOPELESS
        if confirmed:
            return True
        if guess > 7 and not settling:
            return False
        for order in range(5):
            for i in range(6):
                corner.extra[order, i] = 1.05 * corner.implied[order, i] + 1e-12
    return False
