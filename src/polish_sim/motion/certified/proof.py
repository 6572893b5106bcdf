"""How much slower a kernel or a bend must be to keep the limits of tool axis and joints, proven on its pieces.

Axis: with the axis at exp(n2 beta) exp(-n1 alpha) o, its angular velocity is n2 beta' - m alpha' with
m = exp(n2 beta) n1, so its norm is that of -n1 alpha + n2 beta exactly. Taking out the spin and differentiating adds
terms with alpha sin(n1, n2) or a product of rates; they are bounded by the largest values of each factor.

Joints: on a piece of constant jerk the tool's motion is known in closed form with all derivatives. In the middle of
the piece the joints' derivatives are exact; how much they differ elsewhere on it follows as along a segment
(`enclosure`, with time in place of progress). The proof costs the piece's half duration times a bound of the fourth
derivative: a few percent of the jerk, less of the acceleration.

Slowed by tau every speed falls by tau, every acceleration by tau^2, every jerk by tau^3, and so do their bounds.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Matrix3, Record, Vector4
from polish_sim.motion.certified.connector import Peaks
from polish_sim.motion.certified.enclosure import Enclosure, enclose
from polish_sim.motion.certified.kernel import PIECES, Kernel, Side, measure_peaks
from polish_sim.motion.joint_rates import solve_rates
from polish_sim.motion.rules.limits import Arm, LimitValues, is_there
from polish_sim.motion.rules.schedule import roll_on, turn_on
from polish_sim.motion.segment_rates import REACHED, Segment, reach_pose

_FINEST = 1.0 / 16.0  #: Share of a piece below which it is not cut further: the arm is singular there
_ROUNDING = 1.0 + 1e-9


class Sides(NamedTuple):
    """The two segments that meet at a corner, in the base frame."""

    old: Segment
    new: Segment
    spans: tuple[float, float]  #: Generalised lengths of both [m]


class ProofWork(Record):
    """Work space: the tool's motion in a kernel, and the joints'."""

    enclosure: Enclosure
    rates: Vector4  #: Progress of one segment and three derivatives
    axis: Annotated[Array, (4, 3)]  #: Tool axis and three derivatives
    R: Matrix3  #: R_base_tool
    spin: Matrix3  #: Angular velocity and two derivatives [rad/s..]


class Slowdown(NamedTuple):
    """What a kernel's times must be multiplied by."""

    factor: float  #: At least 1; infinite if nothing could be proven
    joints: Peaks  #: Shares of the joints' limits without it; zeros without an arm


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def prove_kernel(
    axis: Side, sides: Sides, kernel: Kernel, limits: LimitValues, arm: Arm, q: Array, work: ProofWork
) -> Slowdown:
    """Factor on a kernel's times with which it keeps the limits of tool axis and joints at every instant, proven.

    ``axis`` is the corner as the tool axis sees it, ``sides`` the corner in the base frame, ``q`` (6,) the joint
    angles at the corner, or near on the same branch [rad]. The tip's limits are not looked at; `arm_or_none`: the
    axis alone.
    """
    peaks, joints = axis_peaks(axis, kernel), Peaks(0.0, 0.0, 0.0)
    speed, acceleration = peaks.speed / limits.axis_speed, peaks.acceleration / limits.axis_acceleration
    jerk = peaks.jerk / limits.axis_jerk
    if is_there(arm):
        joints = joint_shares(sides, kernel, limits.joint, arm, q, work)
        speed, acceleration = max(speed, joints.speed), max(acceleration, joints.acceleration)
        jerk = max(jerk, joints.jerk)
    return Slowdown(max(1.0, speed, math.sqrt(acceleration), np.cbrt(jerk)), joints)


