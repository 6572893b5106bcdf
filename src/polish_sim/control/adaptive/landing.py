"""Law ``touch-down``: notice the part, press on it as fast as robot and springs allow, stop at the set force.

Contact is what the air was not: on the way down the reading's mean is learned, and its noise, from what a
low-pass takes off and from what it leaves (values beyond two deviations count as two: a rising force must not
pass for noise). The part is there once the reading, at one of two low-passes (30 Hz for fast approaches, 5 Hz
for slow ones), leaves the mean by five standard deviations. Where it falls back it was noise, and the
approach continues.

The speed then follows from the travel still to go, as for the quickest stop at an acceleration a without
overshoot: v = w x near the end, v = sqrt(2 a (x - a / 2 w^2)) before. It starts at the speed of the approach
and grows with the evidence of contact. Nothing is integrated until the force has landed.

Whatever stiffness is believed, the tool cannot strike: its speed stays below `loops.strike_limit`.
"""

from __future__ import annotations

import math

from polish_sim.control.adaptive.gains import AdaptiveGains, PressMemory
from polish_sim.control.loops import BRAKING, low_pass_step
from polish_sim.control.signals import Measurement
from polish_sim.kernels import cross, dot, kernel

_FAST_HZ, _SLOW_HZ = 30.0, 5.0
_FAST_SHARE, _SLOW_SHARE = 0.58, 0.25  # of a reading's deviation (80 Hz) that these low-passes let through
_ROUGH_SHARE = 0.73  # of its variance that the faster low-pass takes off
_SIGMAS = 5.0
_FAST_LEAST, _SLOW_LEAST = 0.4, 0.3  # smallest rise that counts as contact [N]
_ARMED = 0.15  # time in the air before the statistics are believed [s]
_AIR_MEMORY, _NOISE_MEMORY = 0.4, 1.0  # [s]
_LARGEST_OFFSET = 1.5  # of the reading in the air [N]
_SURE = 1.5  # further rise at which contact is beyond doubt [N]
SEEK_SLOWEST, _SEEK_FASTEST = 0.005, 0.02  # towards a part that should be there [m/s]
_SWING = 0.06  # the slowest swing of an arm takes so long [s]
_FOUND = 0.2  # contact that lasted this long was the part [s]
_LANDED = 0.01  # speed below which the landing ends [m/s]
_LANDING_ENDS = 0.15  # time in which the observer's rate is faded in [s]


@kernel
def smooth_reading(memory: PressMemory, reading: float, dt: float) -> None:
    """Keep the two low-passed readings up to date [N]."""
    air = memory.air
    air.fast = low_pass_step(air.fast, reading, _FAST_HZ, dt)
    air.slow = low_pass_step(air.slow, reading, _SLOW_HZ, dt)


@kernel
def watch_air(memory: PressMemory, reading: float, planned: float, controlled: bool, dt: float) -> bool:
    """Learn what the reading [N] is like in the air; True once it is not like that any more.

    It is learned on the way down alone, at a ``planned`` speed [m/s]: where contact was lost with the force
    ``controlled``, the tool may touch, and a force taken for noise would be missed the more.
    """
    air = memory.air
    if planned <= 1e-5 and not controlled:
        air.watched = 0.0
        return False
    air.watched += dt
    if air.watched <= 1.5 * dt:
        air.mean, air.variance, air.fast, air.slow, air.fast_variance = reading, 0.0, reading, reading, 0.0
        return False
    smooth_reading(memory, reading, dt)
    slow_rise = max(_SLOW_LEAST, _SLOW_SHARE / _FAST_SHARE * _SIGMAS * _deviation(memory))
    if is_armed(memory) and (air.fast - air.mean > fast_rise(memory) or air.slow - air.mean > slow_rise):
        return True
    if controlled and is_armed(memory):
        return False
    share, rough, off = dt / min(air.watched, _AIR_MEMORY), reading - air.fast, air.fast - air.mean
    counted = min(off * off, 4.0 * air.fast_variance) if is_armed(memory) else off * off
    air.fast_variance += dt / min(air.watched, _NOISE_MEMORY) * (counted - air.fast_variance)
    air.mean += share * (reading - air.mean)
    air.mean = min(max(air.mean, -_LARGEST_OFFSET), _LARGEST_OFFSET)
    air.variance += share * (rough * rough / _ROUGH_SHARE - air.variance)
    return False


