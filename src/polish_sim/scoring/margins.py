"""Whether a modelled force loop is stable, and up to which latency."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.scoring.loop_model import Complex, LinearLaw, LoopSetup, build_plant, plant_response

# Eigenvalues where the law has a state space, else Nyquist.

Loop = Callable[[Complex], Complex]  #: Open loop L(z), closed by 1 + L = 0
SLOWEST = 0.2  #: Modes that grow more slowly count as stable [1/s]


def force_loop(setup: LoopSetup, law: LinearLaw) -> Loop:
    """Open loop L(z) of plant, latencies and law, cut at the command."""
    plant = build_plant(setup)

    def loop(z: Complex) -> Complex:
        reading = plant_response(plant, plant.reading, z) * z ** float(-setup.sensor_steps)
        velocity = plant_response(plant, plant.velocity, z)
        return -(law.by_force(z) * reading + law.by_motion(z) * velocity) * z ** float(-setup.command_steps)

    return loop


def contour(dt: float) -> Complex:
    """Upper half of the circle |z| = exp(SLOWEST dt), which keeps clear of the integrators at z = 1, shape
    (n,)."""
    omega = np.concatenate([[0.0], np.geomspace(1e-2, math.pi / dt, 1200)])
    return np.exp((SLOWEST + 1j * omega) * dt)


def turns_about_minus_one(response: Complex) -> int:
    """How often an open loop on ``contour`` and its mirror image goes clockwise around -1."""
    angle = np.unwrap(np.angle(1.0 + response))
    return -round(2.0 * (angle[-1] - angle[0]) / (2.0 * math.pi))


# Up to which latency a force loop is stable, by the linear model.

SHORTEST_SENSOR_MS = 1


class Latency(NamedTuple):
    """A total latency and how it is shared."""

    sensor: float  #: [s]
    command: float  #: [s]


def share_latency(total: float) -> Latency:
    """Share a latency [s] between sensor and command as the default cell does (8 = 2 + 6 ms), in whole
    milliseconds."""
    sensor_ms = max(round(250.0 * total), SHORTEST_SENSOR_MS)
    return Latency(sensor_ms / 1000.0, max(round(1000.0 * total) - sensor_ms, 0) / 1000.0)


def with_latency(setup: LoopSetup, latency: Latency) -> LoopSetup:
    """The same loop with other latencies."""
    return setup._replace(
        command_steps=round(latency.command / setup.dt),
        sensor_steps=max(0, round(latency.sensor / setup.dt) - 1),
    )


def with_springs(setup: LoopSetup, scale: float) -> LoopSetup:
    """The same loop with the springs of head and pad ``scale`` times as stiff."""
    return setup._replace(
        head_stiffness=scale * setup.head_stiffness, pad_stiffness=scale * setup.pad_stiffness
    )


def longest_latency(setup: LoopSetup, law: LinearLaw, totals: Sequence[float]) -> float:
    """The last of rising total latencies [s] before the first unstable one; 0 if none, infinite if all are
    stable."""
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
