"""From base parameters to full ones a real body can have: pseudo-inertia above zero, friction not below.

A body's pseudo-inertia J = [[Sigma, m c], [m c^T, m]], Sigma = tr(I)/2 - I, is positive exactly if a
distribution of mass has these parameters. J = L L^T + a share of the drawing's, so every fit is consistent;
directions without effect on torques stay at the drawing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from polish_sim.arrays import Array
from polish_sim.identification.estimate import INTERVAL_95, BaseParameters, Estimate, base_names, identifiable
from polish_sim.identification.regressor import FULL, TorqueModel
from polish_sim.motion.serial_chain import inertia_at_origin, packed
from polish_sim.tables import csv_text

_FLOOR = 1e-3  #: Share of the drawing's pseudo-inertia every link keeps
_THIN = 1e-9  #: Share of its size a drawn body is thickened by, so that it has a root
_PRIOR = 1.0  #: How far from the drawing parameters are expected, in sizes of the drawing's
_LOWER = np.tril_indices(4)
_NOT_NEGATIVE = ("coulomb", "viscous", "armature", "load")


def pseudo_inertia(parameters: Array) -> Array:
    """Pseudo-inertia of ten parameters, shape (4, 4)."""
    I = inertia_at_origin(parameters)  # noqa: E741
    J = np.empty((4, 4))
    J[:3, :3] = 0.5 * np.trace(I) * np.eye(3) - I
    J[:3, 3] = J[3, :3] = parameters[1:4]
    J[3, 3] = parameters[0]
    return J


def parameters_of(J: Array) -> Array:
    """Ten parameters of a pseudo-inertia (4, 4), shape (10,)."""
    return np.array([J[3, 3], *J[:3, 3], *packed(np.trace(J[:3, :3]) * np.eye(3) - J[:3, :3])])


def is_consistent(parameters: Array) -> bool:
    """Whether every link's parameters (n, 10) belong to a body with mass everywhere positive, or to no body
    at all."""
    return all(float(np.linalg.eigvalsh(pseudo_inertia(link))[0]) > 0.0 for link in parameters if link.any())


@dataclass(frozen=True)
class Drawing:
    """What is believed of the robot before it is identified."""

    parameters: Array  #: All parameters of the torque model, physically consistent, shape (p,)
    carried: Array  #: Part of the links' parameters that is known and stays, such as a tool's, shape (n, 10)


def fit_consistent(model: TorqueModel, base: BaseParameters, found: Estimate, drawing: Drawing) -> Array:
    """Full parameters (p,) nearest to the estimated base, in its own covariance, that a body can have.

    Directions without effect on torques stay at the drawing.
    """
    fit = _ConsistentFit(model, drawing)
    correlation = found.covariance / np.outer(found.std, found.std)
    whiten = np.linalg.cholesky(np.linalg.inv(correlation)).T / found.std
    size = fit.sizes()

    def residuals(x: Array) -> Array:
        pi = fit.parameters(x)
        return np.concatenate(
            [whiten @ (base.combination @ pi - found.theta), (pi - drawing.parameters) / size]
        )

    def slopes(x: Array) -> Array:
        J = fit.slopes(x)
        return np.vstack([whiten @ base.combination @ J, J / size[:, None]])

    return fit.parameters(least_squares(residuals, fit.start(), jac=slopes, x_scale="jac", max_nfev=200).x)


class _ConsistentFit:
    """Parameters as a function of free numbers: ten of L for each link, square roots of friction, offsets."""

    def __init__(self, model: TorqueModel, drawing: Drawing) -> None:
        self._model, self._drawing = model, drawing
        n = model.joints
        own = drawing.parameters[: 10 * n].reshape(n, 10) - drawing.carried
        self._drawn = [pseudo_inertia(link) for link in own]
        self._not_negative = np.repeat([term in _NOT_NEGATIVE for term in model.terms], n)

    def start(self) -> Array:
        """The numbers of the drawing."""
        links = [_root(J)[_LOWER] for J in self._drawn]
        friction = self._drawing.parameters[10 * self._model.joints :]
        return np.concatenate(
            [*links, np.where(self._not_negative, np.sqrt(np.maximum(friction, 1e-4)), friction)]
        )

    def parameters(self, x: Array) -> Array:
        """All parameters, shape (p,)."""
        n = self._model.joints
        links = []
        for number, numbers in enumerate(x[: 10 * n].reshape(n, 10)):
            L = _lower(numbers)
            links.append(
                parameters_of(L @ L.T + _FLOOR * self._drawn[number]) + self._drawing.carried[number]
            )
        friction = x[10 * n :]
        return np.concatenate([*links, np.where(self._not_negative, friction**2, friction)])

    def slopes(self, x: Array) -> Array:
        """Derivatives of the parameters by the numbers, shape (p, p)."""
        n = self._model.joints
        J = np.zeros((len(x), len(x)))
        for number, numbers in enumerate(x[: 10 * n].reshape(n, 10)):
            L, first = _lower(numbers), 10 * number
            for k, (row, column) in enumerate(zip(*_LOWER, strict=True)):
                E = np.zeros((4, 4))
                E[row] = L[:, column]
                J[first : first + 10, first + k] = parameters_of(E + E.T)
        rest = np.arange(10 * n, len(x))
        J[rest, rest] = np.where(self._not_negative, 2.0 * x[10 * n :], 1.0)
        return J

    def sizes(self) -> Array:
        """How far every parameter is expected from the drawing, shape (p,)."""
        n = self._model.joints
        sizes = np.abs(self._drawing.parameters).copy()
        for number, link in enumerate(self._drawing.parameters[: 10 * n].reshape(n, 10)):
            inertia = 0.5 * float(link[[4, 6, 9]].sum())
            arm = np.sqrt(inertia * link[0])
            sizes[10 * number : 10 * number + 10] = [link[0], *[arm] * 3, *[inertia] * 6]
        # No drawing tells of a gear's friction: it may be as large as Coulomb's.
        friction = sizes[10 * n :].reshape(-1, n)
        friction[len(FULL) :] = friction[:1]
        return _PRIOR * np.maximum(sizes, 0.1)


def _root(J: Array) -> Array:
    """L of a drawn pseudo-inertia less its floor; a body without thickness gets some, none at all stays
    none."""
    size = float(np.trace(J))
    if size <= 0.0:
        return np.zeros((4, 4))
    thick = J + _THIN * np.diag([size - J[3, 3]] * 3 + [J[3, 3]])
    return np.asarray(np.linalg.cholesky((1.0 - _FLOOR) * thick))


def _lower(numbers: Array) -> Array:
    L = np.zeros((4, 4))
    L[_LOWER] = numbers
    return L


COLUMNS = ("name", "value", "unit", "std", "identifiable", "low_95", "high_95", "true_value")


class ParameterRow(NamedTuple):
    """One number; NaN where there is none."""

    name: str
    value: float
    unit: str
    std: float
    identifiable: str  #: ``base`` for a base parameter; else ``alone``, ``combined`` or ``no``
    true_value: float


def parameter_rows(
    model: TorqueModel, base: BaseParameters, found: Estimate, full: Array, truth: Array | None
) -> list[ParameterRow]:
    """All numbers of an identification, with their true values (p,) where these are known."""
    true_base = np.full(base.rank, np.nan) if truth is None else base.combination @ truth
    true_full = np.full(model.columns, np.nan) if truth is None else truth
    rows = [
        ParameterRow(name, found.theta[k], model.units[base.columns[k]], found.std[k], "base", true_base[k])
        for k, name in enumerate(base_names(base, model.names))
    ]
    kinds, std = identifiable(base), alone_std(base, found)
    for k, name in enumerate(model.names):
        own = std[k] if kinds[k] == "alone" else np.nan
        rows.append(ParameterRow(name, full[k], model.units[k], own, kinds[k], true_full[k]))
    return rows


def alone_std(base: BaseParameters, found: Estimate) -> Array:
    """Standard deviation of every parameter as far as it is identifiable, shape (p,)."""
    back = np.linalg.pinv(base.combination)
    return np.sqrt(np.einsum("pr,rs,ps->p", back, found.covariance, back))


def parameters_csv(rows: list[ParameterRow]) -> str:
    """The rows as CSV; what is not known is empty."""
    table = []
    for row in rows:
        half = INTERVAL_95 * row.std
        ends = (row.value - half, row.value + half, row.true_value)
        low, high, true = ("" if np.isnan(value) else f"{value:.9g}" for value in ends)
        std = "" if np.isnan(row.std) else f"{row.std:.4g}"
        table.append([row.name, f"{row.value:.9g}", row.unit, std, row.identifiable, low, high, true])
    return csv_text(COLUMNS, table)