@njit(cache=True, error_model="numpy", _nrt=False)
def axis_peaks(axis: Side, kernel: Kernel) -> Peaks:
    """Bounds of the norms of w = o x o', w' and w'' of the tool axis o [rad/s, rad/s^2, rad/s^3]."""
    if axis.first == 0.0 and axis.second == 0.0:
        return Peaks(0.0, 0.0, 0.0)
    # Terms with an n1 x n2 in them vanish where one side does not turn.
    sine = axis.sine if axis.first > 0.0 and axis.second > 0.0 else 0.0
    a, a1, a2, b1, b2 = 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(PIECES):
        if kernel.durations[p] > 0.0:
            old, new = _most(kernel.remaining[p], kernel.durations[p]), _most(kernel.gone[p], kernel.durations[p])
            a, a1, a2, b1, b2 = max(a, old[0]), max(a1, old[1]), max(a2, old[2]), max(b1, new[1]), max(b2, new[2])
    a, a1, a2 = axis.first * a, axis.first * a1, axis.first * a2
    b1, b2 = axis.second * b1, axis.second * b2
    peaks = measure_peaks(axis, kernel, PIECES)
    acceleration = peaks.acceleration + a * sine * b1 * (a1 + peaks.speed)
    along = peaks.jerk + 2.0 * a2 * b1 * a * sine + a1 * sine * (b2 * a + b1 * b1)
    along += 2.0 * (b2 * a + a1 * b1) * sine * peaks.speed + b1 * a * sine * acceleration
    # The part along the axis itself: -o'.w', nothing where the turn keeps its axis.
    across = peaks.speed * acceleration if sine > 0.0 else 0.0
    return Peaks(peaks.speed * _ROUNDING, acceleration * _ROUNDING, math.hypot(along, across) * _ROUNDING)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _most(cubic: Array, t: float) -> tuple[float, float, float, float]:
    """Largest absolute values of a cubic and its derivatives on [0, t], the first two by control points."""
    c0, c1, c2, c3 = cubic[0], cubic[1], cubic[2], cubic[3]
    place = max(abs(c0), abs(c0 + c1 * t / 3.0), abs(c0 + (2.0 * c1 + c2 * t) * t / 3.0))
    place = max(place, abs(c0 + (c1 + (c2 + c3 * t) * t) * t))
    rate = max(abs(c1), abs(c1 + c2 * t), abs(c1 + (2.0 * c2 + 3.0 * c3 * t) * t))
    return place, rate, max(abs(2.0 * c2), abs(2.0 * c2 + 6.0 * c3 * t)), abs(6.0 * c3)


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def joint_shares(sides: Sides, kernel: Kernel, joint: Array, arm: Arm, q: Array, work: ProofWork) -> Peaks:
    """Largest shares of the joints' limits (3, 6) on the whole kernel; infinite where nothing could be proven.

    ``q`` are the joint angles at the corner, on the branch the arm comes on [rad]; see `prove_kernel`.
    """
    e = work.enclosure
    speed = acceleration = jerk = 0.0
    for j in range(6):
        e.arm.q[j] = q[j]
    for p in range(PIECES):
        duration = kernel.durations[p]
        if duration <= 0.0:
            continue
        fourth, done, width = fourth_spin(sides, kernel, p), 0.0, 1.0
        while done < 1.0:
            r = 0.5 * width * duration
            move_tool(sides, kernel, p, done * duration + r, work)
            confirmed = reach_pose(e.arm, arm) == REACHED
            if confirmed:
                solve_rates(e.arm)
                confirmed = enclose(e, r, fourth) > 0
            if not confirmed:
                width *= 0.5
                if width < _FINEST:
                    return Peaks(math.inf, math.inf, math.inf)
                continue
            for j in range(6):
                speed = max(speed, e.rates[0, j] / joint[0, j])
                acceleration = max(acceleration, e.rates[1, j] / joint[1, j])
                jerk = max(jerk, e.rates[2, j] / joint[2, j])
            done += width
    return Peaks(speed, acceleration, jerk)