@kernel
def fast_rise(memory: PressMemory) -> float:
    """Rise of the faster low-pass above the air that only contact explains [N]."""
    return max(_FAST_LEAST, _SIGMAS * _deviation(memory))


@kernel
def _deviation(memory: PressMemory) -> float:
    """Standard deviation of the faster low-passed reading in the air [N]: that of white noise, or the
    measured one if that is larger."""
    return math.sqrt(max(_FAST_SHARE * _FAST_SHARE * memory.air.variance, memory.air.fast_variance))


@kernel
def is_armed(memory: PressMemory) -> bool:
    """Whether the air has been watched for long enough to distinguish contact from noise."""
    return bool(memory.air.watched > _ARMED)


@kernel
def fell_back(memory: PressMemory) -> bool:
    """Whether the reading is again what it was in the air; after the first touch not for half a swing of the
    arm."""
    air = memory.air
    reading = max(air.fast, air.slow if memory.force.age > _SWING else air.fast)
    return bool(reading - air.mean < 0.25 * fast_rise(memory))


@kernel
def seek_speed(memory: PressMemory) -> float:
    """Speed towards a part that should be there: as in the approach, quicker where contact was lost [m/s]."""
    if memory.force.age > _FOUND:
        return _SEEK_FASTEST
    return min(max(memory.air.approach_speed, SEEK_SLOWEST), _SEEK_FASTEST)


@kernel
def speed_limit(g: AdaptiveGains, memory: PressMemory) -> float:
    """Highest speed along tool z for the evidence of contact there is [m/s]."""
    if not g.touch_down:
        return g.top_speed_m_s
    rise = memory.air.fast - memory.air.mean - fast_rise(memory)
    evidence = min(max(rise / _SURE, 0.0), 1.0)
    return min(seek_speed(memory) + evidence * g.top_speed_m_s, g.top_speed_m_s)


@kernel
def quickest_stop(g: AdaptiveGains, travel: float, crossover: float, limit: float) -> float:
    """Speed at which a travel still to go [m] is ended soonest without going too far [m/s]."""
    far = abs(travel)
    speed = crossover * far
    if g.touch_down:
        a = BRAKING * g.acceleration_m_s2
        bend = a / (crossover * crossover)
        if far > bend:
            speed = math.sqrt(2.0 * a * (far - 0.5 * bend))
    return math.copysign(min(speed, limit), travel)


@kernel
def note_landing(g: AdaptiveGains, memory: PressMemory, speed: float, dt: float) -> None:
    """Keep how far the landing is over: it ends once the wanted speed [m/s] is small, and the rate is faded
    in."""
    if not g.touch_down:
        memory.force.landed = 1.0
    elif abs(speed) < _LANDED:
        memory.force.landed = min(1.0, memory.force.landed + dt / _LANDING_ENDS)


# Law ``stiffness``: dF/dz from the tool's own motion while it lands, stiff until proven soft.
#
# Least squares of force over travel, both as the sensor shows them, of everything since contact: a tool that
# lands makes the arm swing on its gears, and over a few periods that is no slope. What is used is the upper
# end of the estimate, k + 2 sigma / sqrt(sum (z - mean)^2), sigma from what the line leaves: wide at first
# touch, when the travel says nothing yet, within a fraction of a millimetre at the slope itself, and wider
# where the force swings. A spring taken for stiffer than it is makes the loop slow, never unstable. It learns
# until the set force is reached, while the place on the path rests and the tool does not (1 mm/s): later,
# travel follows the part and its slope against the force says nothing about springs.

_EXCITED = 0.001  # slower motion teaches nothing [m/s]
_CONFIDENCE = 2.0  # standard deviations
_LEAST_NOISE = 0.2  # of a reading [N]
_SOFTEST, _STIFFEST = 0.1, 10.0  # of the nominal stiffness


