"""What a joint's torque is made of: rigid links, friction, rotors, offsets; all linear in their parameters (layer 8d).

tau = Y(q, qd, qdd) pi + diag(qd) fv + diag(tanh(qd / vs)) fc + diag(qdd) Ia + f0          (paper 3)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import unknown_name
from polish_sim.identification.regressor import regressor_derivatives, rigid_regressor
from polish_sim.motion.serial_chain import LINK_PARAMETERS, LINK_UNITS, SerialChain

Array = NDArray[np.float64]

PIECE: Final = 2000
"""Samples whose regressors are held at once."""
SIGN_WIDTH: Final = 0.02
"""Speed over which the sign of Coulomb friction is smoothed [rad/s]."""


class States(NamedTuple):
    """Joint states, one row a sample."""

    q: Array
    """[rad], shape (m, n)."""
    qd: Array
    """[rad/s], shape (m, n)."""
    qdd: Array
    """[rad/s^2], shape (m, n)."""

    def rows(self, rows: slice | NDArray[np.integer[Any]] | NDArray[np.bool_]) -> States:
        """Some of the samples."""
        return States(self.q[rows], self.qd[rows], self.qdd[rows])


class JointTerm(NamedTuple):
    """A torque of each joint by itself: value times parameter."""

    symbol: str
    unit: str
    value: Callable[[States], Array]
    """Shape (m, n)."""
    slope: Callable[[States], States]
    """Its derivatives by the joint's own position, speed and acceleration, shape (m, n) each."""
    truth: Callable[[SerialChain], Array]
    """What the robot's model says, shape (n,)."""


def _slope_of_sign(states: States) -> States:
    none = np.zeros_like(states.q)
    return States(none, (1.0 - np.tanh(states.qd / SIGN_WIDTH) ** 2) / SIGN_WIDTH, none)


TERMS: Final[dict[str, JointTerm]] = {
    "coulomb": JointTerm(
        "fc", "N m", lambda x: np.tanh(x.qd / SIGN_WIDTH), _slope_of_sign, lambda chain: chain.frictionloss
    ),
    "viscous": JointTerm(
        "fv", "N m s/rad", lambda x: x.qd, lambda x: States(0.0 * x.q, np.ones_like(x.q), 0.0 * x.q),
        lambda chain: chain.damping,
    ),
    "armature": JointTerm(
        "Ia", "kg m^2", lambda x: x.qdd, lambda x: States(0.0 * x.q, 0.0 * x.q, np.ones_like(x.q)),
        lambda chain: chain.armature,
    ),
    "offset": JointTerm(
        "f0", "N m", lambda x: np.ones_like(x.q), lambda x: States(0.0 * x.q, 0.0 * x.q, 0.0 * x.q),
        lambda chain: np.zeros_like(chain.damping),
    ),
}  # fmt: skip
"""Terms a model may have beside the rigid links."""
FULL: Final = ("coulomb", "viscous", "armature", "offset")
"""Coulomb first: poses approached at one slow speed tell its sum with viscous friction, and that is its name."""


@dataclass(frozen=True)
class TorqueModel:
    """A chain and the terms its torques are made of; columns: ten a link, then each term's joints."""

    chain: SerialChain
    terms: tuple[str, ...] = FULL

    def __post_init__(self) -> None:
        for term in self.terms:
            if term not in TERMS:
                raise unknown_name("torque term", term, TERMS)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.chain.joints)

    @property
    def columns(self) -> int:
        """Number of parameters p = 10 n + n for each term."""
        return self.joints * (10 + len(self.terms))

    @property
    def names(self) -> tuple[str, ...]:
        """A name for every column: ``m2``, ``Ixx3``, ``fv1``."""
        links = [f"{name}{link + 1}" for link in range(self.joints) for name in LINK_PARAMETERS]
        return (*links, *(f"{TERMS[term].symbol}{j + 1}" for term in self.terms for j in range(self.joints)))

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of every column's parameter, rotations assumed."""
        return (*(LINK_UNITS * self.joints), *(TERMS[term].unit for term in self.terms for _ in range(self.joints)))

    def truth(self) -> Array:
        """The parameters the chain's own model has, shape (p,)."""
        return np.concatenate([self.chain.parameters.ravel(), *(TERMS[term].truth(self.chain) for term in self.terms)])

    def regressor(self, states: States) -> Array:
        """Regressor of all columns, shape (m, n, p)."""
        n = self.joints
        Y = np.zeros((len(states.q), n, self.columns))
        Y[:, :, : 10 * n] = rigid_regressor(self.chain.geometry, *states)
        diagonal = np.arange(n)
        for number, term in enumerate(self.terms):
            Y[:, diagonal, n * (10 + number) + diagonal] = TERMS[term].value(states)
        return Y

    def regressor_slopes(self, states: States) -> Array:
        """Derivatives of the regressor by position, speed and acceleration of each joint, shape (m, 3 n, n, p)."""
        n = self.joints
        slopes = np.zeros((len(states.q), 3 * n, n, self.columns))
        slopes[..., : 10 * n] = regressor_derivatives(self.chain.geometry, *states)
        joints = np.arange(n)
        for number, term in enumerate(self.terms):
            for part, values in enumerate(TERMS[term].slope(states)):
                slopes[:, part * n + joints, joints, n * (10 + number) + joints] = values
        return slopes

    def torque(self, states: States, parameters: Array) -> Array:
        """Torques of all parameters (p,) [N m], shape (m, n)."""
        return np.asarray(self.regressor(states) @ parameters)

    def torque_of_base(self, states: States, columns: NDArray[np.int64], theta: Array) -> Array:
        """Torques of base parameters (r,) on their columns (r,) [N m], shape (m, n)."""
        return np.concatenate(
            [
                self.regressor(states.rows(slice(first, first + PIECE)))[:, :, columns] @ theta
                for first in range(0, len(states.q), PIECE)
            ]
        )


def random_states(joints: int, count: int, rng: np.random.Generator) -> States:
    """States uniform in +-3 rad, +-3 rad/s and +-9 rad/s^2, shape (count, joints) each."""
    return States(*(rng.uniform(-size, size, (count, joints)) for size in (3.0, 3.0, 9.0)))
