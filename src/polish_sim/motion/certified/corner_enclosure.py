"""Joint speeds, accelerations and jerks of one corner kernel, enclosed piece by piece in time (layer 6).

On a piece of constant jerk the tool's motion is known in closed form with all derivatives. In the middle of the piece
the joints' derivatives are exact; how much they differ elsewhere on it follows as along a segment (`joint_enclosure`,
with time in place of progress). What is given away is the piece's half duration times a bound of the fourth
derivative: a few percent of the jerk, less of the acceleration.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_parts import Kernel, Sides
from polish_sim.motion.certified.joint_enclosure import Enclosure, enclose, new_enclosure
from polish_sim.motion.joint_rates import solve_rates
from polish_sim.motion.rules.limits import Arm, LimitValues
from polish_sim.motion.rules.schedule import roll_on, turn_on
from polish_sim.motion.segment_rates import REACHED, reach_pose

Array = NDArray[np.float64]

_FINEST = 1.0 / 16.0
"""Share of a piece below which it is not cut further: the arm is singular there."""


class JointShares(NamedTuple):
    """Largest shares of the joints' limits; infinite where nothing could be proven."""

    speed: float
    acceleration: float
    jerk: float


class MovingTool(NamedTuple):
    """Work space: the tool's motion in a kernel, and the joints'."""

    enclosure: Enclosure
    rates: Array
    """Progress of one segment and three derivatives, shape (4,)."""
    axis: Array
    """Tool axis and three derivatives, shape (4, 3)."""
    R: Array
    """R_base_tool, shape (3, 3)."""
    spin: Array
    """Angular velocity and two derivatives [rad/s..], shape (3, 3)."""


def new_moving_tool() -> MovingTool:
    """Fresh work space."""
    return MovingTool(new_enclosure(), np.zeros(4), np.zeros((4, 3)), np.zeros((3, 3)), np.zeros((3, 3)))


@njit(cache=True, error_model="numpy")
def _fill_rates(cubic: Array, t: float, factor: float, rates: Array) -> None:
    c0, c1, c2, c3 = factor * cubic[0], factor * cubic[1], factor * cubic[2], factor * cubic[3]
    rates[0] = c0 + t * (c1 + t * (c2 + t * c3))
    rates[1] = c1 + t * (2.0 * c2 + 3.0 * t * c3)
    rates[2] = 2.0 * c2 + 6.0 * t * c3
    rates[3] = 6.0 * c3


@njit(cache=True, error_model="numpy")
def move_tool(sides: Sides, kernel: Kernel, p: int, t: float, tool: MovingTool) -> None:
    """Write the tool's pose and its first three derivatives in time into the enclosure.

    Args:
        sides: The corner.
        kernel: How it is passed.
        p: Piece of it.
        t: Time from the piece's start [s].
        tool: Its enclosure's ``T`` and its arm's ``twists`` are written.
    """
    e, R, spin, rates = tool.enclosure, tool.R, tool.spin, tool.rates
    T, twists, new = e.T, e.arm.twists, sides.new
    for i in range(3):
        T[i, 3], T[3, i] = new.tip[i], 0.0
        for j in range(3):
            R[i, j], spin[i, j], twists[i, j] = new.rotation[i, j], 0.0, 0.0
    roll, roll_1, roll_2, roll_3 = 0.0, 0.0, 0.0, 0.0
    for side in range(2):
        segment = sides.new if side else sides.old
        if side:
            _fill_rates(kernel.gone[p], t, 1.0 / sides.spans[1], rates)
        else:
            _fill_rates(kernel.remaining[p], t, -1.0 / sides.spans[0], rates)
        for i in range(3):
            way = segment.length * segment.direction[i]
            T[i, 3] += rates[0] * way
            for order in range(3):
                twists[order, i] += rates[order + 1] * way
        roll, roll_1 = roll + segment.roll * rates[0], roll_1 + segment.roll * rates[1]
        roll_2, roll_3 = roll_2 + segment.roll * rates[2], roll_3 + segment.roll * rates[3]
        if segment.angle != 0.0:
            turn_on(segment.turn_axis, segment.angle, rates, R, spin)
    roll_on((roll, roll_1, roll_2, roll_3), R, spin, tool.axis)
    T[3, 3] = 1.0
    for i in range(3):
        for j in range(3):
            T[i, j], twists[i, j + 3] = R[i, j], spin[i, j]


