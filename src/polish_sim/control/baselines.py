"""What the baselines share: a virtual mass pushed by the force error, and the loops around it."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import carray
from numpy.typing import NDArray

from polish_sim.config import ControllerConfig
from polish_sim.control.hybrid import (
    GAINS_SIZE,
    STATE_SIZE,
    gains_of,
    hybrid_state_of,
    position_by_velocity,
    position_gains,
    replace_along_z,
    turn_and_level,
)
from polish_sim.control.signals import (
    ANSWER_SIZE,
    LAW_SIGNATURE,
    MEASUREMENT_SIZE,
    TARGET_SIZE,
    CompiledController,
    Measurement,
    Target,
    measurement_of,
    target_of,
)
from polish_sim.kernel_cache import cfunc, njit

Array = NDArray[np.float64]

OWN_GAINS, OWN_MEMORY = 8, 8
MEMORY = STATE_SIZE + OWN_MEMORY
BASELINE_SIZE = GAINS_SIZE + OWN_GAINS + MEMORY
"""Length of a baseline's context: gains of the loops around it, its own, memory of the loops, its own."""

VELOCITY, OFFSET, STARTED = 0, 1, 2


class VirtualMass(NamedTuple):
    """M dv/dt + D v + K x = Fd - Fe: velocity v and offset x answer the force error."""

    mass: float
    """M [kg]."""
    damping: float
    """D [N s/m]."""
    stiffness: float
    """K [N/m], 0 for none."""
    limit: float
    """Largest speed [m/s]."""


def baseline_gains(config: ControllerConfig, own: tuple[float, ...]) -> Array:
    """Gains of the loops around the law and its own, shape (24,)."""
    return np.concatenate([gains_of(config), own, np.zeros(OWN_GAINS - len(own))])


@njit(cache=True)
def own_gains(context: Array) -> Array:
    """A law's own gains, shape (8,)."""
    return context[GAINS_SIZE : GAINS_SIZE + OWN_GAINS]


@njit(cache=True)
def virtual_mass(context: Array) -> VirtualMass:
    """The virtual mass of a law whose own gains it is."""
    own = own_gains(context)
    return VirtualMass(own[0], own[1], own[2], own[3])


@njit(cache=True)
def own_memory(context: Array) -> Array:
    """A law's own memory, all zero after a reset, shape (8,)."""
    return context[GAINS_SIZE + OWN_GAINS + STATE_SIZE :]


@njit(cache=True)
def speed_along_z(m: Measurement) -> float:
    """The tool's measured speed along its axis [m/s]: a virtual mass starts with it."""
    z = m.rotation[:, 2]
    return float(z[0] * m.twist[0] + z[1] * m.twist[1] + z[2] * m.twist[2])


@njit(cache=True)
def push(body: VirtualMass, error: float, dt: float, memory: Array) -> float:
    """Push a virtual mass by the force error for one step.

    The damper is taken at the end of the step, so that no damping is too much for it.

    Args:
        body: The mass.
        error: Fd - Fe [N].
        dt: Step [s].
        memory: Its velocity [m/s] and offset [m] first.

    Returns:
        Its velocity [m/s].
    """
    speed = (body.mass * memory[VELOCITY] + (error - body.stiffness * memory[OFFSET]) * dt) / (
        body.mass + body.damping * dt
    )
    memory[VELOCITY] = min(max(speed, -body.limit), body.limit)
    memory[OFFSET] += memory[VELOCITY] * dt
    return float(memory[VELOCITY])


