"""Joint torques as a linear function of their parameters: rigid links, friction, rotors, offsets (paper 3).

tau = Y(q, qd, qdd) pi + diag(qd) fv + diag(tanh(qd / vs)) fc + diag(qdd) Ia + f0. A strain-wave gear adds
diag(tanh(qd / vs)) (fr sqrt|qd| + fl |T| + waves of its teeth), T the torque it passes on. Y is Newton-Euler
in link frames: link j's wrench about its own origin is B_j pi_j, its share at joint k is s_kj . B_j pi_j,
where s_kj = (z_k x r_kj; z_k) is the joint's screw at that origin, in the link's axes. The kernel takes
complex numbers too, for derivatives by a complex step (`regressor_derivatives`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Bools, Indices
from polish_sim.kernel_cache import njit
from polish_sim.motion.serial_chain import (
    LINK_PARAMETERS,
    LINK_UNITS,
    ChainGeometry,
    SerialChain,
    fill_block,
    step_outward,
)

STEP = 1e-30  #: Size of the complex step: its square vanishes beside one
PIECE = 2000  #: Samples whose regressors are held at once
SIGN_WIDTH = 0.02  #: Speed over which the sign of Coulomb friction is smoothed [rad/s]


def rigid_regressor(chain: ChainGeometry, q: Array, qd: Array, qdd: Array) -> Array:
    """Y (m, n, 10 n) of states (m, n) [rad or m]: torques [N m or N] per unit of each link's ten
    parameters."""
    m, n = q.shape
    motion, screws, Y = (np.zeros(shape, q.dtype) for shape in ((6, 3), (2, n, 3), (m, n, 10 * n)))
    _fill_regressors(chain, *map(np.ascontiguousarray, (q, qd, qdd)), motion, screws, Y)
    return Y


def regressor_derivatives(chain: ChainGeometry, q: Array, qd: Array, qdd: Array) -> Array:
    """Exact derivatives dY / d(q, qd, qdd) of the regressor by a complex step, shape (m, 3 n, n, 10 n)."""
    m, n = q.shape
    state = np.concatenate([q, qd, qdd], axis=1).astype(np.complex128)
    out = np.empty((m, 3 * n, n, 10 * n))
    for column in range(3 * n):
        stepped = state.copy()
        stepped[:, column] += 1j * STEP
        parts: Any = np.split(stepped, 3, axis=1)
        out[:, column] = rigid_regressor(chain, *parts).imag / STEP
    return out


@njit(_nrt=False)
def _fill_regressors(  # type: ignore[no-untyped-def]
    chain: ChainGeometry, q, qd, qdd, motion, screws, Y
) -> None:
    """Fill regressors (m, n, 10 n) of m real or complex states (m, n); blocks below the diagonal are left as
    they are.

    ``motion`` (6, 3) has w, dw, a and the turn from link to link, ``screws`` (2, n, 3) axes and arms of the
    joints.
    """
    w, dw, a = motion[0], motion[1], motion[2]
    for row in range(q.shape[0]):
        for x in range(3):
            w[x] = 0.0 * q[row, 0]
            dw[x] = 0.0 * q[row, 0]
            a[x] = -chain.gravity[x] + 0.0 * q[row, 0]
        for j in range(q.shape[1]):
            step_outward(chain, j, q[row, j], qd[row, j], qdd[row, j], motion, screws)
            for k in range(j + 1):
                fill_block(chain.kind[k], screws[0, k], screws[1, k], w, dw, a, Y[row, k], 10 * j)


class States(NamedTuple):
    """Joint states, one row a sample."""

    q: Array  #: [rad], shape (m, n)
    qd: Array  #: [rad/s], shape (m, n)
    qdd: Array  #: [rad/s^2], shape (m, n)

    def rows(self, rows: slice | NDArray[np.integer[Any]] | Bools) -> States:
        """Some of the samples."""
        return States(*(part[rows] for part in self))


class JointTerm(NamedTuple):
    """A torque of each joint by itself: value times parameter."""

    symbol: str
    unit: str
    value: Callable[[States, Array], Array]  #: Of states and torques without friction (m, n), shape (m, n)
    #: Its derivatives (m, n) by the joint's position (0), speed (1) or acceleration (2), those not given
    #: being 0; None where motions are not designed for it
    slopes: Mapping[int, Callable[[States], Array]] | None
    known: str = ""  #: What the robot's model says of it: a field of `SerialChain`


def _ones(states: States) -> Array:
    return np.ones_like(states.q)


def _sign(states: States) -> Array:
    return np.tanh(states.qd / SIGN_WIDTH)


TERMS: dict[str, JointTerm] = {
    "coulomb": JointTerm(
        "fc", "N m", lambda x, _load: _sign(x), {1: lambda x: (1.0 - _sign(x) ** 2) / SIGN_WIDTH},
        "frictionloss"
    ),
    "viscous": JointTerm(
        "fv", "N m s/rad", lambda x, _load: x.qd, {1: _ones}, "damping"
    ),
    "armature": JointTerm(
        "Ia", "kg m^2", lambda x, _load: x.qdd, {2: _ones}, "armature"
    ),
    "offset": JointTerm("f0", "N m", lambda x, _load: _ones(x), {}),
    "root": JointTerm(
        "fr", "N m (s/rad)^0.5", lambda x, _load: _sign(x) * np.sqrt(np.abs(x.qd)), None
    ),
    "load": JointTerm("fl", "", lambda x, load: _sign(x) * np.abs(load), None),
}  # fmt: skip
"""Terms a model may have beside the rigid links."""


WAVES = {"cos": np.cos, "sin": np.sin}


def term_of(name: str) -> JointTerm:
    """A term by its name: of `TERMS`, or a wave of a gear's teeth, ``cos202``."""
    if name in TERMS:
        return TERMS[name]
    wave = WAVES[name[:3]]
    teeth = int(name[3:])
    return JointTerm(f"{name}_", "N m", lambda x, _load: _sign(x) * wave(teeth * x.q), None)


