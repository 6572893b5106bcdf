"""A payload as one more body on the last link: its mass, centre and inertia from a second run.

tau_loaded = Y theta + Y_n pi: the last link's own ten columns Y_n, beside the base parameters theta of the
arm, found in the run without payload.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Uncertain, rms
from polish_sim.identification import IdentifySettings
from polish_sim.identification.arm import LoggedRobot, build_simulated_arm, play_motion
from polish_sim.identification.estimate import (
    BaseParameters,
    JointSums,
    base_of,
    estimate,
    require_excited,
    sum_samples,
)
from polish_sim.identification.excitation import FourierMotion
from polish_sim.identification.log_file import RobotLog, periodic_states, with_noise
from polish_sim.identification.physical import is_consistent, nearest_bodies
from polish_sim.identification.regressor import States, TorqueModel
from polish_sim.identification.robot_model import CarriedLoad
from polish_sim.motion.serial_chain import (
    LINK_PARAMETERS,
    body_of,
    link_parameters,
)

BODY_NAMES = ("mass", "center_x", "center_y", "center_z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
BODY_UNITS = ("kg", "m", "m", "m", *["kg m^2"] * 6)


@dataclass(frozen=True)
class FoundPayload(Uncertain):
    """What a robot carries, about the origin of its last joint and in the axes of its last link."""

    parameters: Array  #: As `LINK_PARAMETERS`, shape (10,)
    covariance: Array  #: Shape (10, 10)
    origin: Array  #: Of the last joint, in the link's own frame [m], shape (3,)

    def body(self) -> tuple[Array, Array]:
        """Mass, centre and inertia about the centre in the last link's own frame, as `BODY_NAMES`, and their
        deviations to first order, shape (10,) each."""
        step = 1e-30
        slopes = [body_of(self.parameters + 1j * step * unit, self.origin).imag / step for unit in np.eye(10)]
        J = np.stack(slopes, axis=1)
        return body_of(self.parameters, self.origin), np.sqrt(np.diag(J @ self.covariance @ J.T))

    def nearest_body(self) -> Array:
        """The nearest parameters, in the estimate's own covariance, that a body can have, shape (10,)."""
        if is_consistent(self.parameters[None]):
            return self.parameters
        whiten = np.linalg.cholesky(np.linalg.inv(self.covariance)).T
        mass, inertia = (max(abs(self.parameters[k]), self.std[k]) for k in (0, 4))
        size = np.array([mass, *[math.sqrt(mass * inertia)] * 3, *[inertia] * 6])
        return nearest_bodies(whiten, whiten @ self.parameters, size, [np.zeros((4, 4))], np.zeros(0, int))


def fit_link_payload(
    model: TorqueModel, base: BaseParameters, empty: JointSums, states: States, torque: Array
) -> FoundPayload:  # fmt: skip
    """Estimate a payload from two runs, arm and payload at once.

    ``empty``: normal equations of the run without payload, in the base; ``states`` and ``torque`` [N m], (m,
    n), with it. Raises IdentificationError, naming it, if the motions leave a parameter unknown.
    """
    last = np.arange(10 * (model.joints - 1), 10 * model.joints)
    both = BaseParameters(np.append(base.columns, last), np.zeros((0, 0)))
    # The run without it has the payload's columns, of zeros.
    squares = np.pad(empty.squares, ((0, 0), (0, 10), (0, 10)))
    widened = empty._replace(squares=squares, products=np.pad(empty.products, ((0, 0), (0, 10))))
    loaded = sum_samples(model, both, states, torque)
    sums = JointSums(*(a + b for a, b in zip(loaded, widened, strict=True)))
    require_excited(sums, base, model, [f"payload {name}" for name in LINK_PARAMETERS])
    found = estimate(sums)
    return FoundPayload(found.theta[-10:], found.covariance[-10:, -10:], model.chain.origins[-1])


_DENSITY = 2700.0  #: Of the blocks that are carried [kg/m^3]
_AHEAD = 0.05  #: Of the last link's origin, where a block begins [m]


class Weighed(NamedTuple):
    """A payload that was found, and its true ten parameters, None for a real one."""

    payload: FoundPayload
    truth: Array | None

    def true_body(self) -> Array:
        """Its true numbers as `BODY_NAMES`, shape (10,); NaN of a real one."""
        return np.full(10, np.nan) if self.truth is None else body_of(self.truth, self.payload.origin)

    @property
    def figures(self) -> dict[str, Any]:
        """Keys of metrics.json; errors where the truth is known."""
        payload = self.payload
        values, std = payload.body()
        figures: dict[str, Any] = {
            "payload_mass_kg": values[0], "payload_mass_std_kg": std[0],
            "payload_center_m": values[1:4], "payload_center_std_m": std[1:4],
            "payload_inertia_kg_m2": values[4:], "payload_inertia_std_kg_m2": std[4:],
            "payload_consistent": is_consistent(payload.nearest_body()[None]),
            "payload_consistent_as_found": is_consistent(payload.parameters[None]),
        }  # fmt: skip
        if self.truth is not None:
            off = values - self.true_body()
            figures |= {
                "payload_mass_error_kg": off[0],
                "payload_center_error_m": np.linalg.norm(off[1:4]),
                "payload_error_over_std": rms(off / std),
            }
        return figures


def random_block(mass: float, rng: np.random.Generator) -> CarriedLoad:
    """A solid block of random sides, turned at random, bolted somewhere ahead of the last link [kg]."""
    sides = rng.uniform(0.5, 2.0, 3)
    sides *= (mass / _DENSITY / sides.prod()) ** (1.0 / 3.0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    squares = sides**2
    inertia = turn @ np.diag(mass / 12.0 * (squares.sum() - squares)) @ turn.T
    reach = 0.5 * np.linalg.norm(sides)
    return CarriedLoad(mass, np.array([*rng.uniform(-0.04, 0.04, 2), _AHEAD + reach]), inertia)


def guessed_load(mass: float, origin: Array) -> Array:
    """Ten parameters believed of a payload before it is weighed, a point ahead of the link, about an origin
    (3,)."""
    return link_parameters(mass, np.array([0.0, 0.0, 2.0 * _AHEAD]) - origin, np.zeros((3, 3)))


def weigh_block(
    empty: JointSums,
    base: BaseParameters,
    motion: FourierMotion,
    settings: IdentifySettings,
    rng: np.random.Generator,
) -> Weighed:
    """Play the motion again with a block on the simulated arm, and find the block; ``empty`` is the run
    without it."""
    load = random_block(settings.payload, rng)
    arm = build_simulated_arm(settings.robot, settings.seed, load)
    log = play_motion(arm, motion, settings.periods, settings.rate)
    log = with_noise(log, settings.encoder_step, np.array(settings.sigma), rng)
    payload = fit_link_payload(arm.truth, base, empty, periodic_states(log, motion.period), log.torque)
    truth = link_parameters(load.mass, load.center - payload.origin, load.inertia)
    return Weighed(payload, truth)


def weigh_from_logs(
    robot: LoggedRobot, empty: tuple[RobotLog, States], loaded: tuple[RobotLog, States]
) -> Weighed:
    """Find what a robot carries from its logs without and with it."""
    model = robot.model
    base = base_of(model)
    sums = sum_samples(model, base, empty[1], empty[0].torque)
    return Weighed(fit_link_payload(model, base, sums, loaded[1], loaded[0].torque), None)
