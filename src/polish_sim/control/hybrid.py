"""Hybrid position/force control: the loops of paper 1 composed axis by axis in the tool frame (fig. 10,
11), or with a UR robot's own force mode along tool z, as far as that is public."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from polish_sim.arrays import Array
from polish_sim.config import AdaptiveConfig, ControllerConfig
from polish_sim.control import loops
from polish_sim.control.signals import (
    LAW_SIGNATURE,
    CompiledController,
    Measurement,
    Target,
    records_at,
)
from polish_sim.kernel_cache import cfunc
from polish_sim.kernels import Record, Vector3, dot, kernel

LATEST = 2.0  #: Times as late as believed the sensor may be
STIFFER = 1.5  #: Times the drawn stiffness up to which the gains are as set
GENTLY = 0.25  #: Share of the acceleration the bound on the speed counts on: a quicker stop shakes the arm


class HybridGains(Record):
    """Gains of the loops."""

    position: loops.VelocityGains
    position_rate: loops.PositionRateGains
    orientation: loops.VelocityGains
    force: loops.PiGains
    moment: loops.PiGains
    strike: loops.StrikeGains
    tilt_limit: float  #: Largest turn of the moment loop about tool y away from the planned axis [rad]


class HybridMemory(Record):
    """Memory of the loops, all zero after a reset."""

    position: loops.VelocityMemory
    orientation: loops.VelocityMemory
    force: loops.PiMemory
    moment: loops.PiMemory
    felt: loops.FeltMemory
    pressed: float  #: Last commanded speed of the force loop [m/s]
    wanted: Vector3  #: Wanted velocity, linear or angular
    error: Vector3  #: Rotation error [rad]


class HybridContext(Record):
    """What a law of this file reads and writes."""

    gains: HybridGains
    memory: HybridMemory


def strike_gains(beliefs: AdaptiveConfig, braking: float = 1.0) -> loops.StrikeGains:
    """What cell and sensor are believed to be; the bound counts on a share ``braking`` of the
    acceleration."""
    sensing = LATEST * beliefs.sensor_latency_s + 0.5 / (math.pi * beliefs.sensor_bandwidth_hz)
    return loops.StrikeGains(
        beliefs.stiffness_n_m, braking * beliefs.acceleration_m_s2, sensing + beliefs.command_delay_s
    )


def hybrid_gains(config: ControllerConfig) -> HybridGains:
    """The gains a configuration asks for."""
    look_ahead = config.look_ahead_s
    return HybridGains(
        position=loops.VelocityGains(look_ahead, config.position_p, config.position_d_s),
        position_rate=loops.PositionRateGains(config.position_rate_p, config.position_rate_d),
        orientation=loops.VelocityGains(
            look_ahead, config.orientation_p, config.orientation_d_s, config.orientation_i_hz
        ),
        force=loops.PiGains(
            config.force_p_m_sn, config.force_i_m_s2n, config.force_limit_m_s, config.force_filter_hz
        ),
        moment=loops.PiGains(
            config.moment_p_rad_snm,
            config.moment_i_rad_s2nm,
            config.moment_limit_rad_s,
            config.moment_filter_hz,
        ),
        strike=strike_gains(config.adaptive, GENTLY),
        tilt_limit=config.moment_tilt_limit_rad,
    )


@kernel
def position_by_velocity(
    m: Measurement, t: Target, gains: loops.VelocityGains, memory: HybridMemory, out: Array
) -> None:
    """Linear part of the twist by eq. 6: PD on the velocity error, position through the look-ahead."""
    loops.velocity_toward(m.position, t.position, t.twist[0:3], gains.look_ahead, memory.wanted)
    loops.velocity_pid(memory.wanted, m.twist[0:3], gains, m.cycle, memory.position, out[0:3])


@kernel
def turn_to_target(
    m: Measurement, R_wanted: Array, planned: Array, gains: loops.VelocityGains, free_y: bool,
    memory: HybridMemory, out: Array,
) -> None:  # fmt: skip
    """Angular part of the twist by eq. 7, towards ``R_wanted`` (3, 3) with ``planned`` the planned tool
    velocity (6,).

    With ``free_y`` tool y is left to the moment loop. ``memory.error`` is left holding the rotation error
    [rad].
    """
    loops.rotation_error(m.rotation, R_wanted, memory.error)
    surplus = 0.0
    for i in range(3):
        memory.wanted[i] = planned[3 + i] + memory.error[i] / gains.look_ahead
        surplus += m.rotation[i, 1] * (memory.wanted[i] - m.twist[3 + i])
    if free_y:
        for i in range(3):
            memory.wanted[i] -= surplus * m.rotation[i, 1]
    loops.velocity_pid(memory.wanted, m.twist[3:6], gains, m.cycle, memory.orientation, out[3:6])


@kernel
def follow_plan(m: Measurement, t: Target, gains: HybridGains, memory: HybridMemory, out: Array) -> None:
    """All of the twist by eq. 6 and 7, no force control."""
    position_by_velocity(m, t, gains.position, memory, out)
    turn_to_target(m, t.rotation, t.twist, gains.orientation, False, memory, out)


@kernel
def along_z(m: Measurement, twist: Array) -> float:
    """Speed along tool z [m/s]."""
    return float(dot(m.rotation[:, 2], twist[0:3]))


@kernel
def replace_along_z(m: Measurement, rate: float, out: Array) -> None:
    """Give the twist's part along tool z a value of its own [m/s]."""
    along = along_z(m, out)
    for i in range(3):
        out[i] += (rate - along) * m.rotation[i, 2]


