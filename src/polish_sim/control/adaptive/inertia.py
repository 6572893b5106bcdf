"""Law ``inertia``: forces the sensor reads that no part exerts, from the tool's own motion (layer 7).

The wrist sensor carries the tool: it reads m dv/dt besides the contact. The head's damper presses c v into a part
while it moves. On a bend the tool is accelerated along its axis though its speed along it stays zero: the tool point
goes round the bend, the mass centre round the tool point. All of it follows from the encoders:

    own = m (dv/dt - (w x z).v + l w^2) + c v,

the damper's share through the pole of damper and springs. Without dv/dt a force loop of crossover w_c behind an
observer w_o feeds 2 w_c w_o m / k of its command back at any frequency, whatever the part: 0.64 with 2 kg, 5000 N/m
and 20 rad/s each. The turning terms come to 0.7 N at 60 mm/s on a bend of 60 mm radius.
"""

from __future__ import annotations

import math

from numba import njit

from polish_sim.control.adaptive.gains import AdaptiveGains
from polish_sim.control.adaptive.memory import DAMPER_SPEED, LAST_SPEED, MOVED, STIFFNESS, PressMemory
from polish_sim.control.signals import Measurement


@njit(cache=True)
def own_force(g: AdaptiveGains, memory: PressMemory, m: Measurement, speed: float, pressing: float, dt: float) -> float:
    """Force along tool z that the sensor reads from the tool's motion alone [N].

    Args:
        g: Mass, damper and its lag.
        memory: Last speed and the damper's.
        m: Measurement.
        speed: Of the tool along its axis [m/s].
        pressing: Speed at which the head is pressed in, 0 in the air [m/s].
        dt: Control cycle [s].
    """
    motion = memory.motion
    acceleration = (speed - motion[LAST_SPEED]) / dt if motion[MOVED] > 0.0 else 0.0
    motion[LAST_SPEED], motion[MOVED] = speed, 1.0
    acceleration += round_a_bend(g, m)
    stiffer = max(memory.force[STIFFNESS] / g.stiffness, 0.05)
    motion[DAMPER_SPEED] += (1.0 - math.exp(-dt * stiffer / g.damping_lag)) * (pressing - motion[DAMPER_SPEED])
    return g.inertia * g.mass * acceleration + g.damping * motion[DAMPER_SPEED]


@njit(cache=True)
def round_a_bend(g: AdaptiveGains, m: Measurement) -> float:
    """Acceleration of the carried mass along tool z by turning: -(w x z).v + l (w^2 - (w.z)^2) [m/s^2]."""
    v, w, R = m.twist[0:3], m.twist[3:6], m.rotation
    x, y, z = R[0, 2], R[1, 2], R[2, 2]
    about = w[0] * x + w[1] * y + w[2] * z
    across = w[0] * w[0] + w[1] * w[1] + w[2] * w[2] - about * about
    sideways = (w[1] * z - w[2] * y) * v[0] + (w[2] * x - w[0] * z) * v[1] + (w[0] * y - w[1] * x) * v[2]
    return float(g.mass_height * across - sideways)


@njit(cache=True)
def unknown_mass(g: AdaptiveGains) -> float:
    """Mass whose force stays in the reading, at worst [kg]: all of it without the law."""
    return g.mass * (g.mass_doubt if g.inertia > 0.0 else 1.0)
