"""Margins of a loop from its frequency response, and force gains designed for a margin.

Everything here is numpy on a few hundred frequencies: fast enough for a controller that designs itself at its start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.scoring.loop_model import Complex, LinearLaw, LoopSetup, build_plant, plant_response

NYQUIST = 3141.0  #: Highest frequency a host at 1 kHz can act at [rad/s]
Response = Callable[[Array], Complex]  #: Open loop L(j omega) of frequencies (n,) [rad/s]; the closed loop is 1 + L = 0


class Margins(NamedTuple):
    """How far a stable loop is from its border."""

    gain: float  #: The loop's gain may grow by this factor [-]
    phase: float  #: The loop may lag this much more at any crossover [rad]
    delay: float  #: The loop may be this much later [s]
    crossover: float  #: Highest frequency at which the loop's gain is one [rad/s]; NaN when it never is
    phase_crossover: float  #: Frequency at which it would oscillate if the gain grew [rad/s]; NaN when it never would


class ForceGains(NamedTuple):
    """Gains of a force loop by velocity, and what they leave."""

    p: float  #: [m/(s N)]
    i: float  #: [m/(s^2 N)]
    margins: Margins


def margins(loop: Response) -> Margins:
    """Gain, phase and delay margin of a stable loop from its open-loop response, 0.1 rad/s to the host's Nyquist
    frequency; infinite without a crossover of that kind.
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


def pi_on_spring(
    p: float, i: float, stiffness: float, delay: float, filters_hz: Sequence[float] = (), felt_mass: float = 0.0
) -> Response:
    """Open loop of a PI law that presses a spring by velocity: L = (p + i/s) (k/s + m s) e^(-s delay) / prod(1 + s/w).

    Args:
        p: [m/(s N)].
        i: [m/(s^2 N)].
        stiffness: k, of all springs in series [N/m].
        delay: From command to motion and from force to reading, together [s].
        filters_hz: Corners of the first-order low-passes in the loop [Hz].
        felt_mass: m, the inertia the force sensor reads besides the contact force [kg].
    """

    def response(omega: Array) -> Complex:
        s = 1j * omega
        loop = (p + i / s) * (stiffness / s + felt_mass * s) * np.exp(-s * delay)
        for corner in filters_hz:
            loop = loop / (1.0 + s / (2.0 * math.pi * corner))
        return loop

    return response


def design_gains(
    stiffness: float,
    delay: float,
    filters_hz: Sequence[float] = (80.0,),
    phase_margin: float = math.radians(60.0),
    integral_lag: float = math.radians(10.0),
    gain_margin: float = 2.0,
    felt_mass: float = 0.0,
) -> ForceGains:
    """Fastest PI gains on a spring that leave the margins asked for.

    The crossover w solves pi/2 - integral_lag - w delay - sum atan(w / w_filter) = phase_margin; the integral's corner
    i/p = w tan(integral_lag) costs the lag set aside for it; p makes the loop's gain one at w. The gain margin is kept
    at *every* frequency past the first phase crossover: inertia felt by the sensor raises the gain there, and the
    phase of so late a loop is not to be relied on.

    Args:
        stiffness: Of all springs in series [N/m].
        delay: Pure delay in the loop, the servo's lag included [s].
        filters_hz: Corners of the first-order low-passes in the loop [Hz].
        phase_margin: Wanted at least [rad].
        integral_lag: Phase given to the integral at the crossover [rad].
        gain_margin: Wanted at least [-].
        felt_mass: Uncompensated inertia seen by the force sensor [kg].

    Returns:
        The gains and their margins.
    """
    corners = [2.0 * math.pi * f for f in filters_hz]
    budget = 0.5 * math.pi - integral_lag - phase_margin
    low, high = 0.0, budget / max(delay, 1e-5)
    for _ in range(60):
        w = 0.5 * (low + high)
        lag = w * delay + sum(math.atan(w / c) for c in corners)
        low, high = (w, high) if lag < budget else (low, w)
    for _ in range(8):
        i_per_p = w * math.tan(integral_lag)
        shape = pi_on_spring(1.0, i_per_p, stiffness, delay, filters_hz, felt_mass)
        wanted, most = 1.0 / float(np.abs(shape(np.array([w])))[0]), 0.99 * _largest_gain(shape, w) / gain_margin
        p, i = min(wanted, most), min(wanted, most) * i_per_p
        if wanted <= most:
            break
        w = min(w, p * stiffness)
    return ForceGains(p, i, margins(pi_on_spring(p, i, stiffness, delay, filters_hz, felt_mass)))


def _largest_gain(shape: Response, lowest: float) -> float:
    """Factor that brings a loop to one at its highest gain from its first phase crossover on; inf without one."""
    omega = np.geomspace(lowest, NYQUIST, 600)
    response = shape(omega)
    late = np.flatnonzero(np.unwrap(np.angle(response)) <= -math.pi)
    return 1.0 / float(np.abs(response[late[0] :]).max()) if len(late) else math.inf


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
    """Upper half of the circle |z| = exp(SLOWEST dt), which keeps clear of the integrators at z = 1, shape (n,)."""
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
    """Share a latency [s] between sensor and command as the default cell does (8 = 2 + 6 ms), in whole milliseconds."""
    sensor_ms = max(round(250.0 * total), SHORTEST_SENSOR_MS)
    return Latency(sensor_ms / 1000.0, max(round(1000.0 * total) - sensor_ms, 0) / 1000.0)


def with_latency(setup: LoopSetup, latency: Latency) -> LoopSetup:
    """The same loop with other latencies."""
    return setup._replace(
        command_steps=round(latency.command / setup.dt), sensor_steps=max(0, round(latency.sensor / setup.dt) - 1)
    )


def with_springs(setup: LoopSetup, scale: float) -> LoopSetup:
    """The same loop with the springs of head and pad ``scale`` times as stiff."""
    return setup._replace(head_stiffness=scale * setup.head_stiffness, pad_stiffness=scale * setup.pad_stiffness)


def longest_latency(setup: LoopSetup, law: LinearLaw, totals: Sequence[float]) -> float:
    """The last of rising total latencies [s] before the first unstable one; 0 if none, infinite if all are stable."""
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
