"""A corner, and the kernel it is passed with: its pieces, bounds of its motion, and its scaling.

A kernel takes the last ``size`` of the old segment and the first of the new one. a(t) is what remains of the old, b(t)
what is gone of the new one: ``a(0) = h, a'(0) = -v, a''(0) = alpha``, all zero at the end, ``b(t) = a(T - t)``; jerk is
constant in each of ``PIECES`` pieces. Tip and tool axis both move as ``-a(t) r1 + b(t) r2``, planar vectors r1, r2 per
generalised length (the axis to first order). Along a piece jerk is constant, the norm of the acceleration convex, the
speed below its control points.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record
from polish_sim.motion.certified.connector import Peaks

HALF = 6  #: Pieces of half a kernel
PIECES = 2 * HALF  #: Pieces of a kernel
FAR = (1e30, 1e30)  #: Generalised lengths of segments whose other ends do not matter [m]
ROUNDING = 1.0 - 1e-12  #: Kept from limits and tolerances for rounding
VERTEX_SHARE = 2.0
"""How many tolerances a corner's vertex may be missed by. Binds beyond turns of 120 deg, where staying close to the
polyline alone would cut off the tip of a spike."""


class Side(NamedTuple):
    """Tip or tool axis at a corner: its rates r1, r2 per generalised length before and after it, and its limits."""

    first: float  #: |r1| [-] or [rad/m]
    second: float  #: |r2|
    cosine: float  #: Of the turn between them; 0 where one of them is zero
    sine: float  #: Of the turn, never less than it is
    limits: Peaks
    tolerance: float  #: [m] or [rad]
    is_axis: bool


class Corner(NamedTuple):
    """What a kernel is made for."""

    tip: Side
    axis: Side
    along: Peaks  #: Limits along both segments: the smaller ones [m/s, m/s^2, m/s^3]
    spans: tuple[float, float]  #: Generalised lengths of both segments [m]


class Figures(NamedTuple):
    """A kernel seen from outside."""

    size: float  #: Of either segment [m of generalised length]
    speed: float  #: At both ends [m/s]
    acceleration: float  #: Deceleration at its start, acceleration at its end [m/s^2], at least 0
    duration: float  #: [s]


class Kernel(Record):
    """Pieces of a corner's kernel or of a bend."""

    durations: Annotated[Array, (PIECES,)]  #: [s]; 0 for one that is not used
    remaining: Annotated[Array, (PIECES, 4)]  #: c0 .. c3 of a in each piece [m]
    gone: Annotated[Array, (PIECES, 4)]  #: c0 .. c3 of b [m]


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def side_of(first: float, second: float, cosine: float, limits: Peaks, tolerance: float, is_axis: bool) -> Side:
    """Make a side; the sine is rounded up so that no turn counts as straight."""
    cosine = min(max(cosine, -1.0), 1.0) if first > 0.0 and second > 0.0 else 0.0
    sine = math.sqrt(1.0 - cosine * cosine + 1e-15)
    return Side(float(first), float(second), cosine, sine, limits, tolerance * ROUNDING, is_axis)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def with_less(side: Side, shares: Peaks) -> Side:
    """The side with acceleration and jerk limits divided by these shares where they are above 1."""
    most = side.limits
    limits = Peaks(most.speed, most.acceleration / max(shares.acceleration, 1.0), most.jerk / max(shares.jerk, 1.0))
    return Side(side.first, side.second, side.cosine, side.sine, limits, side.tolerance, side.is_axis)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def goes_straight(side: Side) -> bool:
    """Whether nothing changes at the corner."""
    return side.first == side.second and (side.first == 0.0 or side.cosine == 1.0)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def square_of(side: Side, a: float, b: float) -> float:
    """Square of |-a r1 + b r2|; rounding does not make it negative."""
    x, y = side.first * a, side.second * b
    return max((x - y) ** 2 + 2.0 * x * y * (1.0 - side.cosine), 0.0)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def set_cubic(row: Array, way: float, speed: float, acceleration: float, jerk: float) -> None:
    """Write c0 .. c3 of a piece from its motion at the start."""
    row[0], row[1], row[2], row[3] = way, speed, 0.5 * acceleration, jerk / 6.0


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def set_knot(kernel: Kernel, k: int, acceleration: float) -> None:
    """Set a'' at knot ``k``, 0 to PIECES, before `integrate_knots`."""
    if k < PIECES:
        kernel.remaining[k, 0] = acceleration
    if k > 0:
        kernel.remaining[k - 1, 1] = acceleration