@kernel
def level_about_y(m: Measurement, t: Target, gains: HybridGains, memory: HybridMemory, out: Array) -> None:
    """Replace the twist's part about tool y by the moment loop: f' = f_xz + f_Fy y (fig. 11).

    The loop works about the planned turning rate: from the moment alone the tool would lag behind every bend
    of the part. The tilt away from the planned axis stays within ``gains.tilt_limit``: at the border of a
    part the pad's moment would otherwise roll the tool over the edge.
    """
    y, look_ahead = m.rotation[:, 1], gains.position.look_ahead
    rate = loops.force_pi(t.moment, m.wrench[4], gains.moment.limit, gains.moment, m.cycle, memory.moment)
    tilt = along = planned = 0.0
    for i in range(3):
        tilt += y[i] * memory.error[i]
        along += y[i] * out[3 + i]
        planned += y[i] * t.twist[3 + i]
    lowest = planned + (tilt - gains.tilt_limit) / look_ahead
    highest = planned + (tilt + gains.tilt_limit) / look_ahead
    rate = min(max(planned + rate, lowest), highest)
    for i in range(3):
        out[3 + i] += (rate - along) * y[i]


@kernel
def turn_and_level(m: Measurement, t: Target, gains: HybridGains, memory: HybridMemory, out: Array) -> None:
    """Angular part of the twist: eq. 7, and in contact the moment loop about tool y."""
    pressing = t.contact
    turn_to_target(m, t.rotation, t.twist, gains.orientation, pressing, memory, out)
    if pressing:
        level_about_y(m, t, gains, memory, out)
    else:
        _forget(memory.moment)


@kernel
def _forget(memory: loops.PiMemory) -> None:
    memory.integral, memory.measured, memory.started = 0.0, 0.0, False


@kernel
def press_hybrid(m: Measurement, t: Target, gains: HybridGains, memory: HybridMemory, out: Array) -> None:
    """In contact, replace the twist's part along tool z by the force loop: v' = v_xy + v_Fz z (fig. 10).

    The loop's speed into the part stays below that at which the stiffest springs would be struck, and its
    gains are lowered on what it felt to be stiffer than drawn while it landed.
    """
    turn_and_level(m, t, gains, memory, out)
    if t.contact:
        speed = along_z(m, m.twist)
        unseen = (gains.strike.delay + m.cycle) * max(speed, memory.pressed)
        highest = loops.strike_limit(gains.strike, t.force, m.wrench[2], unseen)
        rate = loops.force_pi(t.force, m.wrench[2], highest, gains.force, m.cycle, memory.force)
        rate *= loops.felt_share(
            t.force, memory.force.measured, speed, STIFFER * gains.strike.stiffness, gains.force.filter_hz,
            m.cycle, memory.felt,
        )  # fmt: skip
        memory.pressed = rate
        replace_along_z(m, rate, out)
    else:
        memory.pressed = memory.felt.share = 0.0
        _forget(memory.force)


