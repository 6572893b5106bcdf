"""The command's delay, measured on the way down, and the travel that is under way because of it (layer 7).

At a steady speed u the tool lags behind the commands by u tau, whatever tau is made of (network, robot, servo):
tau = (sum of the commands - travel done) / u, exact with encoders alone. While the loop runs, what was commanded in
the last tau seconds is on its way: the loop counts it as done (a Smith predictor for an integrator).
"""

from __future__ import annotations

import math

from numba import njit

from polish_sim.control.adaptive.gains import AdaptiveGains
from polish_sim.control.adaptive.memory import BEHIND, DELAY, LAST_COMMAND, LINE, SENT_AT, SLOWED, PressMemory

_REST = 2e-4  # slower than this the tool is at rest [m/s]
_SLOWEST = 1e-3  # command from which the delay is measured [m/s]
_STEADY = 0.1  # a command this near its low-passed self is steady [-]


@njit(cache=True)
def expect_delay(g: AdaptiveGains, memory: PressMemory) -> None:
    """Believe the configured delay until one has been measured."""
    if memory.delay[DELAY] == 0.0:
        memory.delay[DELAY] = g.command_delay


@njit(cache=True)
def measure_delay(g: AdaptiveGains, memory: PressMemory, speed: float, dt: float) -> None:
    """Watch the tool follow its commands in free space; ``speed`` along tool z [m/s]."""
    delay = memory.delay
    command = delay[LAST_COMMAND]
    if abs(speed) < _REST and abs(command) < _REST:
        delay[BEHIND], delay[SLOWED] = 0.0, command
        return
    delay[BEHIND] += (command - speed) * dt
    delay[SLOWED] += (command - delay[SLOWED]) * dt / 0.03
    if abs(command) > _SLOWEST and abs(delay[SLOWED] - command) < _STEADY * abs(command):
        seen = min(max(delay[BEHIND] / command, 0.3 * g.command_delay), 3.0 * g.command_delay)
        delay[DELAY] += (seen - delay[DELAY]) * dt / 0.05


@njit(cache=True)
def remember_command(memory: PressMemory, speed: float) -> None:
    """Note the speed commanded along tool z this cycle [m/s]."""
    here = int(memory.line[SENT_AT])
    memory.sent[here] = speed
    memory.line[SENT_AT] = (here + 1) % LINE
    memory.delay[LAST_COMMAND] = speed


@njit(cache=True)
def under_way(memory: PressMemory, dt: float) -> float:
    """Travel along tool z that is commanded and not yet done [m]."""
    here = int(memory.line[SENT_AT])
    total = 0.0
    for back in range(1, min(math.floor(memory.delay[DELAY] / dt + 0.5), LINE - 1) + 1):
        total += memory.sent[(here - back) % LINE]
    return total * dt