@njit(cache=True, error_model="numpy", _nrt=False)
def integrate_knots(kernel: Kernel) -> Figures:
    """Write cubic pieces from accelerations at the knots; a = a' = a'' = 0 at the end. Returns the kernel's figures.

    Durations are symmetric, columns 0 and 1 of ``remaining`` hold a'' at both ends of every piece.
    """
    durations, remaining, gone = kernel.durations, kernel.remaining, kernel.gone
    position = rate = time = 0.0
    start = remaining[0, 0]
    # b: the knots of a from the last to the first.
    for p in range(PIECES):
        mirror, dt = PIECES - 1 - p, durations[p]
        second, third = 0.5 * remaining[mirror, 1], (remaining[mirror, 0] - remaining[mirror, 1]) / (6.0 * dt)
        gone[p, 0], gone[p, 1], gone[p, 2], gone[p, 3] = position, rate, second, third
        position += dt * (rate + dt * (second + dt * third))
        rate += dt * (2.0 * second + dt * 3.0 * third)
        time += dt
    size, speed = position, rate
    rate = -rate
    for p in range(PIECES):
        dt = durations[p]
        second, third = 0.5 * remaining[p, 0], (remaining[p, 1] - remaining[p, 0]) / (6.0 * dt)
        remaining[p, 0], remaining[p, 1], remaining[p, 2], remaining[p, 3] = position, rate, second, third
        position += dt * (rate + dt * (second + dt * third))
        rate += dt * (2.0 * second + dt * 3.0 * third)
    return Figures(size, speed, start, time)


@njit(cache=True, error_model="numpy", _nrt=False)
def measure_peaks(side: Side, kernel: Kernel, pieces: int) -> Peaks:
    """Bounds on the norms of the first three derivatives: acceleration and jerk exact, speed by control points."""
    speed = acceleration = jerk = 0.0
    for p in range(pieces):
        dt = kernel.durations[p]
        if dt == 0.0:
            continue
        a1, a2, a3 = kernel.remaining[p, 1], kernel.remaining[p, 2], kernel.remaining[p, 3]
        b1, b2, b3 = kernel.gone[p, 1], kernel.gone[p, 2], kernel.gone[p, 3]
        jerk = max(jerk, square_of(side, a3, b3))
        acceleration = max(acceleration, square_of(side, a2, b2))
        acceleration = max(acceleration, square_of(side, a2 + 3.0 * a3 * dt, b2 + 3.0 * b3 * dt))
        speed = max(speed, square_of(side, a1, b1), square_of(side, a1 + a2 * dt, b1 + b2 * dt))
        end_a, end_b = a1 + dt * (2.0 * a2 + 3.0 * a3 * dt), b1 + dt * (2.0 * b2 + 3.0 * b3 * dt)
        speed = max(speed, square_of(side, end_a, end_b))
    return Peaks(math.sqrt(speed), 2.0 * math.sqrt(acceleration), 6.0 * math.sqrt(jerk))


@njit(cache=True, error_model="numpy", _nrt=False)
def runs_forwards(kernel: Kernel) -> bool:
    """Whether what remains of the old segment falls and what is gone of the new one rises, by control points."""
    least = -1e-9 * abs(kernel.remaining[0, 1])
    for p in range(PIECES):
        dt = kernel.durations[p]
        for cubic, sign in ((kernel.gone[p], 1.0), (kernel.remaining[p], -1.0)):
            c1, c2, c3 = sign * cubic[1], sign * cubic[2], sign * cubic[3]
            if dt > 0.0 and min(c1, c1 + c2 * dt, c1 + dt * (2.0 * c2 + 3.0 * c3 * dt)) < least:
                return False
    return True


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _largest(cubic: Array, dt: float) -> float:
    """Largest absolute value of a cubic over [0, dt]."""
    c0, c1, c2, c3 = cubic[0], cubic[1], cubic[2], cubic[3]
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
    """Largest control value of a cubic over [0, dt]: the cubic stays below it."""
    first, second = c0 + c1 * dt / 3.0, c0 + (2.0 * c1 + c2 * dt) * dt / 3.0
    return max(c0, first, second, c0 + dt * (c1 + dt * (c2 + dt * c3)))


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _beside(r1: float, r2: float, side: Side, span: float, bend: float, near: Array, far: Array, dt: float) -> float:
    """Bound on a piece's distance to the segment it goes along: across, and past either end.

    ``near`` is its progress along that segment at rate r1, ``far`` along the other one at r2; see `bound_deviation`.
    """
    across = _largest(far, dt) * r2 * side.sine
    along = r2 * side.cosine
    c0, c1 = along * far[0] - r1 * near[0], along * far[1] - r1 * near[1]
    c2, c3 = along * far[2] - r1 * near[2], along * far[3] - r1 * near[3]
    behind = _highest_control(-c0, -c1, -c2, -c3, dt) - r1 * span
    past = max(_highest_control(c0, c1, c2, c3, dt), behind) + bend
    return math.hypot(across, past) if past > 0.0 else across


@njit(cache=True, error_model="numpy", _nrt=False)
def bound_deviation(side: Side, spans: tuple[float, float], bend: float, kernel: Kernel) -> float:
    """Bound on the distance of a kernel's motion from its two segments of generalised lengths ``spans`` [m].

    ``bend`` is an allowance added beyond the vertex for the axis moving on a sphere [rad], 0 for the tip.
    """
    one, two, deviation = side.first, side.second, 0.0
    for p in range(HALF if one == two and spans[0] == spans[1] else PIECES):
        remaining, gone, dt = kernel.remaining[p], kernel.gone[p], kernel.durations[p]
        old = _beside(one, two, side, spans[0], bend, remaining, gone, dt)
        if old > deviation:
            deviation = max(deviation, min(old, _beside(two, one, side, spans[1], bend, gone, remaining, dt)))
    return deviation


