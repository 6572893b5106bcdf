"""The watch over hand guiding: speed limits, and a budget of energy the compensation may lend.

Friction compensation that gives back no more than friction took, and inertia compensation that is paid back when the
arm slows down, are passive. What was lent beyond that is counted; no more than the budget is ever owed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from polish_sim.arrays import Array
from polish_sim.hand_guiding.law import Belief, GuidingGains, GuidingMemory
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record

JOINT_SPEED, TOOL_SPEED, ENERGY, UNSTABLE, TOUCH, JOINT_END = 1, 2, 3, 4, 5, 6
GUARDS: Final[Mapping[int, str]] = MappingProxyType(
    {
        JOINT_SPEED: "a joint is faster than guide.joint_speed_limit_rad_s",
        TOOL_SPEED: "the tool is faster than guide.tool_speed_limit_m_s",
        ENERGY: "the compensation has lent more energy than guide.energy_limit_j: it drives the arm by itself",
        UNSTABLE: "the simulation is unstable: lower simulation.timestep_s",
        TOUCH: "links touch",
        JOINT_END: "a joint is at its end",
    }
)
"""Reasons of a protective stop, by code."""
FADE_FROM: Final = 0.9
"""Share of a speed limit from which compensation fades, so that the joints' own friction brakes [-]."""


class Lent(Record):
    """Energy the compensation has lent [J]."""

    now: float
    most: float  #: Largest value so far


class GuidingLimits(NamedTuple):
    """What is never exceeded for long."""

    joint_speed: float  #: [rad/s]
    tool_speed: float  #: [m/s]
    energy: float  #: [J]
    lent: Lent  #: Memory


@njit(cache=True, error_model="numpy", forceinline=True)
def fade_out(limits: GuidingLimits, qd: Array, tool_speed: float) -> float:
    """Share of the compensation granted at these speeds, 1 to 0."""
    near = tool_speed / limits.tool_speed
    for j in range(qd.shape[0]):
        near = max(near, abs(qd[j]) / limits.joint_speed)
    return min(max((1.0 - near) / (1.0 - FADE_FROM), 0.0), 1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def watch_guiding(
    limits: GuidingLimits, belief: Belief, gains: GuidingGains, memory: GuidingMemory, tool_speed: float, dt: float
) -> int:
    """Add the energy lent in a step to ``limits.lent``; returns the code of the guard that stops the arm, or 0.

    ``memory``: after the law's step; ``tool_speed``: of the tool point [m/s].
    """
    power, code = 0.0, 0
    for j in range(memory.qd.shape[0]):
        qd = memory.qd[j]
        lost = belief.coulomb[j] * math.tanh(qd / gains.sign_speed) + belief.viscous[j] * qd
        carried = gains.gravity * (memory.weight[j] + gains.tare * memory.tare[j])
        power += qd * (memory.torque[j] - carried - lost)
        if abs(qd) > limits.joint_speed:
            code = JOINT_SPEED
    limits.lent.now = max(limits.lent.now + dt * power, 0.0)
    limits.lent.most = max(limits.lent.most, limits.lent.now)
    if tool_speed > limits.tool_speed:
        code = TOOL_SPEED
    if limits.lent.now > limits.energy:
        code = ENERGY
    return code
