"""Baselines: a virtual mass or a robot's force mode along tool z, everything else as ``hybrid-pi`` does it."""

from __future__ import annotations

from numba import carray

from polish_sim.arrays import Array
from polish_sim.config import ControllerConfig
from polish_sim.control.hybrid import (
    HybridGains,
    HybridMemory,
    along_z,
    hybrid_gains,
    position_by_velocity,
    replace_along_z,
    turn_and_level,
)
from polish_sim.control.signals import (
    ANSWER,
    LAW_SIGNATURE,
    MEASUREMENT,
    TARGET,
    CompiledController,
    Measurement,
    Target,
)
from polish_sim.kernel_cache import cfunc
from polish_sim.kernels import Record, kernel


class VirtualMass(Record):
    """M dv/dt + D v + K x = Fd - Fe: velocity v and offset x answer the force error."""

    mass: float  #: M [kg]
    damping: float  #: D [N s/m]
    stiffness: float  #: K [N/m], 0 for none
    limit: float  #: Largest speed [m/s]


class ForceMode(Record):
    """Gains of the robot's force mode."""

    mass: float  #: Virtual mass M / scaling [kg]
    damping: float  #: Share of the speed lost per step [-]
    limit: float  #: Largest speed [m/s]


class BaselineGains(Record):
    """Gains of the loops around a law and its own."""

    hybrid: HybridGains
    body: VirtualMass
    mode: ForceMode


class BaselineMemory(Record):
    """All zero after a reset."""

    hybrid: HybridMemory
    velocity: float  #: [m/s]
    offset: float  #: [m]
    started: bool  #: In contact
    passed: float  #: Time since the mode's last step [s]
    sum: float  #: Of the force errors since [N]
    readings: int  #: Since then


class BaselineContext(Record):
    """What a law of this file reads and writes."""

    gains: BaselineGains
    memory: BaselineMemory


_CONTEXT = BaselineContext.dtype


@kernel
def push(body: VirtualMass, error: float, dt: float, memory: BaselineMemory) -> float:
    """Push a virtual mass by the force ``error`` Fd - Fe [N] for one step; its velocity [m/s].

    The damper is taken at the end of the step, so that no damping is too much for it.
    """
    speed = (body.mass * memory.velocity + (error - body.stiffness * memory.offset) * dt) / (
        body.mass + body.damping * dt
    )
    memory.velocity = min(max(speed, -body.limit), body.limit)
    memory.offset += memory.velocity * dt
    return memory.velocity


@kernel
def _begin(c: BaselineContext, m: Measurement, t: Target, out: Array) -> bool:
    """Everything but tool z, by ``hybrid-pi``'s loops; until contact tool z by position, too.

    Whether the force is to be controlled; at contact the law starts with the tool's measured speed along its axis.
    """
    gains, memory, dt = c.gains.hybrid, c.memory, m.clock[1]
    position_by_velocity(m, t, gains.position, dt, memory.hybrid, out)
    turn_and_level(m, t, gains, dt, memory.hybrid, out)
    if t.contact[0] == 0.0:
        memory.started = False
        return False
    if not memory.started:
        memory.velocity = along_z(m, m.twist)
        memory.offset = memory.passed = memory.sum = 0.0
        memory.readings = 0
    return True


# Controller ``admittance``: a virtual mass and damper driven by the force error, M dv/dt + D v = Fd - Fe.
#
# The law of most cobot force modes and of ROS's compliance controllers. Its gains follow from the nominal cell: M is
# twice the mass the wrist sensor feels (the felt inertia then has a loop gain of at most 1/2), D damps M critically on
# the nominal springs, D = 2 sqrt(k M). No spring: on a resting part the error goes to zero, on a ramp of normal speed u
# the error D u stays.


@cfunc(LAW_SIGNATURE)
def _admittance_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    c, out = carray(context, 1, _CONTEXT)[0], carray(answer, 1, ANSWER)[0]
    m, t = carray(measurement, 1, MEASUREMENT)[0], carray(target, 1, TARGET)[0]
    if _begin(c, m, t, out.twist):
        c.memory.started = True
        replace_along_z(m, push(c.gains.body, t.force[0] - m.wrench[2], m.clock[1], c.memory), out.twist)


