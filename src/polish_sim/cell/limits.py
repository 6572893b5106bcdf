"""What contact, sensor and robot need to work at this step; a scenario that breaks it is refused."""

from __future__ import annotations

import math
from dataclasses import replace

from polish_sim.cell.faults import changed_force
from polish_sim.cell.real_part import DEEPEST_BAND, FIELD_BAND
from polish_sim.config import PadConfig, ProcessConfig, Scenario
from polish_sim.errors import ConfigError

TURNS_PER_STEP = 0.2  # of the spindle, at most: its imbalance must be seen five times a turn
AT_EDGE = 0.125  # of the pad, that carries all of the force on edges and corners of the part
LEAST_ROOM = 1.2  # of the force at which the robot stops over the force it is to hold


def check_friction(pad: PadConfig, force: float, tangential_mass: float, dt: float) -> None:
    """Refuse a pad whose friction would be unstable in a step of ``dt`` [s], pressed with at most ``force``
    [N].

    ``tangential_mass`` [kg] is the inertia of arm and tool against a push across the tool axis.

    Raises:
        ConfigError: Naming the limit that is broken, by how much, and the keys that would mend it.
    """
    drag = pad.friction * force * dt / (pad.friction_smoothing_m_s * tangential_mass)
    if drag >= 1.0:
        raise ConfigError(
            f"pad.friction_smoothing_m_s = {pad.friction_smoothing_m_s:g} is too sharp for this step: "
            f"mu F dt / (v_s m) = {drag:.2f}, must be below 1 (m = {tangential_mass:.1f} kg). "
            "Raise it, or lower pad.friction or simulation.timestep_s."
        )


def with_implicit_friction(pad: PadConfig, force: float, tangential_mass: float, dt: float) -> PadConfig:
    """A pad whose friction, taken at the beginning of a step, acts as if taken at its end.

    Behind elastic gears the tool is so light that it needs that. In its steep part friction is a damper mu F
    / v_s; taken at the end of a step it is mu F / (v_s + mu F dt / m). Arguments as of `check_friction`.
    """
    smoothing = pad.friction_smoothing_m_s + pad.friction * force * dt / tangential_mass
    return replace(pad, friction_smoothing_m_s=smoothing)


def check_contact_settings(scenario: Scenario, force: float) -> None:
    """Refuse springs and limits that cannot work in a step, pressed with at most ``force`` [N]; raises as
    `check_friction`."""
    pad, head, safety, dt = scenario.pad, scenario.head, scenario.safety, scenario.simulation.timestep_s
    damping = pad.damping_s_m * safety.force_limit_n * dt / head.mass_kg
    if damping >= 1.0:
        raise ConfigError(
            f"pad.damping_s_m = {pad.damping_s_m:g} is too much for this step: a F dt / m = {damping:.2f}, "
            "must be below 1. Lower pad.damping_s_m, safety.force_limit_n or simulation.timestep_s."
        )
    phase = dt * math.sqrt(head.spring_scale * (head.stiffness_n_m + pad.stiffness_n_m) / head.mass_kg)
    if phase >= 0.7:
        raise ConfigError(
            f"the head is too stiff for this step: dt sqrt((k_head + k_pad) / m) = {phase:.2f}, must be "
            "below 0.7. Lower pad.stiffness_n_m, head.stiffness_n_m, head.spring_scale or "
            "simulation.timestep_s, or raise head.mass_kg."
        )
    if safety.force_limit_n < LEAST_ROOM * force:
        raise ConfigError(
            f"safety.force_limit_n = {safety.force_limit_n:g} leaves no room above the {force:g} N "
            f"to be held: the robot would stop at the first overshoot. Raise it to {LEAST_ROOM * force:g} or "
            "more, or lower process.contact_force_n (--contact-force) or the path's own force."
        )
    depth = 2.0 * force / (pad.stiffness_n_m * head.spring_scale)
    if depth > DEEPEST_BAND:
        raise ConfigError(
            f"pad.stiffness_n_m = {pad.stiffness_n_m:g} is too soft for {force:g} N: twice that force would "
            f"press it in by {1e3 * depth:.1f} mm, and a part is modelled {1e3 * DEEPEST_BAND:g} mm deep at "
            "most. Raise it or lower process.contact_force_n."
        )


def modelled_depth(process: ProcessConfig, force: float, stiffness: float) -> float:
    """How deep a part is modelled [m] for a path that asks a pad of a stiffness [N/m] for at most a ``force``
    [N].

    A force changed to twice as much during the run needs no other model, so that what was changed by hand
    gives the same bytes again. Whole millimetres, between ``FIELD_BAND`` and ``DEEPEST_BAND``; a guard stops
    what presses deeper.
    """
    most = max(force, 0.5 * changed_force(process, force)) / AT_EDGE
    needed = 1e-3 * math.ceil(1e3 * most / stiffness)
    return min(max(FIELD_BAND, needed), DEEPEST_BAND)


def check_rates(scenario: Scenario) -> None:
    """Refuse a sensor or a spindle faster than the physics, and timeouts shorter than the cycles they watch.

    Raises:
        ConfigError: Naming the keys that do not fit each other.
    """
    dt, sensor, robot = scenario.simulation.timestep_s, scenario.sensor, scenario.robot
    if sensor.rate_hz * dt > 1.0 + 1e-9:
        raise ConfigError(
            f"sensor.rate_hz = {sensor.rate_hz:g} is faster than the physics: one sample per step is all "
            f"there is. Lower it to {1.0 / dt:g}, or lower simulation.timestep_s."
        )
    if scenario.safety.sensor_timeout_s < 1.0 / sensor.rate_hz:
        raise ConfigError(
            f"safety.sensor_timeout_s = {scenario.safety.sensor_timeout_s:g} would take a sensor of "
            f"sensor.rate_hz = {sensor.rate_hz:g} for frozen. Raise it to {2.0 / sensor.rate_hz:g}."
        )
    spindle = scenario.spindle
    turns = spindle.speed_rpm / 60.0 * dt
    if turns > TURNS_PER_STEP and spindle.imbalance_m_s > 0.0:
        raise ConfigError(
            f"spindle.speed_rpm = {spindle.speed_rpm:g} is too fast for this step: the pull of its imbalance "
            f"would be seen {1.0 / turns:.1f} times a turn, at least {1.0 / TURNS_PER_STEP:g} are needed. "
            f"Lower it to {60.0 * TURNS_PER_STEP / dt:g}, lower simulation.timestep_s, or set "
            "spindle.imbalance_m_s to 0."
        )
    cycle = dt * scenario.simulation.control_every
    if robot.command_timeout_s < 2.0 * cycle:
        raise ConfigError(
            f"robot.command_timeout_s = {robot.command_timeout_s:g} would stop the robot between two "
            f"commands, which come every {cycle:g} s (simulation.control_every). Raise it to {2.0 * cycle:g} "
            "or more."
        )
