"""The time law along one line, and the bends in it (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.bends import Vectors
from polish_sim.motion.certified.connector import CONNECTOR_PIECES

Array = NDArray[np.float64]

_STEPS = 60
_SHRINKS = 40
_SHRINK = 0.9


class Law(NamedTuple):
    """Way s along a line over time, as cubic pieces that follow one another."""

    starts: Array
    """When each piece begins and the last one ends, counted from the law's start [s], (CONNECTOR_PIECES + 1,)."""
    cubics: Array
    """c0..c3 in the time from the piece's start, shape (CONNECTOR_PIECES, 4)."""


class Motion(NamedTuple):
    """Where the law is at one time."""

    way: float
    speed: float
    acceleration: float
    jerk: float


class Turning(NamedTuple):
    """The rate g of the new chord while a bend is passed: two parabolas of equal duration."""

    begin: float
    """In the law's time [s]."""
    duration: float
    """[s]; 0 if the bend does not fit in."""
    jerks: tuple[float, float]
    """g'' in both halves [m/s^3]."""


def new_law() -> Law:
    """Room for a law."""
    return Law(np.zeros(CONNECTOR_PIECES + 1), np.zeros((CONNECTOR_PIECES, 4)))


@njit(cache=True, error_model="numpy")
def fill_law(law: Law, start: Motion, durations: Array, jerks: Array) -> None:
    """Integrate a connector's pieces from where it begins."""
    time, x, v, a = 0.0, start.way, start.speed, start.acceleration
    for p in range(CONNECTOR_PIECES):
        t, j = durations[p], jerks[p]
        law.starts[p] = time
        law.cubics[p, 0], law.cubics[p, 1], law.cubics[p, 2], law.cubics[p, 3] = x, v, 0.5 * a, j / 6.0
        x, v, a = x + t * (v + t * (0.5 * a + t * j / 6.0)), v + t * (a + 0.5 * t * j), a + t * j
        time += t
    law.starts[CONNECTOR_PIECES] = time


@njit(cache=True, error_model="numpy")
def piece_at(law: Law, time: float) -> int:
    """The piece a time falls into."""
    p = CONNECTOR_PIECES - 1
    while p > 0 and law.starts[p] > time:
        p -= 1
    return p


@njit(cache=True, error_model="numpy")
def law_at(law: Law, time: float) -> Motion:
    """Way, speed, acceleration and jerk at a time."""
    p = piece_at(law, time)
    c, t = law.cubics[p], time - law.starts[p]
    return Motion(
        c[0] + t * (c[1] + t * (c[2] + t * c[3])),
        c[1] + t * (2.0 * c[2] + 3.0 * t * c[3]),
        2.0 * c[2] + 6.0 * t * c[3],
        6.0 * c[3],
    )


@njit(cache=True, error_model="numpy")
def time_at(law: Law, way: float) -> float:
    """When a place is passed [s]."""
    low, high = 0.0, law.starts[CONNECTOR_PIECES]
    time = 0.5 * (low + high)
    for _ in range(_STEPS):
        now = law_at(law, time)
        if now.way > way:
            high = time
        else:
            low = time
        step = (now.way - way) / now.speed if now.speed > 0.0 else math.inf
        time -= step
        if not low <= time <= high:
            time = 0.5 * (low + high)
        if abs(step) < 1e-12 * high:
            break
    return time


@njit(cache=True, error_model="numpy")
def turn_at(law: Law, vertex: float, length: float, before: float, after: float) -> Turning:
    """Place a bend in a law.

    g begins with value and slope 0, ends with those of s', and its area is what is gone of the new chord by then:
    this fixes both jerks and when it begins.

    Args:
        law: The line's.
        vertex: Where the bend is along the line [m].
        length: Its length at constant speed [m].
        before: Most it may take of the old chord [m].
        after: Most it may take of the new one [m].

    Returns:
        The rate of the new chord.
    """
    passed = time_at(law, vertex)
    duration = length / law_at(law, passed).speed
    for _ in range(_SHRINKS):
        begin = _begin(law, vertex, passed, duration)
        end = law_at(law, begin + duration)
        if (
            begin >= 0.0
            and begin + duration <= law.starts[CONNECTOR_PIECES]
            and vertex - law_at(law, begin).way <= before
            and end.way - vertex <= after
        ):
            square = 4.0 * end.speed / (duration * duration)
            slope = end.acceleration / duration
            return Turning(begin, duration, (square - slope, 3.0 * slope - square))
        duration *= _SHRINK
    return Turning(passed, 0.0, (0.0, 0.0))


