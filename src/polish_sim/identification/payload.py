"""A payload as one more body on the last link: its mass, centre and inertia from a second run (layer 8d).

tau_loaded = Y theta + Y_n pi: the last link's own ten columns Y_n, beside the base parameters theta of the arm, which
the run without payload tells; or theta known beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from polish_sim.identification.base_parameters import BaseParameters
from polish_sim.identification.estimate import estimate, require_told
from polish_sim.identification.information import JointSums, sum_samples
from polish_sim.identification.physical import is_consistent, parameters_of, pseudo_inertia
from polish_sim.identification.torque_model import States, TorqueModel
from polish_sim.motion.serial_chain import LINK_PARAMETERS, inertia_at_origin

Array = NDArray[np.float64]

BODY_NAMES: Final = ("mass", "center_x", "center_y", "center_z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
BODY_UNITS: Final = ("kg", "m", "m", "m", *["kg m^2"] * 6)
_LOWER: Final = np.tril_indices(4)
_THIN: Final = 1e-6
"""Share of its size a body that cannot exist is thickened by before the nearest that can is searched."""


class Body(NamedTuple):
    """Mass, centre and inertia about the centre in the last link's own frame, as `BODY_NAMES`; shape (10,) each."""

    values: Array
    std: Array


@dataclass(frozen=True)
class Payload:
    """What a robot carries, about the origin of its last joint and in the axes of its last link."""

    parameters: Array
    """As `LINK_PARAMETERS`, shape (10,)."""
    covariance: Array
    """Shape (10, 10)."""
    origin: Array
    """Of the last joint, in the link's own frame [m], shape (3,)."""

    @property
    def std(self) -> Array:
        """Standard deviations, shape (10,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def body(self) -> Body:
        """Mass, centre and inertia about the centre, the deviations carried over to first order."""
        step = 1e-30
        slopes = [body_of(self.parameters + 1j * step * unit, self.origin).imag / step for unit in np.eye(10)]
        J = np.stack(slopes, axis=1)
        return Body(body_of(self.parameters, self.origin), np.sqrt(np.diag(J @ self.covariance @ J.T)))

    def nearest_body(self) -> Array:
        """The nearest parameters, in the estimate's own covariance, that a body can have, shape (10,)."""
        if is_consistent(self.parameters[None]):
            return self.parameters
        whiten = np.linalg.cholesky(np.linalg.inv(self.covariance)).T
        values, vectors = np.linalg.eigh(pseudo_inertia(self.parameters))
        lifted = (vectors * np.maximum(values, _THIN * max(values[-1], self.std[0]))) @ vectors.T

        def body(x: Array) -> Array:
            L = np.zeros((4, 4))
            L[_LOWER] = x
            return parameters_of(L @ L.T + _THIN * np.diag(np.diag(lifted)))

        start = np.linalg.cholesky(lifted)[_LOWER]
        return body(least_squares(lambda x: whiten @ (body(x) - self.parameters), start, x_scale="jac").x)


def body_of(parameters: Array, origin: Array) -> Array:
    """Mass, centre and inertia about the centre of ten parameters about an origin (3,), shape (10,)."""
    mass, center = parameters[0], parameters[1:4] / parameters[0]
    I = inertia_at_origin(parameters) - mass * ((center @ center) * np.eye(3) - np.outer(center, center))  # noqa: E741
    return np.array([mass, *(center + origin), I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]])


def fit_payload(
    model: TorqueModel, base: BaseParameters, empty: JointSums, states: States, torque: Array
) -> Payload:  # fmt: skip
    """Estimate a payload from two runs, arm and payload at once.

    Args:
        model: The torque model of the arm.
        base: Its base.
        empty: What the run without payload says, in the base.
        states: States with it, shape (m, n) each.
        torque: Torques with it [N m], shape (m, n).

    Raises:
        IdentificationError: The motions do not tell everything; names what stays unknown.
    """
    both = BaseParameters(np.append(base.columns, _last_link(model)), np.zeros((0, 0)))
    sums = sum_samples(model, both, states, torque).plus(_widened(empty, 10))
    names = [model.names[column] for column in base.columns] + [f"payload {name}" for name in LINK_PARAMETERS]
    require_told(sums, names, model)
    found = estimate(sums)
    return Payload(found.theta[-10:], found.covariance[-10:, -10:], model.chain.origins[-1])


def fit_payload_on_known_arm(
    model: TorqueModel, base: BaseParameters, theta: Array, states: States, torque: Array
) -> Payload:
    """Estimate a payload from one run; the intervals count noise only, as if the arm were known exactly.

    Args:
        model: The torque model of the arm.
        base: Its base.
        theta: Its base parameters, shape (r,).
        states: States with the payload, shape (m, n) each.
        torque: Torques with it [N m], shape (m, n).

    Raises:
        IdentificationError: The motion does not tell everything; names what stays unknown.
    """
    alone = BaseParameters(_last_link(model), np.zeros((0, 0)))
    left = torque - model.torque_of_base(states, base.columns, theta)
    sums = sum_samples(model, alone, states, left)
    require_told(sums, [f"payload {name}" for name in LINK_PARAMETERS], model)
    found = estimate(sums)
    return Payload(found.theta, found.covariance, model.chain.origins[-1])


def _last_link(model: TorqueModel) -> NDArray[np.int64]:
    return np.arange(10 * (model.joints - 1), 10 * model.joints)


def _widened(sums: JointSums, more: int) -> JointSums:
    """The same samples, telling nothing of some more columns."""
    squares = np.pad(sums.squares, ((0, 0), (0, more), (0, more)))
    return sums._replace(squares=squares, products=np.pad(sums.products, ((0, 0), (0, more))))