def admittance(config: ControllerConfig) -> CompiledController:
    """Admittance control along tool z."""
    body = VirtualMass(config.baselines.mass_kg, config.baselines.damping_n_s_m, 0.0, config.force_limit_m_s)
    gains = BaselineGains(hybrid=hybrid_gains(config), body=body)
    return CompiledController(BaselineContext(gains), _admittance_law)


# Controller ``impedance-position``: position control to the planned depth, compliant like a spring.
#
# The offset x from the planned place follows M d2x/dt2 + D dx/dt + K x = Fd - Fe, the position loop follows the plan
# with that offset. M and D are those of ``admittance``; K is a fifth of the nominal springs k, so that of the force a
# part in the wrong place would cause under position control K / (K + k), a sixth, stays for good.


@cfunc(LAW_SIGNATURE)
def _impedance_position_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    c, out = carray(context, 1, _CONTEXT)[0], carray(answer, 1, ANSWER)[0]
    m, t = carray(measurement, 1, MEASUREMENT)[0], carray(target, 1, TARGET)[0]
    if not _begin(c, m, t, out.twist):
        return
    body, memory, planned, short = c.gains.body, c.memory, along_z(m, t.twist), 0.0
    for i in range(3):
        short += m.rotation[i, 2] * (t.position[i] - m.position[i])
    if not memory.started:
        # Bumpless: from the tool's own place and speed.
        memory.started, memory.velocity, memory.offset = True, memory.velocity - planned, -short
    compliance = push(body, t.force[0] - m.wrench[2], m.clock[1], memory)
    rate = planned + compliance + (short + memory.offset) / c.gains.hybrid.position.look_ahead
    replace_along_z(m, min(max(rate, -body.limit), body.limit), out.twist)


def impedance_position(config: ControllerConfig) -> CompiledController:
    """Position-based impedance control along tool z."""
    own = config.baselines
    body = VirtualMass(own.mass_kg, own.damping_n_s_m, own.stiffness_n_m, config.force_limit_m_s)
    gains = BaselineGains(hybrid=hybrid_gains(config), body=body)
    return CompiledController(BaselineContext(gains), _impedance_position_law)


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

STEP_S = 0.002  #: The mode's own cycle [s]


@kernel
def mode_speed(error: float, dt: float, gains: ForceMode, memory: BaselineMemory) -> float:
    """Speed of the mode [m/s] for the ``error`` Fd - Fe [N], renewed every 2 ms and held in between."""
    memory.passed += dt
    memory.sum += error
    memory.readings += 1
    if memory.passed >= STEP_S - 1e-9:
        gained = memory.sum / memory.readings * memory.passed / gains.mass
        kept = (1.0 - gains.damping) ** (memory.passed / STEP_S)
        memory.velocity = min(max(kept * memory.velocity + gained, -gains.limit), gains.limit)
        memory.passed = memory.sum = 0.0
        memory.readings = 0
    return memory.velocity


@cfunc(LAW_SIGNATURE)
def _force_mode_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    c, out = carray(context, 1, _CONTEXT)[0], carray(answer, 1, ANSWER)[0]
    m, t = carray(measurement, 1, MEASUREMENT)[0], carray(target, 1, TARGET)[0]
    if _begin(c, m, t, out.twist):
        c.memory.started = True
        replace_along_z(m, mode_speed(t.force[0] - m.wrench[2], m.clock[1], c.gains.mode, c.memory), out.twist)


def force_mode(config: ControllerConfig) -> CompiledController:
    """A robot's own force mode along tool z."""
    own = config.baselines
    mode = ForceMode(own.mode_mass_kg / own.mode_gain_scaling, own.mode_damping, config.force_limit_m_s)
    return CompiledController(BaselineContext(BaselineGains(hybrid=hybrid_gains(config), mode=mode)), _force_mode_law)
