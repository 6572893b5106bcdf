"""The force loop: crossover and observer from stiffness, delay, noise and unknown mass; the observer itself.

The tool's travel z is known at once and almost exactly, the force late and noisy. Between two readings the
force changes by k z, so the observer keeps what the travel does not explain, b (where the part is, in
newtons), and its rate r (a part that rises or sinks):

    F = b + k z,    e = reading - own forces - (b + k z as sensed),    db/dt = r + 2 w_o e
    dr/dt = w_o^2 e.

The command is u = w_c ((F_set - F) / k - travel under way) - r / k. With the right k the loop is an
integrator on the encoders, w_c / s with the command's delay taken out by the travel under way. A resting part
leaves no error; one that rises at a speed v leaves k v T, T the lags of command and sensor (0.2 N at 4 mm/s):
to extrapolate it costs a tenth more noise and half the damping on soft springs at 20 ms. A limited command
winds nothing up, because the observer sees the travel that was really done.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from polish_sim.control.adaptive.gains import LINE, AdaptiveGains, PressMemory
from polish_sim.control.loops import low_pass_step
from polish_sim.kernels import kernel

_MASS_SHARE = 0.5  # of its command the loop may feed back through unknown inertia
_NOISE_POWER = 0.6  # the observer slows with noise to this power
_FIRST_CORNER = 100.0  # of the observer at first touch [rad/s]
_FIRST_TIME = 0.03  # in which it comes down [s]


class LoopSpeed(NamedTuple):
    """How fast the loop may be."""

    crossover: float  #: w_c [rad/s]
    observer: float  #: w_o [rad/s]
    first: float  #: w_o as it is now, quicker at first touch [rad/s]


@kernel
def pace_of(g: AdaptiveGains, stiffness: float, delay: float, noise: float, age: float) -> LoopSpeed:
    """Crossover and observer corner the loop can afford.

    w_c delay <= ``delay_share``; 2 w_c w_o m / k <= 1/2 for a mass m that may be unaccounted for; w_o falls
    with ``noise``, the deviation of a reading in the air [N]. At first, by ``age`` since contact [s], the
    observer of b is quick, that of its rate is not: the arm swings as it touches, and no part rises so.
    """
    crossover = min(g.crossover_rad_s, g.delay_share / delay)
    observer = g.observer_rad_s * min(1.0, (g.usual_noise_n / max(noise, 1e-3)) ** _NOISE_POWER)
    # The mass whose force stays in the reading, at worst: all of it without the law.
    unknown_mass = g.tool_mass_kg * (g.tool_mass_doubt if g.inertia else 1.0)
    most = 0.5 * _MASS_SHARE * stiffness / unknown_mass
    slower = math.sqrt(min(1.0, most / (crossover * observer)))
    crossover, observer = slower * crossover, slower * observer
    first = observer
    if g.touch_down:
        first += (slower * _FIRST_CORNER - observer) * math.exp(-age / _FIRST_TIME)
    return LoopSpeed(crossover, observer, first)


@kernel
def begin_contact(memory: PressMemory, stiffness: float, path: float, force: float) -> None:
    """Start the observer at what is read: travel ``path`` [m] as sensed, ``force`` [N]."""
    state = memory.force
    state.at_no_travel = force - stiffness * path
    state.stiffness = stiffness
    state.rate = state.landed = state.age = 0.0
    state.slow = state.at_no_travel
    state.swing = 0.0


@kernel
def change_stiffness(memory: PressMemory, stiffness: float, path: float) -> None:
    """Believe another stiffness [N/m] without a jump of what the sensor should show at travel ``path``
    [m]."""
    state = memory.force
    more = (stiffness - state.stiffness) * path
    state.slow -= more
    state.at_no_travel -= more
    state.stiffness = stiffness


@kernel
def observe_force(memory: PressMemory, pace: LoopSpeed, path: float, reading: float, dt: float) -> None:
    """Take in one ``reading`` [N], less the tool's own forces, at travel ``path`` [m] as sensed; the rate is
    learned as far as the landing is over."""
    state = memory.force
    surprise = reading - (state.at_no_travel + state.stiffness * path)
    state.at_no_travel += dt * (state.rate + 2.0 * pace.first * surprise)
    state.rate += dt * state.landed * pace.observer * pace.observer * surprise


# The arm swings on its gears, the encoders of its motors hardly: the law ``inertia`` does not know of it, and
# of the tool's swinging mass the observer makes a force. 2 w_c w_o m / k of the command, times the resonance,
# comes back with the command's sign turned round. Nothing else has to be known fast there: a notch takes it
# out of b + r / w_c, which is what the sensor adds to the travel. Ramps pass late by 2 / w, which the rate
# makes up for.


@kernel
def correction(memory: PressMemory, arm_mode: float, crossover: float, dt: float) -> float:
    """What is added to k z [N]: b and, as far as the landing is over, its rate's share, without the arm's
    vibration [rad/s]."""
    state = memory.force
    turn = arm_mode * dt
    lead = 1.0 / crossover + (2.0 / arm_mode if arm_mode > 0.0 else 0.0)
    added = state.at_no_travel + lead * state.landed * state.rate
    state.swing = (state.swing + turn * (added - state.slow)) / (1.0 + turn) ** 2
    state.slow += turn * state.swing
    return float(added - 2.0 * state.swing)


# The command's delay, measured on the way down, and the travel that is under way because of it.
#
# At a steady speed u the tool lags behind the commands by u tau, whatever tau is made of (network, robot,
# servo): tau = (sum of the commands - travel done) / u, exact with encoders alone. While the loop runs, what
# was commanded in the last tau seconds is on its way: the loop counts it as done (a Smith predictor for an
# integrator).

_REST = 2e-4  # slower than this the tool is at rest [m/s]
_SLOWEST = 1e-3  # command from which the delay is measured [m/s]
_STEADY = 0.1  # a command this near its low-passed self is steady [-]


@kernel
def measure_delay(g: AdaptiveGains, memory: PressMemory, speed: float, dt: float) -> None:
    """Watch the tool follow its commands in free space; ``speed`` along tool z [m/s]."""
    delay = memory.delay
    command = delay.last_command
    if abs(speed) < _REST and abs(command) < _REST:
        delay.behind, delay.slowed = 0.0, command
        return
    delay.behind += (command - speed) * dt
    delay.slowed += (command - delay.slowed) * dt / 0.03
    if abs(command) > _SLOWEST and abs(delay.slowed - command) < _STEADY * abs(command):
        seen = min(max(delay.behind / command, 0.3 * g.command_delay_s), 3.0 * g.command_delay_s)
        delay.delay += (seen - delay.delay) * dt / 0.05


@kernel
def remember_command(memory: PressMemory, speed: float) -> None:
    """Note the speed commanded along tool z this cycle [m/s]."""
    delay = memory.delay
    delay.sent[delay.at] = delay.last_command = speed
    delay.at = (delay.at + 1) % LINE


@kernel
def under_way(memory: PressMemory, dt: float) -> float:
    """Travel along tool z that is commanded and not yet done [m]."""
    delay = memory.delay
    total = 0.0
    for back in range(1, min(math.floor(delay.delay / dt + 0.5), LINE - 1) + 1):
        total += delay.sent[(delay.at - back) % LINE]
    return total * dt


# Filters of known phase cost: what the host knows is shown to it as late and as smooth as the force.
#
# The wrist sensor low-passes the force (80 Hz) and delivers it 2 ms late, about 4 ms of lag in all. Instead
# of filtering the force still more and paying for it in phase, everything it is compared with, the tool's
# travel and the tool's own forces, goes through a copy of that filter. What is compared then belongs to the
# same instant; no loop is closed on the filtered signal alone, so the filter costs no phase.


class Sensed(NamedTuple):
    """Two signals as the sensor would show them now."""

    path: float  #: Travel into the part [m]
    own: float  #: The tool's own forces [N]


@kernel
def as_sensed(g: AdaptiveGains, memory: PressMemory, path: float, own: float, dt: float) -> Sensed:
    """Pass travel [m] and own forces [N] through the believed low-pass and latency of the sensor."""
    sensed, here = memory.sensed, memory.sensed.at
    sensed.path = low_pass_step(sensed.path, path, g.sensor_bandwidth_hz, dt)
    sensed.force = low_pass_step(sensed.force, own, g.sensor_bandwidth_hz, dt)
    sensed.paths[here], sensed.forces[here] = sensed.path, sensed.force
    late = min(math.floor(g.sensor_latency_s / dt + 0.5), LINE - 1)
    then = (here - late) % LINE
    sensed.at = (here + 1) % LINE
    return Sensed(sensed.paths[then], sensed.forces[then])
