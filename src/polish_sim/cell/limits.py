"""What the explicit contact needs to be stable at this step; a scenario that breaks it is refused (layer 8a)."""

from __future__ import annotations

import math

from polish_sim.config import Scenario
from polish_sim.errors import ConfigError


def check_step_limits(scenario: Scenario, tangential_mass: float) -> None:
    """Refuse a scenario whose contact would be unstable at its time step.

    Args:
        scenario: The scenario.
        tangential_mass: What the arm and tool weigh against a push across the tool axis [kg].

    Raises:
        ConfigError: Naming the limit that is broken, by how much, and the keys that would mend it.
    """
    dt, pad, head = scenario.simulation.timestep_s, scenario.pad, scenario.head
    damping = pad.damping_s_m * scenario.safety.force_limit_n * dt / head.mass_kg
    if damping >= 1.0:
        raise ConfigError(
            f"pad.damping_s_m = {pad.damping_s_m:g} is too much for this step: a F dt / m = {damping:.2f}, must be "
            "below 1. Lower pad.damping_s_m, safety.force_limit_n or simulation.timestep_s."
        )
    phase = dt * math.sqrt((head.stiffness_n_m + pad.stiffness_n_m) / head.mass_kg)
    if phase >= 0.7:
        raise ConfigError(
            f"the head is too stiff for this step: dt sqrt((k_head + k_pad) / m) = {phase:.2f}, must be below 0.7. "
            "Lower pad.stiffness_n_m, head.stiffness_n_m or simulation.timestep_s, or raise head.mass_kg."
        )
    force = scenario.process.contact_force_n
    drag = pad.friction * force * dt / (pad.friction_smoothing_m_s * tangential_mass)
    if drag >= 1.0:
        raise ConfigError(
            f"pad.friction_smoothing_m_s = {pad.friction_smoothing_m_s:g} is too sharp for this step: "
            f"mu F dt / (v_s m) = {drag:.2f}, must be below 1 (m = {tangential_mass:.1f} kg). "
            "Raise it, or lower pad.friction or simulation.timestep_s."
        )
