"""Joint derivatives bounded on a whole piece of a segment, from their values at its middle.

Everything depends on a bound of the fourth derivative q4 over the piece, J0 q4 = x4 - 3 J1 q3 - 3 J2 q2 - J3 q1
(numbers are orders of derivatives). At the middle it is exact; how much it may differ elsewhere follows from bounds
of the same derivatives, q4 among them (a guess), by the inverse of J0 and J1 at the middle, the rest by norms of the
links' turning. If a guessed bound implies a strictly smaller one, it holds on the whole piece (contradiction at the
first violation). By the same inequality the Jacobian stays regular, so
the arm does not leave its branch. (Rounding is met by a slack of 1e-9, not by directed rounding.)
"""

from __future__ import annotations

import math
from typing import Annotated

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Matrix6, Record, Vector6
from polish_sim.motion.joint_rates import ArmState, Rates

MOST_GUESSES = 8
HOPELESS = 2.5  #: A guess that implies this multiple of itself will not settle
_ROUNDING = 1.0 + 1e-9


class Enclosure(Record):
    """Work space of one arm and bounds on a piece."""

    arm: ArmState  #: The arm at the middle of the piece, with its rates by progress
    speeds: Rates  #: Norm of each link's angular velocity and its two derivatives at the middle
    gains: Rates  #: Norms of the inverse Jacobian's rows, linear and angular part, and of the links [m]
    drift: Matrix6  #: Absolute values of inverse(J) J' at the middle
    fourth: Vector6  #: Size of the fourth derivative of q at the middle, but for what the twist's own gives
    rates: Annotated[Array, (4, 6)]  #: Bounds of |q'|, |q''|, |q'''|, |q''''| on the piece
    implied: Vector6  #: What a guess of |q''''| implies for it


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _norm(x: float, y: float, z: float) -> float:
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy", _nrt=False)
def _fill_drift(e: Enclosure) -> None:
    """Fill ``drift``, column by column: J' has z' x R + z x R'; z', R the joint's axis and the way to the tool."""
    arm, q1, drift = e.arm, e.arm.rates[0], e.drift
    axes, links, m, ways = arm.axes, arm.links, arm.inverse, arm.scratch
    wx, wy, wz = 0.0, 0.0, 0.0
    for k in range(6):
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        ways[k, 0], ways[k, 1], ways[k, 2] = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
        wx, wy, wz = wx + q1[k] * x, wy + q1[k] * y, wz + q1[k] * z
        x, y, z = links[k, 0], links[k, 1], links[k, 2]
        ways[k, 3], ways[k, 4], ways[k, 5] = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
    rx, ry, rz, sx, sy, sz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(5, -1, -1):
        rx, ry, rz = rx + links[k, 0], ry + links[k, 1], rz + links[k, 2]
        sx, sy, sz = sx + ways[k, 3], sy + ways[k, 4], sz + ways[k, 5]
        x, y, z, a, b, c = axes[k, 0], axes[k, 1], axes[k, 2], ways[k, 0], ways[k, 1], ways[k, 2]
        lx = b * rz - c * ry + y * sz - z * sy
        ly = c * rx - a * rz + z * sx - x * sz
        lz = a * ry - b * rx + x * sy - y * sx
        for i in range(6):
            total = m[i, 0] * lx + m[i, 1] * ly + m[i, 2] * lz + m[i, 3] * a + m[i, 4] * b + m[i, 5] * c
            drift[i, k] = abs(total)


