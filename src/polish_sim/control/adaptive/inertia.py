"""Law ``inertia``: forces the sensor reads that no part exerts, from the tool's own motion (layer 7).

The wrist sensor carries the tool: it reads m dv/dt besides the contact. The head's damper presses c v into a part
while it moves. Both follow from the encoders: own = m dv/dt + c v, the damper's share through the pole of damper and
springs. Without the first a force loop of crossover w_c behind an observer w_o feeds 2 w_c w_o m / k of its command
back at any frequency, whatever the part: 0.64 with 2 kg, 5000 N/m and 20 rad/s each.
"""

from __future__ import annotations

import math

from numba import njit

from polish_sim.control.adaptive.gains import AdaptiveGains
from polish_sim.control.adaptive.memory import PressMemory


@njit(cache=True)
def own_force(g: AdaptiveGains, memory: PressMemory, speed: float, pressing: float, dt: float) -> float:
    """Force along tool z that the sensor reads from the tool's motion alone [N].

    Args:
        g: Mass, damper and its lag.
        memory: Last speed and the damper's.
        speed: Of the tool along its axis [m/s].
        pressing: Speed at which the head is pressed in, 0 in the air [m/s].
        dt: Control cycle [s].
    """
    motion = memory.motion
    acceleration = (speed - motion[0]) / dt if motion[1] > 0.0 else 0.0
    motion[0], motion[1] = speed, 1.0
    stiffer = max(memory.force[3] / g.stiffness, 0.05)
    motion[2] += (1.0 - math.exp(-dt * stiffer / g.damping_lag)) * (pressing - motion[2])
    return g.inertia * g.mass * acceleration + g.damping * motion[2]


@njit(cache=True)
def unknown_mass(g: AdaptiveGains) -> float:
    """Mass whose force stays in the reading, at worst [kg]: all of it without the law."""
    return g.mass * (g.mass_doubt if g.inertia > 0.0 else 1.0)
