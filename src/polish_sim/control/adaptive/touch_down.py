"""Law ``touch-down``: notice the part, press on it as fast as robot and springs allow, stop at the set force (layer 7).

Contact is what the air was not: in the air the reading's mean is learned, and its noise, from what a low-pass takes off
and from what it leaves (values beyond two deviations count as two: a rising force must not pass for noise). The part is
there once the reading, at one of two low-passes (30 Hz for fast approaches, 5 Hz for slow ones), leaves the mean by
five standard deviations. Where it falls back it was noise, and the tool goes on as before.

The speed then follows from the travel still to go, as for the quickest stop at an acceleration a without overshoot:
v = w x near the end, v = sqrt(2 a (x - a / 2 w^2)) before. It starts at the speed of the approach, grows with the
evidence of contact, and is bounded by the force's rate of rise. Nothing is integrated until the force has landed.
"""

from __future__ import annotations

import math

from numba import njit

from polish_sim.control.adaptive.gains import AdaptiveGains
from polish_sim.control.adaptive.memory import (
    AGE,
    AIR_MEAN,
    AIR_VARIANCE,
    APPROACH_SPEED,
    FAST,
    FAST_VARIANCE,
    LANDED,
    SLOW,
    WATCHED,
    PressMemory,
)
from polish_sim.control.filters import low_pass_step

_FAST_HZ, _SLOW_HZ = 30.0, 5.0
_FAST_SHARE, _SLOW_SHARE = 0.58, 0.25  # of a reading's deviation (80 Hz) that these low-passes let through
_ROUGH_SHARE = 0.73  # of its variance that the faster low-pass takes off
_SIGMAS = 5.0
_FAST_LEAST, _SLOW_LEAST = 0.4, 0.3  # smallest rise that counts as contact [N]
_ARMED = 0.15  # time in the air before the statistics are believed [s]
_AIR_MEMORY, _NOISE_MEMORY = 0.4, 1.0  # [s]
_LARGEST_OFFSET = 1.5  # of the reading in the air [N]
_SURE = 1.5  # further rise at which contact is beyond doubt [N]
_SEEK_SLOWEST, _SEEK_FASTEST = 0.005, 0.02  # towards a part that should be there [m/s]
_FOUND = 0.2  # contact that lasted this long was the part [s]
_BRAKING = 0.8  # share of the robot's acceleration that is planned with
_LANDED = 0.01  # speed below which the landing ends [m/s]
_LANDING_ENDS = 0.15  # time in which the observer's rate is faded in [s]


@njit(cache=True)
def smooth_reading(memory: PressMemory, reading: float, dt: float) -> None:
    """Keep the two low-passed readings up to date [N]."""
    air = memory.air
    air[FAST] = low_pass_step(air[FAST], reading, _FAST_HZ, dt)
    air[SLOW] = low_pass_step(air[SLOW], reading, _SLOW_HZ, dt)


@njit(cache=True)
def watch_air(memory: PressMemory, reading: float, approaching: bool, dt: float) -> bool:
    """Learn what the reading [N] is like in the air; True once it is not like that any more."""
    air = memory.air
    if not approaching:
        air[WATCHED] = 0.0
        return False
    air[WATCHED] += dt
    if air[WATCHED] <= 1.5 * dt:
        air[AIR_MEAN], air[AIR_VARIANCE], air[FAST], air[SLOW], air[FAST_VARIANCE] = reading, 0.0, reading, reading, 0.0
        return False
    smooth_reading(memory, reading, dt)
    slow_rise = max(_SLOW_LEAST, _SLOW_SHARE / _FAST_SHARE * _SIGMAS * _deviation(memory))
    if is_armed(memory) and (air[FAST] - air[AIR_MEAN] > fast_rise(memory) or air[SLOW] - air[AIR_MEAN] > slow_rise):
        return True
    share, rough, off = dt / min(air[WATCHED], _AIR_MEMORY), reading - air[FAST], air[FAST] - air[AIR_MEAN]
    counted = min(off * off, 4.0 * air[FAST_VARIANCE]) if is_armed(memory) else off * off
    air[FAST_VARIANCE] += dt / min(air[WATCHED], _NOISE_MEMORY) * (counted - air[FAST_VARIANCE])
    air[AIR_MEAN] += share * (reading - air[AIR_MEAN])
    air[AIR_MEAN] = min(max(air[AIR_MEAN], -_LARGEST_OFFSET), _LARGEST_OFFSET)
    air[AIR_VARIANCE] += share * (rough * rough / _ROUGH_SHARE - air[AIR_VARIANCE])
    return False


@njit(cache=True)
def fast_rise(memory: PressMemory) -> float:
    """Rise of the faster low-pass above the air that only contact explains [N]."""
    return max(_FAST_LEAST, _SIGMAS * _deviation(memory))


@njit(cache=True)
def _deviation(memory: PressMemory) -> float:
    """Of the faster low-passed reading in the air: what white noise would do, or what it did if that is more [N]."""
    return math.sqrt(max(_FAST_SHARE * _FAST_SHARE * memory.air[AIR_VARIANCE], memory.air[FAST_VARIANCE]))


@njit(cache=True)
def is_armed(memory: PressMemory) -> bool:
    """Whether the air has been watched for long enough to tell contact from noise."""
    return bool(memory.air[WATCHED] > _ARMED)


@njit(cache=True)
def fell_back(memory: PressMemory) -> bool:
    """Whether the reading is again what it was in the air."""
    return bool(memory.air[FAST] - memory.air[AIR_MEAN] < 0.25 * fast_rise(memory))


@njit(cache=True)
def seek_speed(memory: PressMemory) -> float:
    """Speed towards a part that should be there: as in the approach, quicker where contact was lost [m/s]."""
    if memory.force[AGE] > _FOUND:
        return _SEEK_FASTEST
    return min(max(memory.air[APPROACH_SPEED], _SEEK_SLOWEST), _SEEK_FASTEST)


@njit(cache=True)
def speed_limit(g: AdaptiveGains, memory: PressMemory, stiffness: float) -> float:
    """Highest speed along tool z for the evidence of contact there is and a ``stiffness`` [N/m]; result [m/s]."""
    if g.touch_down == 0.0:
        return g.speed
    rise = memory.air[FAST] - memory.air[AIR_MEAN] - fast_rise(memory)
    evidence = min(max(rise / _SURE, 0.0), 1.0)
    believed = min(seek_speed(memory) + evidence * g.speed, g.speed)
    return min(believed, max(g.force_rate / stiffness, _SEEK_SLOWEST))


@njit(cache=True)
def quickest_stop(g: AdaptiveGains, travel: float, crossover: float, limit: float) -> float:
    """Speed at which a travel still to go [m] is ended soonest without going too far [m/s]."""
    far = abs(travel)
    speed = crossover * far
    if g.touch_down > 0.0:
        a = _BRAKING * g.acceleration
        bend = a / (crossover * crossover)
        if far > bend:
            speed = math.sqrt(2.0 * a * (far - 0.5 * bend))
    speed = min(speed, limit)
    return speed if travel >= 0.0 else -speed


@njit(cache=True)
def note_landing(g: AdaptiveGains, memory: PressMemory, speed: float, dt: float) -> None:
    """Keep how far the landing is over: it ends once the wanted speed [m/s] is small, and the rate is faded in."""
    if g.touch_down == 0.0:
        memory.force[LANDED] = 1.0
    elif abs(speed) < _LANDED:
        memory.force[LANDED] = min(1.0, memory.force[LANDED] + dt / _LANDING_ENDS)
