"""Filters of known phase cost: what the host knows is shown to it as late and as smooth as the force (layer 7).

The wrist sensor low-passes the force (80 Hz) and delivers it 2 ms late, about 4 ms of lag in all. Instead of filtering
the force still more and paying for it in phase, everything it is compared with, the tool's travel and the tool's own
forces, goes through a copy of that filter. What is compared then belongs to the same instant; no loop is closed on the
filtered signal alone, so the filter costs no phase.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from polish_sim.control.adaptive.gains import AdaptiveGains
from polish_sim.control.adaptive.memory import LINE, SENSED_AT, SENSED_OWN, SENSED_PATH, PressMemory
from polish_sim.control.filters import low_pass_step


class Sensed(NamedTuple):
    """Two signals as the sensor would show them now."""

    path: float
    """Travel into the part [m]."""
    own: float
    """The tool's own forces [N]."""


@njit(cache=True)
def as_sensed(g: AdaptiveGains, memory: PressMemory, path: float, own: float, dt: float) -> Sensed:
    """Pass travel [m] and own forces [N] through the believed low-pass and latency of the sensor."""
    line = memory.line
    line[SENSED_PATH] = low_pass_step(line[SENSED_PATH], path, g.sensor_hz, dt)
    line[SENSED_OWN] = low_pass_step(line[SENSED_OWN], own, g.sensor_hz, dt)
    here = int(line[SENSED_AT])
    memory.path_line[here], memory.own_line[here] = line[SENSED_PATH], line[SENSED_OWN]
    late = min(math.floor(g.sensor_latency / dt + 0.5), LINE - 1)
    then = (here - late) % LINE
    line[SENSED_AT] = (here + 1) % LINE
    return Sensed(memory.path_line[then], memory.own_line[then])