FULL = ("coulomb", "viscous", "armature", "offset")
"""Terms of rigid joints, in the order of the model's columns."""


@dataclass(frozen=True)
class TorqueModel:
    """A chain and the terms its torques are made of; columns: ten a link, then each term's joints."""

    chain: SerialChain
    terms: tuple[str, ...] = FULL
    load: Array | None = (
        None  #: Of the links, as drawn, whose torque friction by load grows with, shape (10 n,)
    )

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
        return (
            *links,
            *(f"{term_of(term).symbol}{j + 1}" for term in self.terms for j in range(self.joints)),
        )

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of every column's parameter, rotations assumed."""
        return (
            *(LINK_UNITS * self.joints),
            *(term_of(term).unit for term in self.terms for _ in range(self.joints)),
        )

    def truth(self) -> Array:
        """The parameters the chain's own model has, shape (p,)."""
        fields = [term_of(term).known for term in self.terms]
        own = (getattr(self.chain, name) if name else np.zeros(self.joints) for name in fields)
        return np.concatenate([self.chain.parameters.ravel(), *own])

    def regressor(self, states: States) -> Array:
        """Regressor of all columns, shape (m, n, p)."""
        n = self.joints
        Y = np.zeros((len(states.q), n, self.columns))
        Y[:, :, : 10 * n] = rigid_regressor(self.chain.geometry, *states)
        diagonal = np.arange(n)
        load = np.zeros_like(states.q) if self.load is None else Y[:, :, : 10 * n] @ self.load
        for number, term in enumerate(self.terms):
            Y[:, diagonal, n * (10 + number) + diagonal] = term_of(term).value(states, load)
        return Y

    def regressor_slopes(self, states: States) -> Array:
        """Derivatives of the regressor by position, speed and acceleration of each joint, shape (m, 3 n, n,
        p)."""
        n = self.joints
        slopes = np.zeros((len(states.q), 3 * n, n, self.columns))
        slopes[..., : 10 * n] = regressor_derivatives(self.chain.geometry, *states)
        joints = np.arange(n)
        for number, term in enumerate(self.terms):
            known = term_of(term).slopes
            assert known is not None, f"no motion is designed for the term '{term}'"
            for part, slope in known.items():
                slopes[:, part * n + joints, joints, n * (10 + number) + joints] = slope(states)
        return slopes

    def torque(self, states: States, parameters: Array, columns: Indices | slice = slice(None)) -> Array:
        """Torques of parameters (r,) on some columns (r,), all if not given, piece by piece [N m], shape (m,
        n)."""
        parts = (states.rows(slice(first, first + PIECE)) for first in range(0, len(states.q), PIECE))
        return np.concatenate([self.regressor(part)[:, :, columns] @ parameters for part in parts])


def random_states(joints: int, count: int, rng: np.random.Generator) -> States:
    """States uniform in +-3 rad, +-3 rad/s and +-9 rad/s^2, shape (count, joints) each."""
    return States(*(rng.uniform(-size, size, (count, joints)) for size in (3.0, 3.0, 9.0)))
