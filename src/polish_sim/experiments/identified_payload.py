"""A payload weighed by the arm that carries it: the same motion without and with it (layer 9)."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.carried_load import CarriedLoad
from polish_sim.experiments.identified_arm import SCENARIO, build_arm, play_motion
from polish_sim.experiments.logged_robot import LoggedRobot
from polish_sim.identification.base_parameters import BaseParameters, base_of
from polish_sim.identification.fourier import FourierMotion
from polish_sim.identification.information import JointSums, sum_samples
from polish_sim.identification.payload import Payload, body_of, fit_payload, fit_payload_on_known_arm
from polish_sim.identification.physical import is_consistent
from polish_sim.identification.robot_log import RobotLog, periodic_states, with_noise
from polish_sim.identification.settings import IdentifySettings
from polish_sim.identification.torque_model import States
from polish_sim.motion.serial_chain import link_parameters

Array = NDArray[np.float64]

_DENSITY: Final = 2700.0
"""Of the blocks that are carried [kg/m^3]."""
_AHEAD: Final = 0.05
"""Of the last link's origin, where a block begins [m]."""


class Weighed(NamedTuple):
    """A payload that was found."""

    payload: Payload
    truth: Array | None
    """Its true ten parameters; None for a real one."""
    figures: dict[str, Any]


def random_block(mass: float, rng: np.random.Generator) -> CarriedLoad:
    """A solid block of random sides, turned at random, bolted somewhere ahead of the last link [kg]."""
    sides = rng.uniform(0.5, 2.0, 3)
    sides *= (mass / _DENSITY / sides.prod()) ** (1.0 / 3.0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    squares = sides**2
    inertia = turn @ np.diag(mass / 12.0 * (squares.sum() - squares)) @ turn.T
    reach = 0.5 * float(np.linalg.norm(sides))
    return CarriedLoad(mass, np.array([*rng.uniform(-0.04, 0.04, 2), _AHEAD + reach]), inertia)


def guessed_load(mass: float, origin: Array) -> Array:
    """Ten parameters believed of a payload before it is weighed, a point ahead of the link, about an origin (3,)."""
    return link_parameters(mass, np.array([0.0, 0.0, 2.0 * _AHEAD]) - origin, np.zeros((3, 3)))


def weigh_block(
    empty: JointSums, base: BaseParameters, motion: FourierMotion, settings: IdentifySettings, rng: np.random.Generator
) -> Weighed:
    """Play the motion again with a block on the simulated arm, and find the block.

    Args:
        empty: What the run without it says, in the base.
        base: The arm's base.
        motion: The motion of both runs.
        settings: The block's mass, noise, periods.
        rng: Draws the block and the noise.
    """
    load = random_block(settings.payload, rng)
    arm, sigma = build_arm(settings.terms, SCENARIO, load), np.array(settings.sigma)
    log = play_motion(arm, motion, settings.periods, settings.rate)
    log = with_noise(log, settings.encoder, sigma, rng)
    payload = fit_payload(arm.truth, base, empty, periodic_states(log, motion.period), log.torque)
    truth = link_parameters(load.mass, load.center - payload.origin, load.inertia)
    return Weighed(payload, truth, payload_figures(payload, truth))


def weigh_from_logs(
    robot: LoggedRobot, empty: tuple[RobotLog, States] | None, loaded: tuple[RobotLog, States]
) -> Weighed:
    """Find what a robot carries from its logs.

    Args:
        robot: What is known of the robot.
        empty: A run without payload and its states; None if the robot's model is to be believed as it is.
        loaded: A run with it.

    Raises:
        IdentificationError: The motions do not tell everything.
    """
    model, base = robot.model, base_of(robot.model)
    log, states = loaded
    if empty is None:
        theta = base.combination @ model.truth()
        payload = fit_payload_on_known_arm(model, base, theta, states, log.torque)
    else:
        sums = sum_samples(model, base, empty[1], empty[0].torque)
        payload = fit_payload(model, base, sums, states, log.torque)
    return Weighed(payload, None, payload_figures(payload, None))


def payload_figures(payload: Payload, truth: Array | None) -> dict[str, Any]:
    """Keys of metrics.json; errors where the truth is known."""
    values, std = payload.body()
    figures: dict[str, Any] = {
        "payload_mass_kg": float(values[0]), "payload_mass_std_kg": float(std[0]),
        "payload_center_m": values[1:4].tolist(), "payload_center_std_m": std[1:4].tolist(),
        "payload_inertia_kg_m2": values[4:].tolist(), "payload_inertia_std_kg_m2": std[4:].tolist(),
        "payload_consistent": is_consistent(payload.nearest_body()[None]),
        "payload_consistent_as_found": is_consistent(payload.parameters[None]),
    }  # fmt: skip
    if truth is not None:
        off = values - body_of(truth, payload.origin)
        figures |= {
            "payload_mass_error_kg": float(off[0]),
            "payload_center_error_m": float(np.linalg.norm(off[1:4])),
            "payload_error_over_std": float(np.sqrt(np.mean((off / std) ** 2))),
        }
    return figures