@njit(cache=True)
def move_around(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Everything but tool z as ``hybrid-pi`` does it: position by eq. 6, orientation by eq. 7, moment about tool y."""
    state = hybrid_state_of(context[GAINS_SIZE + OWN_GAINS :])
    dt = m.clock[1]
    position_by_velocity(m, t, position_gains(context), dt, state, twist)
    turn_and_level(context, dt, m, t, state, twist)


# Controller ``admittance``: a virtual mass and damper driven by the force error, M dv/dt + D v = Fd - Fe.
#
# The law of most cobot force modes and of ROS's compliance controllers. Its gains follow from the nominal cell: M is
# twice the mass the wrist sensor feels (the felt inertia then has a loop gain of at most 1/2), D damps M critically on
# the nominal springs, D = 2 sqrt(k M). No spring: on a resting part the error goes to zero, on a ramp of normal speed u
# the error D u stays.


@njit(cache=True)
def step_admittance(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``admittance``; until contact the tool moves by position."""
    move_around(context, m, t, twist)
    memory = own_memory(context)
    if t.contact[0] == 0.0:
        memory[STARTED] = 0.0
        return
    if memory[STARTED] == 0.0:
        memory[STARTED], memory[VELOCITY] = 1.0, speed_along_z(m)
    rate = push(virtual_mass(context), t.force[0] - m.wrench[2], m.clock[1], memory)
    replace_along_z(m, rate, twist)


@cache
def admittance_law() -> Any:
    """Compiled entry of ``admittance``, made at first use."""

    @cfunc(LAW_SIGNATURE)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_admittance(carray(context, BASELINE_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


def admittance(config: ControllerConfig) -> CompiledController:
    """Admittance control along tool z."""
    body = VirtualMass(config.baselines.mass_kg, config.baselines.damping_n_s_m, 0.0, config.force_limit_m_s)
    return CompiledController(baseline_gains(config, body), MEMORY, step_admittance, admittance_law)


# Controller ``impedance-position``: position control to the planned depth that gives way like a spring.
#
# The offset x from the planned place follows M d2x/dt2 + D dx/dt + K x = Fd - Fe, the position loop follows the plan
# with that offset. M and D are those of ``admittance``; K is a fifth of the nominal springs k, so that of the force a
# part in the wrong place would cause under position control K / (K + k), a sixth, stays for good.


@njit(cache=True)
def step_impedance_position(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``impedance-position``; until contact the tool moves by position."""
    move_around(context, m, t, twist)
    body, memory, z = virtual_mass(context), own_memory(context), m.rotation[:, 2]
    if t.contact[0] == 0.0:
        memory[STARTED] = 0.0
        return
    planned = short = 0.0
    for i in range(3):
        planned += z[i] * t.twist[i]
        short += z[i] * (t.position[i] - m.position[i])
    if memory[STARTED] == 0.0:
        # Bumpless: where the tool is, as fast as it is.
        memory[STARTED], memory[VELOCITY], memory[OFFSET] = 1.0, speed_along_z(m) - planned, -short
    given_way = push(body, t.force[0] - m.wrench[2], m.clock[1], memory)
    rate = planned + given_way + (short + memory[OFFSET]) / position_gains(context).look_ahead
    replace_along_z(m, min(max(rate, -body.limit), body.limit), twist)


@cache
def impedance_position_law() -> Any:
    """Compiled entry of ``impedance-position``, made at first use."""

    @cfunc(LAW_SIGNATURE)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_impedance_position(carray(context, BASELINE_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


def impedance_position(config: ControllerConfig) -> CompiledController:
    """Position-based impedance control along tool z."""
    own = config.baselines
    body = VirtualMass(own.mass_kg, own.damping_n_s_m, own.stiffness_n_m, config.force_limit_m_s)
    return CompiledController(baseline_gains(config, body), MEMORY, step_impedance_position, impedance_position_law)


# Controller ``force-mode``: behaves like a UR robot's own force mode, as far as that is public.
#
# Public (manual of URScript, documentation of the ROS driver): the mode runs in the robot at 500 Hz; compliant axes are
# chosen by a selection vector and limited in speed; a damping from 0 (keeps its speed where nothing presses) to 1
# (comes to rest at once), by default 0.025; a gain scaling from 0 to 2, by default 0.5, which above 1 may be unstable
# on hard surfaces. A law that keeps its speed is a mass pushed by the force error, so this one is
#
#     v <- (1 - damping) v + scaling / M (Fd - Fe) h        every h = 2 ms.
#
# Ours, not public: that the damping counts per step; M, the mass at a scaling of 1, taken as what the arm itself weighs
# along the tool axis (lighter than itself an arm cannot be made to feel without feeding energy in, which fits the
# warning about scalings above 1); the mean of the readings since the last step as its filter. The real mode has no
# latency of a host between itself and the servos; here it answers through the same speedl as all others.

STEP_S = 0.002
"""The mode's own cycle [s]."""
PASSED, SUM, READINGS = 3, 4, 5


class ModeGains(NamedTuple):
    """What the mode is told."""

    mass: float
    """Virtual mass M / scaling [kg]."""
    damping: float
    """Share of the speed lost per step [-]."""
    limit: float
    """Largest speed [m/s]."""


@njit(cache=True)
def mode_speed(error: float, dt: float, gains: ModeGains, memory: Array) -> float:
    """Speed of the mode, renewed every 2 ms and held in between.

    Args:
        error: Fd - Fe [N].
        dt: Control cycle [s].
        gains: The mode's gains.
        memory: Speed, and what came in since the last step.

    Returns:
        The speed [m/s].
    """
    memory[PASSED] += dt
    memory[SUM] += error
    memory[READINGS] += 1.0
    if memory[PASSED] >= STEP_S - 1e-9:
        push = memory[SUM] / memory[READINGS] * memory[PASSED] / gains.mass
        kept = (1.0 - gains.damping) ** (memory[PASSED] / STEP_S)
        memory[VELOCITY] = min(max(kept * memory[VELOCITY] + push, -gains.limit), gains.limit)
        memory[PASSED] = memory[SUM] = memory[READINGS] = 0.0
    return float(memory[VELOCITY])


@njit(cache=True)
def step_force_mode(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``force-mode``; until contact the tool moves by position."""
    move_around(context, m, t, twist)
    own, memory = own_gains(context), own_memory(context)
    if t.contact[0] == 0.0:
        memory[STARTED] = 0.0
        return
    if memory[STARTED] == 0.0:
        memory[STARTED], memory[VELOCITY] = 1.0, speed_along_z(m)
        memory[PASSED] = memory[SUM] = memory[READINGS] = 0.0
    gains = ModeGains(own[0], own[1], own[2])
    replace_along_z(m, mode_speed(t.force[0] - m.wrench[2], m.clock[1], gains, memory), twist)


@cache
def force_mode_law() -> Any:
    """Compiled entry of ``force-mode``, made at first use."""

    @cfunc(LAW_SIGNATURE)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_force_mode(carray(context, BASELINE_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


def force_mode(config: ControllerConfig) -> CompiledController:
    """A robot's own force mode along tool z."""
    mode = config.baselines
    gains = ModeGains(mode.mode_mass_kg / mode.mode_gain_scaling, mode.mode_damping, config.force_limit_m_s)
    return CompiledController(baseline_gains(config, gains), MEMORY, step_force_mode, force_mode_law)
