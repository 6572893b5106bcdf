"""The arm of `run teach`: torque mode, what its controller believes of it, and where it starts (layer 9)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell import tool_on_flange
from polish_sim.cell.guiding import GuidedArm
from polish_sim.cell.hand import Hand
from polish_sim.cell.serial_chain import read_chain
from polish_sim.cell.torque_mode import LaidPart, build_torque_arm, chain_of_file
from polish_sim.config import HandConfig, Scenario
from polish_sim.control.hand_guiding import Belief, GuidingLimits, gains_of
from polish_sim.experiments.identified_arm import ARM_JOINTS
from polish_sim.motion import forward, inverse_near
from polish_sim.motion.chain_torque import chain_model

Array = NDArray[np.float64]

HOME: Final = (1.300932701746, -1.591205400892, 1.509041313016, -1.488632238919, -1.570796326795, -0.269863625049)
"""Joint angles the hand's moves are centred on, the model file's home [rad]."""
DIRECTIONS: Final[Mapping[str, tuple[float, float, float]]] = MappingProxyType(
    {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}
)
"""Unit vectors in the base frame."""


def torque_arm(scenario: Scenario, part: LaidPart | None = None) -> Any:
    """The compiled arm in torque mode, with a part before it or alone; see ``cell.torque_mode``."""
    return build_torque_arm(scenario, ARM_JOINTS, part)


def believe(scenario: Scenario) -> Belief:
    """What the arm's controller is told: the model without the payload, or a file's, times the scenario's errors.

    Raises:
        InputError: ``guide.model_file`` is no model of this arm.
    """
    guide = scenario.guide
    # The payload nobody was told of is not in the believed chain.
    told = torque_arm(replace(scenario, guide=replace(guide, payload_kg=0.0)))
    chain = chain_of_file(Path(guide.model_file), ARM_JOINTS) if guide.model_file else read_chain(told, ARM_JOINTS)
    return Belief(
        chain_model(chain, guide.mass_scale), guide.friction_scale * np.array(guide.coulomb_nm),
        guide.friction_scale * np.array(guide.viscous_nm_s_rad), np.array(guide.creep_rad_s),
        np.array(told.actuator_forcerange[:, 1]),
    )  # fmt: skip


def guided_arm(scenario: Scenario, mode: str, model: Any, belief: Belief, hand: Hand) -> GuidedArm:
    """The arm with its law in a mode and fresh limits.

    Raises:
        InputError: There is no such mode; lists the known ones.
    """
    guide = scenario.guide
    limits = GuidingLimits(guide.joint_speed_limit_rad_s, guide.tool_speed_limit_m_s, guide.energy_limit_j, np.zeros(2))
    return GuidedArm(model, belief, gains_of(mode, guide, scenario.simulation.timestep_s), limits, hand)


def hand_of(config: HandConfig) -> Hand:
    """The hand of a scenario."""
    return Hand(config.stiffness_n_m, config.damping_n_s_m, config.turn_stiffness_nm_rad, config.turn_damping_nm_s_rad)


def home_pose() -> Array:
    """Tool pose at home in the base frame, shape (4, 4)."""
    return np.asarray(forward(np.array(HOME)) @ tool_on_flange())


def joints_for(T_base_tool: Array, near: Array) -> Array:
    """Joint angles that bring the tool to a pose [rad], shape (6,).

    Raises:
        ReachError: The pose cannot be reached.
    """
    return np.asarray(inverse_near(T_base_tool @ np.linalg.inv(tool_on_flange()), near))