@njit(cache=True, error_model="numpy")
def _most(cubic: Array, t: float) -> tuple[float, float, float]:
    """Largest absolute values of a cubic's three derivatives on [0, t], the first by control points."""
    c1, c2, c3 = cubic[1], cubic[2], cubic[3]
    middle, end = c1 + c2 * t, c1 + (2.0 * c2 + 3.0 * c3 * t) * t
    first = max(abs(c1), abs(middle), abs(end))
    return first, max(abs(2.0 * c2), abs(2.0 * c2 + 6.0 * c3 * t)), abs(6.0 * c3)


@njit(cache=True, error_model="numpy")
def fourth_spin(sides: Sides, kernel: Kernel, p: int) -> float:
    """Bound of the third derivative of the tool's angular velocity on a piece [rad/s^4].

    The velocity is n2 b' - m a' + o r', with m the old turn's axis carried on by the new turn and o the tool axis.
    """
    old, new, n1, n2 = sides.old, sides.new, sides.old.turn_axis, sides.new.turn_axis
    x, y, z = n1[1] * n2[2] - n1[2] * n2[1], n1[2] * n2[0] - n1[0] * n2[2], n1[0] * n2[1] - n1[1] * n2[0]
    sine = math.sqrt(x * x + y * y + z * z)
    remaining, gone = _most(kernel.remaining[p], kernel.durations[p]), _most(kernel.gone[p], kernel.durations[p])
    first, second = old.angle / sides.spans[0], new.angle / sides.spans[1]
    a1, a2, a3 = first * remaining[0], first * remaining[1], first * remaining[2]
    b1, b2, b3 = second * gone[0], second * gone[1], second * gone[2]
    # Derivatives of m, each at most sine times this.
    m2, m3 = b2 + b1 * b1, b3 + b1 * (3.0 * b2 + b1 * b1)
    turned = sine * (3.0 * a3 * b1 + 3.0 * a2 * m2 + a1 * m3)
    first, second = abs(old.roll) / sides.spans[0], abs(new.roll) / sides.spans[1]
    r1, r2 = first * remaining[0] + second * gone[0], first * remaining[1] + second * gone[1]
    r3 = first * remaining[2] + second * gone[2]
    w, w1 = a1 + b1, a2 + b2 + a1 * b1 * sine
    w2 = a3 + b3 + sine * (2.0 * a2 * b1 + a1 * m2)
    return turned + 3.0 * r3 * w + 3.0 * r2 * (w1 + w * w) + r1 * (w2 + w * (3.0 * w1 + w * w))


@njit(cache=True, error_model="numpy")
def joint_shares(
    sides: Sides, kernel: Kernel, limits: LimitValues, arm: Arm, q: Array, tool: MovingTool
) -> JointShares:
    """Bound what a kernel takes of the joints' limits.

    Args:
        sides: The corner.
        kernel: How it is passed.
        limits: Of the joints.
        arm: Tool and robot.
        q: Joint angles at the corner, on the branch the arm comes on [rad], shape (6,).
        tool: Work space.

    Returns:
        Shares of speed, acceleration and jerk limits, proven on the whole kernel.
    """
    e, joint = tool.enclosure, limits.joint
    speed = acceleration = jerk = 0.0
    for j in range(6):
        e.arm.q[j] = q[j]
    for p in range(kernel.durations.shape[0]):
        duration = kernel.durations[p]
        if duration <= 0.0:
            continue
        fourth, done, width = fourth_spin(sides, kernel, p), 0.0, 1.0
        while done < 1.0:
            r = 0.5 * width * duration
            move_tool(sides, kernel, p, done * duration + r, tool)
            confirmed = reach_pose(e.arm, e.T, arm, e.arm.q) == REACHED
            if confirmed:
                solve_rates(e.arm, 3)
                confirmed = enclose(e, r, fourth) > 0
            if not confirmed:
                width *= 0.5
                if width < _FINEST:
                    return JointShares(math.inf, math.inf, math.inf)
                continue
            for j in range(6):
                speed = max(speed, e.rates[0, j] / joint[0, j])
                acceleration = max(acceleration, e.rates[1, j] / joint[1, j])
                jerk = max(jerk, e.rates[2, j] / joint[2, j])
            done += width
    return JointShares(speed, acceleration, jerk)