@njit(cache=True, error_model="numpy", _nrt=False)
def measure_link_speeds(e: Enclosure) -> None:
    """Fill ``speeds`` and ``fourth``: every link's turning w and its derivatives, added up from the base.

    ``d`` is w, ``e`` and ``f`` its derivatives, ``g`` its third one without what the fourth derivative of q gives.
    """
    axes, links, q, m = e.arm.axes, e.arm.links, e.arm.rates, e.arm.inverse
    dx, dy, dz, ex, ey, ez, fx, fy, fz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    gx, gy, gz, lx, ly, lz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(6):
        x, y, z, a, b, c = axes[k, 0], axes[k, 1], axes[k, 2], q[0, k], q[1, k], q[2, k]
        # The axis' own derivatives: u = w x z, v = w' x z + w x u, t = w'' x z + 2 w' x u + w x v.
        ux, uy, uz = dy * z - dz * y, dz * x - dx * z, dx * y - dy * x
        vx = ey * z - ez * y + dy * uz - dz * uy
        vy = ez * x - ex * z + dz * ux - dx * uz
        vz = ex * y - ey * x + dx * uy - dy * ux
        tx = fy * z - fz * y + 2.0 * (ey * uz - ez * uy) + dy * vz - dz * vy
        ty = fz * x - fx * z + 2.0 * (ez * ux - ex * uz) + dz * vx - dx * vz
        tz = fx * y - fy * x + 2.0 * (ex * uy - ey * ux) + dx * vy - dy * vx
        gx, gy, gz = (
            gx + 3.0 * (c * ux + b * vx) + a * tx,
            gy + 3.0 * (c * uy + b * vy) + a * ty,
            gz + 3.0 * (c * uz + b * vz) + a * tz,
        )
        fx, fy, fz = (
            fx + c * x + 2.0 * b * ux + a * vx,
            fy + c * y + 2.0 * b * uy + a * vy,
            fz + c * z + 2.0 * b * uz + a * vz,
        )
        ex, ey, ez = ex + b * x + a * ux, ey + b * y + a * uy, ez + b * z + a * uz
        dx, dy, dz = dx + a * x, dy + a * y, dz + a * z
        # The same of the link, one order further.
        x, y, z = links[k, 0], links[k, 1], links[k, 2]
        ux, uy, uz = dy * z - dz * y, dz * x - dx * z, dx * y - dy * x
        vx = ey * z - ez * y + dy * uz - dz * uy
        vy = ez * x - ex * z + dz * ux - dx * uz
        vz = ex * y - ey * x + dx * uy - dy * ux
        tx = fy * z - fz * y + 2.0 * (ey * uz - ez * uy) + dy * vz - dz * vy
        ty = fz * x - fx * z + 2.0 * (ez * ux - ex * uz) + dz * vx - dx * vz
        tz = fx * y - fy * x + 2.0 * (ex * uy - ey * ux) + dx * vy - dy * vx
        lx += gy * z - gz * y + 3.0 * (fy * uz - fz * uy + ey * vz - ez * vy) + dy * tz - dz * ty
        ly += gz * x - gx * z + 3.0 * (fz * ux - fx * uz + ez * vx - ex * vz) + dz * tx - dx * tz
        lz += gx * y - gy * x + 3.0 * (fx * uy - fy * ux + ex * vy - ey * vx) + dx * ty - dy * tx
        e.speeds[0, k], e.speeds[1, k], e.speeds[2, k] = _norm(dx, dy, dz), _norm(ex, ey, ez), _norm(fx, fy, fz)
    for i in range(6):
        total = m[i, 0] * lx + m[i, 1] * ly + m[i, 2] * lz + m[i, 3] * gx + m[i, 4] * gy + m[i, 5] * gz
        e.fourth[i] = abs(total)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def spread_rates(e: Enclosure, r: float) -> None:
    """Bounds of q', q'', q''' within r of the middle from that of q'''' (Taylor with remainder)."""
    for i in range(6):
        q1, q2, q3, q4 = abs(e.arm.rates[0, i]), abs(e.arm.rates[1, i]), abs(e.arm.rates[2, i]), e.rates[3, i]
        e.rates[2, i] = (q3 + r * q4) * _ROUNDING
        e.rates[1, i] = (q2 + r * (q3 + 0.5 * r * q4)) * _ROUNDING
        e.rates[0, i] = (q1 + r * (q2 + r * (0.5 * q3 + r * q4 / 6.0))) * _ROUNDING