@kernel
def restart_fit(memory: PressMemory, path: float, force: float) -> None:
    """Forget everything but where the tool touched: ``path`` [m], ``force`` [N], as sensed."""
    fit = memory.fit
    fit.mean_path, fit.mean_force, fit.reached = path, force, False
    fit.count = fit.spread = fit.co_spread = fit.force_spread = 0.0


@kernel
def refine_stiffness(
    g: AdaptiveGains, memory: PressMemory, path: float, force: float, pressing: float
) -> float:
    """Take in travel ``path`` [m] and ``force`` [N] as sensed; upper end of what the stiffness may be [N/m].

    It is within 0.1 to 10 times the nominal one, and ``stiff_first`` times it while the travel says nothing.
    ``pressing`` is the present speed into the part [m/s].
    """
    fit = memory.fit
    if abs(pressing) > _EXCITED:
        fit.count += 1.0
        share = (fit.count - 1.0) / fit.count
        dz, df = path - fit.mean_path, force - fit.mean_force
        fit.mean_path += dz / fit.count
        fit.mean_force += df / fit.count
        fit.spread += share * dz * dz
        fit.co_spread += share * dz * df
        fit.force_spread += share * df * df
    spread = fit.spread + 1e-16
    slope = fit.co_spread / spread
    left = (fit.force_spread - slope * fit.co_spread) / max(fit.count, 1.0)
    # A low-passed reading is worth a quarter of a fresh one.
    sigma = 2.0 * math.sqrt(max(memory.air.variance, left, _LEAST_NOISE * _LEAST_NOISE))
    upper = min(slope + _CONFIDENCE * sigma / math.sqrt(spread), max(g.stiff_first * g.stiffness_n_m, slope))
    return min(max(upper, _SOFTEST * g.stiffness_n_m), _STIFFEST * g.stiffness_n_m)


# Law ``inertia``: forces the sensor reads that no part exerts, from the tool's own motion.
#
# The wrist sensor carries the tool: it reads m dv/dt besides the contact. The head's damper presses c v into
# a part while it moves. On a bend the tool is accelerated along its axis though its speed along it stays
# zero: the tool point goes round the bend, the mass centre round the tool point. All of it follows from the
# encoders:
#
#     own = m (dv/dt - (w x z).v + l w^2) + c v,
#
# the damper's share through the pole of damper and springs. Without dv/dt a force loop of crossover w_c
# behind an observer w_o feeds 2 w_c w_o m / k of its command back at any frequency, whatever the part: 0.64
# with 2 kg, 5000 N/m and 20 rad/s each. The turning terms are 0.7 N at 60 mm/s on a bend of 60 mm radius.


@kernel
def own_force(
    g: AdaptiveGains, memory: PressMemory, m: Measurement, speed: float, pressing: float, dt: float
) -> float:
    """Force along tool z that the sensor reads from the tool's motion alone [N], at a ``speed`` along its
    axis [m/s].

    ``pressing`` is the speed at which the head is pressed in, 0 in the air [m/s].
    """
    motion = memory.motion
    acceleration = (speed - motion.last_speed) / dt if motion.moved else 0.0
    motion.last_speed, motion.moved = speed, True
    acceleration += round_a_bend(g, m)
    stiffer = max(memory.force.stiffness / g.stiffness_n_m, 0.05)
    motion.damper_speed += (1.0 - math.exp(-dt * stiffer / g.damping_lag_s)) * (
        pressing - motion.damper_speed
    )
    inertia = g.tool_mass_kg * acceleration if g.inertia else 0.0
    return inertia + g.damping_n_s_m * motion.damper_speed


@kernel
def round_a_bend(g: AdaptiveGains, m: Measurement) -> float:
    """Acceleration of the carried mass along tool z by turning: -(w x z).v + l (w^2 - (w.z)^2) [m/s^2]."""
    w, z = m.twist[3:6], m.rotation[:, 2]
    across = dot(w, w) - dot(w, z) * dot(w, z)
    return float(g.tool_center_m * across - dot(cross(w, z), m.twist))
