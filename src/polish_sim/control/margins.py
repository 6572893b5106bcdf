"""Margins of a loop from its frequency response, and force gains designed for a margin (layer 7).

Everything here is numpy on a few hundred frequencies: fast enough for a controller that designs itself at its start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
NYQUIST = 3141.0
"""Highest frequency a host at 1 kHz can act at [rad/s]."""
Response = Callable[[Array], Complex]
"""Open loop L(j omega) of an array of frequencies [rad/s]; the closed loop is 1 + L = 0."""


class Margins(NamedTuple):
    """How far a stable loop is from its border."""

    gain: float
    """The loop's gain may grow by this factor [-]."""
    phase: float
    """The loop may lag this much more at any crossover [rad]."""
    delay: float
    """The loop may be this much later [s]."""
    crossover: float
    """Highest frequency at which the loop's gain is one [rad/s]; NaN when it never is."""
    phase_crossover: float
    """Frequency at which it would oscillate if the gain grew [rad/s]; NaN when it never would."""


class ForceGains(NamedTuple):
    """Gains of a force loop by velocity, and what they leave."""

    p: float
    """[m/(s N)]"""
    i: float
    """[m/(s^2 N)]"""
    margins: Margins


def margins(loop: Response, lowest: float = 0.1, highest: float = NYQUIST, points: int = 1500) -> Margins:
    """Gain, phase and delay margin of a loop that is stable as it stands.

    Args:
        loop: Its open-loop response.
        lowest: Where to begin looking [rad/s].
        highest: Where to end [rad/s]; below the Nyquist frequency of a sampled loop.
        points: Frequencies in between, evenly spaced in the logarithm.

    Returns:
        The margins; infinite where the loop has no crossover of that kind.
    """
    omega = np.geomspace(lowest, highest, points)
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

    Returns:
        The response.
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
        felt_mass: Inertia the force sensor reads and nobody takes off [kg].

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