@njit(cache=True, error_model="numpy", _nrt=False)
def share_used(side: Side, spans: tuple[float, float], size: float, kernel: Kernel) -> float:
    """Share of a side's tolerance used by a kernel of a size [m], at most; a smaller one of its kind uses less."""
    angle = 1.2 * size * max(side.first, side.second) if side.is_axis else 0.0
    missed = math.sqrt(square_of(side, kernel.remaining[HALF, 0], kernel.gone[HALF, 0])) / VERTEX_SHARE
    return max(bound_deviation(side, spans, 3.0 * angle**3, kernel), missed) * (1.0 + angle * angle) / side.tolerance


@njit(cache=True, error_model="numpy", _nrt=False)
def copy_scaled(source: Kernel, length: float, time: float, kernel: Kernel) -> None:
    """Write a kernel's copy with lengths and times multiplied; ``kernel`` may be the source."""
    for p in range(PIECES):
        kernel.durations[p] = source.durations[p] * time
        factor = length
        for c in range(4):
            kernel.remaining[p, c] = source.remaining[p, c] * factor
            kernel.gone[p, c] = source.gone[p, c] * factor
            factor /= time


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def scaled_figures(figures: Figures, length: float, time: float) -> Figures:
    """Figures of a kernel with lengths and times multiplied."""
    return Figures(
        figures.size * length,
        figures.speed * length / time,
        figures.acceleration * length / (time * time),
        figures.duration * time,
    )


@njit(cache=True, error_model="numpy", _nrt=False)
def rescale(figures: Figures, length: float, time: float, kernel: Kernel) -> Figures:
    """Multiply lengths and times of a kernel in place; its new figures."""
    copy_scaled(kernel, length, time, kernel)
    return scaled_figures(figures, length, time)


@njit(cache=True, error_model="numpy", _nrt=False)
def fit_limits(corner: Corner, figures: Figures, kernel: Kernel) -> tuple[Figures, bool]:
    """Scale a kernel to full jerk, as large as speeds and tolerances allow, as slow as accelerations require.

    Returns its figures, and whether the axis required the scaling.
    """
    tip, axis, along = corner.tip, corner.axis, corner.along
    one, two = _asked(tip, kernel), _asked(axis, kernel)
    off_tip, off_axis = share_used(tip, FAR, figures.size, kernel), share_used(axis, FAR, figures.size, kernel)
    axis_binds = (
        off_axis > off_tip or two.speed > one.speed or two.acceleration > one.acceleration or two.jerk > one.jerk
    )
    acceleration = max(one.acceleration, two.acceleration, figures.acceleration / along.acceleration) / ROUNDING
    root = (max(one.jerk, two.jerk) / ROUNDING) ** (1.0 / 3.0)
    top = figures.speed / root + 0.5 * figures.acceleration**2 / along.jerk / root**4
    # Speeds grow with length^(2/3) at full jerk.
    share = max(top / along.speed, one.speed / root, two.speed / root) / ROUNDING
    length = min(share**-1.5, 1.0 / max(off_tip, off_axis))
    time = max(root * length ** (1.0 / 3.0), math.sqrt(length * acceleration))
    figures = rescale(figures, length, time, kernel)
    off = share_used(axis, FAR, figures.size, kernel)
    if off > 1.0:
        # Grown, the axis bends a little more. Smaller with the same jerk: all other limits hold the more.
        figures = rescale(figures, 1.0 / off, off ** (-1.0 / 3.0), kernel)
    return figures, axis_binds


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _asked(side: Side, kernel: Kernel) -> Peaks:
    """Peaks of a kernel on one side as shares of its limits."""
    peaks, most = measure_peaks(side, kernel, HALF if side.first == side.second else PIECES), side.limits
    return Peaks(peaks.speed / most.speed, peaks.acceleration / most.acceleration, peaks.jerk / most.jerk)


@njit(cache=True, error_model="numpy", _nrt=False)
def fit_ends(corner: Corner, figures: Figures, kernel: Kernel) -> Figures:
    """Shrink a kernel until it stays beside its two segments, which may be short, and not only beside their lines."""
    spans = corner.spans
    length = min(spans[0], spans[1]) / figures.size if figures.size > 0.0 else 1.0
    if length < 1.0:
        figures = rescale(figures, length, length ** (1.0 / 3.0), kernel)
    off = max(share_used(corner.tip, spans, figures.size, kernel), share_used(corner.axis, spans, figures.size, kernel))
    if off > 1.0:
        # What is past an end falls faster than the kernel.
        figures = rescale(figures, 1.0 / off, off ** (-1.0 / 3.0), kernel)
    return figures