# The paper's controllers and position control alone: each one compiled law composed of the loops.

_CONTEXT = HybridContext.dtype


@cfunc(LAW_SIGNATURE)
def _hybrid_pi_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    """Eq. 6 and 7 with force along tool z and moment about tool y in contact."""
    c, m, t, out = records_at(context, _CONTEXT, measurement, target, answer)
    position_by_velocity(m, t, c.gains.position, c.memory, out.twist)
    press_hybrid(m, t, c.gains, c.memory, out.twist)


@cfunc(LAW_SIGNATURE)
def _hybrid_pi_position_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    """As ``hybrid-pi`` with the position loop of eq. 5."""
    c, m, t, out = records_at(context, _CONTEXT, measurement, target, answer)
    loops.position_pd(
        m.position, t.position, m.twist[0:3], t.twist[0:3], c.gains.position_rate, out.twist[0:3]
    )
    press_hybrid(m, t, c.gains, c.memory, out.twist)


@cfunc(LAW_SIGNATURE)
def _position_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    """Eq. 6 and 7 on all six axes, no force control."""
    c, m, t, out = records_at(context, _CONTEXT, measurement, target, answer)
    follow_plan(m, t, c.gains, c.memory, out.twist)


def _composed(law: Any, text: str) -> Callable[[ControllerConfig], CompiledController]:
    """What makes a controller of one of these laws; ``text`` says in `list controllers` what it is."""

    def build(config: ControllerConfig) -> CompiledController:
        return CompiledController(HybridContext(hybrid_gains(config)), law)

    build.__doc__ = text
    return build


hybrid_pi = _composed(
    _hybrid_pi_law, "Paper 1's controller for a speed-commanded robot (eq. 6, 7; fig. 10, 11)."
)
hybrid_pi_position = _composed(
    _hybrid_pi_position_law, "The sister of hybrid-pi, with the position loop of eq. 5."
)
position = _composed(
    _position_law, "Position control alone: what a pressed-in path gives without a force loop."
)


STEP_S = 0.002  #: The mode's own cycle [s]


class ForceModeGains(Record):
    """Gains of the loops around the mode and its own."""

    hybrid: HybridGains
    mass: float  #: Virtual mass M / scaling [kg]
    damping: float  #: Share of the speed lost per step [-]
    limit: float  #: Largest speed [m/s]


class ForceModeMemory(Record):
    """All zero after a reset."""

    hybrid: HybridMemory
    velocity: float  #: [m/s]
    started: bool  #: In contact
    passed: float  #: Time since the mode's last step [s]
    sum: float  #: Of the force errors since [N]
    readings: int  #: Since then


class ForceModeContext(Record):
    """What the law reads and writes."""

    gains: ForceModeGains
    memory: ForceModeMemory


_MODE = ForceModeContext.dtype


@kernel
def mode_speed(error: float, dt: float, gains: ForceModeGains, memory: ForceModeMemory) -> float:
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
    """Everything but tool z, and before contact tool z too, as ``hybrid-pi`` does it."""
    c, m, t, out = records_at(context, _MODE, measurement, target, answer)
    gains, memory = c.gains.hybrid, c.memory
    position_by_velocity(m, t, gains.position, memory.hybrid, out.twist)
    turn_and_level(m, t, gains, memory.hybrid, out.twist)
    if not t.contact:
        memory.started = False
        return
    if not memory.started:
        # Bumpless: from the tool's own speed.
        memory.started = True
        memory.velocity = along_z(m, m.twist)
        memory.passed = memory.sum = 0.0
        memory.readings = 0
    replace_along_z(m, mode_speed(t.force - m.wrench[2], m.cycle, c.gains, memory), out.twist)


def force_mode(config: ControllerConfig) -> CompiledController:
    """A robot's own force mode along tool z."""
    own = config.baselines
    mass = own.mode_mass_kg / own.mode_gain_scaling
    gains = ForceModeGains(hybrid_gains(config), mass, own.mode_damping, config.force_limit_m_s)
    return CompiledController(ForceModeContext(gains), _force_mode_law)