@njit(cache=True, error_model="numpy", _nrt=False)
def imply_fourth(e: Enclosure, r: float, fourth_twist: float) -> None:
    """Fill ``implied``: the bound of |q''''| that follows from the guess in ``rates``; see `enclose`."""
    linear, angular, h = 0.0, fourth_twist, 2.0 * r * r
    # Norms of the first to fourth derivative of a vector fixed in the last link (r1..r4), and of sums of axes.
    r1, r2, r3, r4 = 0.0, 0.0, 0.0, 0.0
    a0, a1, a2, a3, a4 = 0.0, 0.0, 0.0, 0.0, 0.0
    b0, b1, b2, b3, c0, c1, c2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    g = 0.0
    for k in range(6):
        q1, q2, q3, q4 = e.rates[0, k], e.rates[1, k], e.rates[2, k], e.rates[3, k]
        g += q4 + 3.0 * (r1 * q3 + r2 * q2) + r3 * q1
        # r times 6 J2 q3 + 4 J3 q2 + J4 q1 (numbers: orders of derivatives), and 4 r^2 / 2 times J2 q4: what the
        # change of J1 adds to 3 J1 q4 and to J q4.
        q2, q3 = 4.0 * r * q2, 6.0 * r * q3 + h * q4
        q1 *= r
        a0, a1, a2, a3, a4 = a0 + q1, a1 + q1 * r1, a2 + q1 * r2, a3 + q1 * r3, a4 + q1 * r4
        b0, b1, b2, b3 = b0 + q2, b1 + q2 * r1, b2 + q2 * r2, b3 + q2 * r3
        c0, c1, c2 = c0 + q3, c1 + q3 * r1, c2 + q3 * r2
        w0, w1, w2 = e.speeds[0, k], e.speeds[1, k], e.speeds[2, k]
        w, e1, e2 = w0 + r * (w1 + r * (0.5 * w2 + r * g / 6.0)), w1 + r * (w2 + 0.5 * r * g), w2 + r * g
        r1, r2 = w, e1 + w * w
        r3 = e2 + w * (3.0 * e1 + w * w)
        r4 = g + 4.0 * e2 * w + 3.0 * e1 * e1 + w * w * (6.0 * e1 + w * w)
        total = a4 + 4.0 * a3 * r1 + 6.0 * a2 * r2 + 4.0 * a1 * r3 + a0 * r4
        total += b3 + 3.0 * b2 * r1 + 3.0 * b1 * r2 + b0 * r3
        total += c2 + 2.0 * c1 * r1 + c0 * r2
        linear += e.gains[2, k] * total
    angular += a4 + b3 + c2
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += e.drift[i, j] * e.rates[3, j]
        total = e.fourth[i] + 4.0 * r * total + e.gains[0, i] * linear + e.gains[1, i] * angular
        e.implied[i] = total * _ROUNDING


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def enclose(e: Enclosure, r: float, fourth_twist: float) -> int:
    """Bound the joint derivatives within ``r`` (progress) of the middle, where the arm is placed and its rates known.

    ``fourth_twist`` bounds the angular part of x'''' on the piece [rad]. Returns after how many guesses one was
    confirmed; 0 if none was, a smaller piece may do then.
    """
    measure_link_speeds(e)
    _fill_drift(e)
    inverse, links = e.arm.inverse, e.arm.links
    for i in range(6):
        e.gains[0, i] = _norm(inverse[i, 0], inverse[i, 1], inverse[i, 2])
        e.gains[1, i] = _norm(inverse[i, 3], inverse[i, 4], inverse[i, 5])
        e.gains[2, i] = _norm(links[i, 0], links[i, 1], links[i, 2])
        e.rates[3, i] = 0.0
    for guess in range(1, MOST_GUESSES + 1):
        spread_rates(e, r)
        imply_fourth(e, r, fourth_twist)
        confirmed, worst = True, 0.0
        for i in range(6):
            confirmed = confirmed and e.implied[i] < e.rates[3, i]
            worst = max(worst, e.implied[i] / e.rates[3, i])
        if confirmed:
            for i in range(6):
                e.rates[3, i] = e.implied[i]
            spread_rates(e, r)
            return guess
        if guess > 2 and not worst < HOPELESS:
            return 0
        for i in range(6):
            e.rates[3, i] = 1.25 * e.implied[i] + 1e-12
    return 0
