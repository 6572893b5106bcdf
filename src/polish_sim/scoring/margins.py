"""Margins of a loop from its frequency response, whether it is stable, and up to which latency."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.scoring.loop_model import Complex, LinearLaw, LoopSetup, build_plant, plant_response

NYQUIST = 3141.0  #: Highest frequency a host at 1 kHz can act at [rad/s]
#: Open loop L(j omega) of frequencies (n,) [rad/s]; the closed loop is 1 + L = 0
Response = Callable[[Array], Complex]


class Margins(NamedTuple):
    """How far a stable loop is from its border."""

    gain: float  #: The loop's gain may grow by this factor [-]
    phase: float  #: The loop may lag this much more at any crossover [rad]
    delay: float  #: The loop may be this much later [s]
    crossover: float  #: Highest frequency at which the loop's gain is one [rad/s]; NaN when it never is
    #: Frequency at which it would oscillate if the gain grew [rad/s]; NaN when it never would
    phase_crossover: float


def margins(loop: Response) -> Margins:
    """Gain, phase and delay margin of a stable loop from its open-loop response, 0.1 rad/s to the host's
    Nyquist frequency; infinite without a crossover of that kind.
    """
    omega = np.geomspace(0.1, NYQUIST, 1500)
    response = loop(omega)
    size, phase = np.log(np.abs(response)), np.unwrap(np.angle(response))
    gains, phases, delays = [math.inf], [math.inf], [math.inf]
    crossover = phase_crossover = math.nan
    for k, share in _crossings(size):
        w = float(np.exp(_between(np.log(omega), k, share)))
        over = math.remainder(_between(phase, k, share) + math.pi, 2.0 * math.pi)
        phases.append(abs(over))
        delays.append((over if over >= 0.0 else over + 2.0 * math.pi) / w)
        crossover = w
    turns = (phase + math.pi) / (2.0 * math.pi)
    for whole in range(math.ceil(turns.min()), math.floor(turns.max()) + 1):
        for k, share in _crossings(turns - whole):
            gain = math.exp(-_between(size, k, share))
            if 1.0 < gain < min(gains):
                phase_crossover = float(np.exp(_between(np.log(omega), k, share)))
            if gain > 1.0:
                gains.append(gain)
    return Margins(min(gains), min(phases), min(delays), crossover, phase_crossover)


def _crossings(values: Array) -> list[tuple[int, float]]:
    """Rows before a change of sign and the share of the way to the next row at which it happens."""
    rows = np.flatnonzero(np.diff(np.signbit(values)))
    return [(int(k), float(values[k] / (values[k] - values[k + 1]))) for k in rows]


def _between(values: Array, k: int, share: float) -> float:
    return float(values[k] + share * (values[k + 1] - values[k]))


# Whether a modelled force loop is stable: eigenvalues where the law has a state space, else Nyquist.

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


def response_of(loop: Loop, dt: float) -> Response:
    """A loop over frequency [rad/s], as ``margins`` wants it."""
    return lambda omega: loop(np.exp(1j * omega * dt))


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