@njit(cache=True, error_model="numpy")
def _begin(law: Law, vertex: float, passed: float, duration: float) -> float:
    """When g must begin so that its area fits."""
    low, high = passed - duration, passed
    begin = 0.5 * (low + high)
    for _ in range(_STEPS):
        end = law_at(law, begin + duration)
        area = duration * (0.5 * end.speed - duration * end.acceleration / 12.0)
        excess = end.way - vertex - area
        if excess > 0.0:
            high = begin
        else:
            low = begin
        slope = end.speed - duration * (0.5 * end.acceleration - duration * end.jerk / 12.0)
        step = excess / slope if slope > 0.0 else math.inf
        begin -= step
        if not low <= begin <= high:
            begin = 0.5 * (low + high)
        if abs(step) < 1e-15 * duration:
            break
    return begin


@njit(cache=True, error_model="numpy")
def gone_at(turning: Turning, time: float) -> Motion:
    """What is gone of the new chord while it is turned into; beyond the end as at the end."""
    half = 0.5 * turning.duration
    t = time - turning.begin
    first, second = turning.jerks
    if t <= half:
        return Motion(first * t * t * t / 6.0, 0.5 * first * t * t, first * t, first)
    x, v, a, u = first * half**3 / 6.0, 0.5 * first * half * half, first * half, t - half
    return Motion(
        x + u * (v + u * (0.5 * a + u * second / 6.0)), v + u * (a + 0.5 * u * second), a + u * second, second
    )


@njit(cache=True, error_model="numpy")
def next_break(law: Law, turning: Turning, time: float) -> float:
    """The next time after ``time`` at which the jerk may change, at most the bend's end."""
    end = turning.begin + turning.duration
    middle = turning.begin + 0.5 * turning.duration
    then = middle if time < middle else end
    p = piece_at(law, time) + 1
    if p < CONNECTOR_PIECES and time < law.starts[p] < then:
        then = law.starts[p]
    return then


class Load(NamedTuple):
    """Largest acceleration and jerk of a vector, and whether both chords are only ever run forwards."""

    acceleration: float
    jerk: float
    forwards: bool


@njit(cache=True, error_model="numpy")
def bend_load(law: Law, turning: Turning, v: Vectors) -> Load:
    """Exact peaks of s t1 + gone (t2 - t1) while a bend is passed: in a piece jerk is constant, acceleration linear."""
    acceleration = jerk = 0.0
    forwards = turning.jerks[0] >= 0.0
    time, end = turning.begin, turning.begin + turning.duration
    while time < end:
        then = next_break(law, turning, time)
        middle, half = 0.5 * (time + then), 0.5 * (then - time)
        jerk = max(jerk, _size(v, law_at(law, middle).jerk, gone_at(turning, middle).jerk))
        for at in (time, then):
            line, gone = law_at(law, at), gone_at(turning, at)
            acceleration = max(acceleration, _size(v, line.acceleration, gone.acceleration))
            rest, slope = line.speed - gone.speed, line.acceleration - gone.acceleration
            # The control polygon of a quadratic lies above zero, so it does too.
            inner = rest + half * slope if at < then else rest
            forwards = forwards and min(rest, inner) >= -1e-9 * line.speed
        if then <= time:
            break
        time = then
    return Load(acceleration, jerk, forwards)


@njit(cache=True, error_model="numpy")
def _size(v: Vectors, line: float, gone: float) -> float:
    """|line t1 + gone (t2 - t1)|."""
    rest = line - gone
    return math.sqrt(max(rest * rest * v.first + gone * gone * v.second + 2.0 * rest * gone * v.product, 0.0))
