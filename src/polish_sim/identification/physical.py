"""From base parameters to full ones a real body can have: pseudo-inertia above zero, friction not below.

A body's pseudo-inertia J = [[Sigma, m c], [m c^T, m]], Sigma = tr(I)/2 - I, is positive exactly if a
distribution of mass has these parameters: the nearest consistent ones solve a semidefinite programme
(Wensing, Kim and Slotine 2018). Directions without effect on torques stay at the drawing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import clarabel
import numpy as np
from scipy import sparse

from polish_sim.arrays import Array, Indices
from polish_sim.errors import IdentificationError
from polish_sim.identification.estimate import INTERVAL_95, BaseParameters, Estimate, base_names, identifiable
from polish_sim.identification.regressor import FULL, TorqueModel
from polish_sim.motion.serial_chain import inertia_at_origin
from polish_sim.tables import csv_text

_FLOOR = 1e-3  #: Share of the drawing's pseudo-inertia every link keeps
_THIN = 1e-6  #: And share of its size by which it stays above zero
_UPPER = np.tril_indices(4)[::-1]  #: Column by column
_NOT_NEGATIVE = ("coulomb", "viscous", "armature", "load")


def pseudo_inertia(parameters: Array) -> Array:
    """Pseudo-inertia of ten parameters, shape (4, 4)."""
    I = inertia_at_origin(parameters)  # noqa: E741
    J = np.empty((4, 4))
    J[:3, :3] = 0.5 * np.trace(I) * np.eye(3) - I
    J[:3, 3] = J[3, :3] = parameters[1:4]
    J[3, 3] = parameters[0]
    return J


def is_consistent(parameters: Array) -> bool:
    """Whether every link's parameters (n, 10) belong to a body with mass everywhere positive, or to no body
    at all."""
    return all(np.linalg.eigvalsh(pseudo_inertia(link))[0] > 0.0 for link in parameters if link.any())


@dataclass(frozen=True)
class Drawing:
    """What is believed of the robot before it is identified."""

    parameters: Array  #: All parameters of the torque model, physically consistent, shape (p,)
    carried: Array  #: Part of the links' parameters that is known and stays, such as a tool's, shape (n, 10)


def fit_consistent(model: TorqueModel, base: BaseParameters, found: Estimate, drawing: Drawing) -> Array:
    """Full parameters (p,) nearest to the estimated base, in its own covariance, that a body can have.

    Directions without effect on torques stay at the drawing.

    Raises:
        IdentificationError: The programme has no solution to working precision.
    """
    n = model.joints
    believed = drawing.parameters
    correlation = found.covariance / np.outer(found.std, found.std)
    whiten = np.linalg.cholesky(np.linalg.inv(correlation)).T / found.std
    size = _sizes(believed, n)
    drawn = [pseudo_inertia(link) for link in believed[: 10 * n].reshape(n, 10) - drawing.carried]
    return nearest_bodies(
        np.vstack([whiten @ base.combination, np.diag(1.0 / size)]),
        np.concatenate([whiten @ found.theta, believed / size]),
        size,
        [
            pseudo_inertia(carried) + _FLOOR * own if own.any() else None
            for carried, own in zip(drawing.carried, drawn, strict=True)
        ],
        10 * n + np.flatnonzero(np.repeat([term in _NOT_NEGATIVE for term in model.terms], n)),
    )


def nearest_bodies(
    rows: Array, wanted: Array, size: Array, least: Sequence[Array | None], not_negative: Indices
) -> Array:
    """Parameters x (p,) with the least |rows x - wanted| among those that bodies can have: a semidefinite
    programme.

    The first ten are the first link's, and so on. Its pseudo-inertia less the one in ``least`` (4, 4) stays
    above zero; a link without one has no body. ``size`` (p,): about how large parameters are; the numbers
    ``not_negative`` are none below zero.

    Raises:
        IdentificationError: It has no solution to working precision.
    """
    count, free, every = len(wanted), len(size), np.diag(size)
    blocks, limits, cones = [np.hstack([rows * size, -np.eye(count)])], [wanted], [clarabel.ZeroConeT(count)]

    def hold(cone: Any, block: Array, limit: Array) -> None:
        blocks.append(np.hstack([block, np.zeros((len(block), count))]))
        limits.append(limit)
        cones.append(cone)

    hold(clarabel.NonnegativeConeT(len(not_negative)), -every[not_negative], np.zeros(len(not_negative)))
    for own, floor in zip(every[: 10 * len(least)].reshape(-1, 10, free), least, strict=True):
        if floor is None:
            hold(clarabel.ZeroConeT(10), own, np.zeros(10))
            continue
        scale = 1.0 / np.sqrt([*[own[4].max()] * 3, own[0].max()])
        turn = np.outer(scale, scale)[_UPPER] * np.where(_UPPER[0] == _UPPER[1], 1.0, math.sqrt(2.0))
        shape = np.array([pseudo_inertia(unit)[_UPPER] * turn for unit in np.eye(10)]).T
        thin = _THIN * (_UPPER[0] == _UPPER[1])
        hold(clarabel.PSDTriangleConeT(4), -shape @ own, -floor[_UPPER] * turn - thin)
    quiet = clarabel.DefaultSettings()
    quiet.verbose = False
    cost = sparse.diags_array(np.repeat([0.0, 1.0], [free, count]), format="csc")
    solved = clarabel.DefaultSolver(
        cost,
        np.zeros(free + count),
        sparse.csc_array(np.vstack(blocks)),
        np.concatenate(limits),
        cones,
        quiet,
    ).solve()
    if str(solved.status) not in ("Solved", "AlmostSolved"):
        raise IdentificationError(f"no bodies fit what was estimated: {solved.status}.")
    return size * np.array(solved.x[:free])


def _sizes(believed: Array, n: int) -> Array:
    """How far every parameter is expected from the drawing, shape (p,)."""
    sizes = np.abs(believed)
    for number, link in enumerate(believed[: 10 * n].reshape(n, 10)):
        inertia = 0.5 * link[[4, 6, 9]].sum()
        arm = np.sqrt(inertia * link[0])
        sizes[10 * number : 10 * number + 10] = [link[0], *[arm] * 3, *[inertia] * 6]
    # No drawing states a gear's friction: it may be as large as Coulomb's.
    friction = sizes[10 * n :].reshape(-1, n)
    friction[len(FULL) :] = friction[:1]
    return np.maximum(sizes, 0.1)


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
    kinds = identifiable(base)
    back = np.linalg.pinv(base.combination)
    std = np.sqrt(np.einsum("pr,rs,ps->p", back, found.covariance, back))
    for k, name in enumerate(model.names):
        own = std[k] if kinds[k] == "alone" else np.nan
        rows.append(ParameterRow(name, full[k], model.units[k], own, kinds[k], true_full[k]))
    return rows


def parameters_csv(rows: list[ParameterRow]) -> str:
    """The rows as CSV; what is not known is empty."""
    table = []
    for row in rows:
        half = INTERVAL_95 * row.std
        low, high, true = map(cell, (row.value - half, row.value + half, row.true_value))
        table.append(
            [row.name, f"{row.value:.9g}", row.unit, cell(row.std, 4), row.identifiable, low, high, true]
        )
    return csv_text(COLUMNS, table)


def cell(value: float, digits: int = 9) -> str:
    """A number in a table; empty where it is not known."""
    return "" if np.isnan(value) else f"{value:.{digits}g}"