@njit(cache=True, error_model="numpy", _nrt=False)
def move_tool(sides: Sides, kernel: Kernel, p: int, t: float, work: ProofWork) -> None:
    """Write the tool's pose and three derivatives at [s] ``t`` of piece ``p`` into the enclosure's arm."""
    e, R, spin, rates = work.enclosure, work.R, work.spin, work.rates
    T, twists, new = e.arm.T, e.arm.twists, sides.new
    for i in range(3):
        T[i, 3], T[3, i] = new.tip[i], 0.0
        for j in range(3):
            R[i, j], spin[i, j], twists[i, j] = new.rotation[i, j], 0.0, 0.0
    roll, roll_1, roll_2, roll_3 = 0.0, 0.0, 0.0, 0.0
    for side in range(2):
        segment, cubic = (sides.new, kernel.gone[p]) if side else (sides.old, kernel.remaining[p])
        factor = 1.0 / sides.spans[1] if side else -1.0 / sides.spans[0]
        c0, c1, c2, c3 = factor * cubic[0], factor * cubic[1], factor * cubic[2], factor * cubic[3]
        rates[0], rates[1] = c0 + t * (c1 + t * (c2 + t * c3)), c1 + t * (2.0 * c2 + 3.0 * t * c3)
        rates[2], rates[3] = 2.0 * c2 + 6.0 * t * c3, 6.0 * c3
        for i in range(3):
            way = segment.length * segment.direction[i]
            T[i, 3] += rates[0] * way
            for order in range(3):
                twists[order, i] += rates[order + 1] * way
        roll, roll_1 = roll + segment.roll * rates[0], roll_1 + segment.roll * rates[1]
        roll_2, roll_3 = roll_2 + segment.roll * rates[2], roll_3 + segment.roll * rates[3]
        if segment.angle != 0.0:
            turn_on(segment.turn_axis, segment.angle, rates, R, spin)
    roll_on((roll, roll_1, roll_2, roll_3), R, spin, work.axis)
    T[3, 3] = 1.0
    for i in range(3):
        for j in range(3):
            T[i, j], twists[i, j + 3] = R[i, j], spin[i, j]


@njit(cache=True, error_model="numpy", _nrt=False)
def fourth_spin(sides: Sides, kernel: Kernel, p: int) -> float:
    """Bound of the third derivative of the tool's angular velocity on a piece [rad/s^4].

    The velocity is n2 b' - m a' + o r', with m the old turn's axis carried on by the new turn and o the tool axis.
    """
    old, new, n1, n2 = sides.old, sides.new, sides.old.turn_axis, sides.new.turn_axis
    x, y, z = n1[1] * n2[2] - n1[2] * n2[1], n1[2] * n2[0] - n1[0] * n2[2], n1[0] * n2[1] - n1[1] * n2[0]
    sine = math.sqrt(x * x + y * y + z * z)
    _, p1, p2, p3 = _most(kernel.remaining[p], kernel.durations[p])
    _, g1, g2, g3 = _most(kernel.gone[p], kernel.durations[p])
    first, second = old.angle / sides.spans[0], new.angle / sides.spans[1]
    a1, a2, a3, b1, b2, b3 = first * p1, first * p2, first * p3, second * g1, second * g2, second * g3
    # Derivatives of m, each at most sine times this.
    m2, m3 = b2 + b1 * b1, b3 + b1 * (3.0 * b2 + b1 * b1)
    turned = sine * (3.0 * a3 * b1 + 3.0 * a2 * m2 + a1 * m3)
    first, second = abs(old.roll) / sides.spans[0], abs(new.roll) / sides.spans[1]
    r1, r2, r3 = first * p1 + second * g1, first * p2 + second * g2, first * p3 + second * g3
    w, w1 = a1 + b1, a2 + b2 + a1 * b1 * sine
    w2 = a3 + b3 + sine * (2.0 * a2 * b1 + a1 * m2)
    return turned + 3.0 * r3 * w + 3.0 * r2 * (w1 + w * w) + r1 * (w2 + w * (3.0 * w1 + w * w))
