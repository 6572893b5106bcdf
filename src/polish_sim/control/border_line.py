"""Up to which latency a force loop is stable, by the linear model (layer 7)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.control.linear_law import LinearLaw
from polish_sim.control.loop_model import Setup, build_plant, plant_response
from polish_sim.control.stability import contour, turns_about_minus_one

SHORTEST_SENSOR_MS = 1


class Latency(NamedTuple):
    """A total latency and how it is shared."""

    sensor: float
    """[s]"""
    command: float
    """[s]"""


def share_latency(total: float) -> Latency:
    """Share a latency [s] between sensor and command as the default cell does (8 = 2 + 6 ms), in whole milliseconds."""
    sensor_ms = max(round(250.0 * total), SHORTEST_SENSOR_MS)
    return Latency(sensor_ms / 1000.0, max(round(1000.0 * total) - sensor_ms, 0) / 1000.0)


def with_latency(setup: Setup, latency: Latency) -> Setup:
    """The same loop with other latencies."""
    return setup._replace(
        command_steps=round(latency.command / setup.dt), sensor_steps=max(0, round(latency.sensor / setup.dt) - 1)
    )


def with_springs(setup: Setup, scale: float) -> Setup:
    """The same loop with the springs of head and pad ``scale`` times as stiff."""
    return setup._replace(head_stiffness=scale * setup.head_stiffness, pad_stiffness=scale * setup.pad_stiffness)


def longest_latency(setup: Setup, law: LinearLaw, totals: Sequence[float]) -> float:
    """Latency up to which a loop is stable.

    Args:
        setup: Plant; its own latencies play no role.
        law: The law.
        totals: Total latencies to look at, increasing [s].

    Returns:
        The last one before the first unstable one [s]; 0 if the first is unstable already, infinite if all are stable.
    """
    z, plant = contour(setup.dt), build_plant(setup)
    force = law.by_force(z) * plant_response(plant, plant.reading, z)
    motion = law.by_motion(z) * plant_response(plant, plant.velocity, z)
    delay = np.log(z)
    longest = 0.0
    for total in totals:
        late = with_latency(setup, share_latency(total))
        loop = -(force * np.exp(-late.sensor_steps * delay) + motion) * np.exp(-late.command_steps * delay)
        if turns_about_minus_one(loop) > 0:
            return longest
        longest = total
    return math.inf
