"""Identified numbers as rows: base parameters with their intervals, then what a body could have (layer 8d)."""

from __future__ import annotations

import csv
import io
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.base_parameters import BaseParameters, base_names, identifiable
from polish_sim.identification.estimate import INTERVAL_95, Estimate
from polish_sim.identification.torque_model import TorqueModel

Array = NDArray[np.float64]

COLUMNS: Final = ("name", "value", "unit", "std", "identifiable", "low_95", "high_95", "true_value")


class ParameterRow(NamedTuple):
    """One number; NaN where there is none."""

    name: str
    value: float
    unit: str
    std: float
    identifiable: str
    """``base`` for a combination that torques tell; else ``alone``, ``combined`` or ``no``."""
    true_value: float


def parameter_rows(
    model: TorqueModel, base: BaseParameters, found: Estimate, full: Array, truth: Array | None
) -> list[ParameterRow]:
    """All numbers of an identification.

    Args:
        model: The torque model.
        base: Its base.
        found: The base parameters.
        full: Physically consistent parameters, shape (p,).
        truth: True parameters, if known, shape (p,).
    """
    true_base = np.full(base.rank, np.nan) if truth is None else base.combination @ truth
    true_full = np.full(model.columns, np.nan) if truth is None else truth
    rows = [
        ParameterRow(name, found.theta[k], model.units[base.columns[k]], found.std[k], "base", true_base[k])
        for k, name in enumerate(base_names(base, model.names))
    ]
    told, std = identifiable(base), alone_std(base, found)
    for k, name in enumerate(model.names):
        own = std[k] if told[k] == "alone" else np.nan
        rows.append(ParameterRow(name, full[k], model.units[k], own, told[k], true_full[k]))
    return rows


def alone_std(base: BaseParameters, found: Estimate) -> Array:
    """Standard deviation of every parameter as far as torques tell it, shape (p,)."""
    back = np.linalg.pinv(base.combination)
    return np.asarray(np.sqrt(np.einsum("pr,rs,ps->p", back, found.covariance, back)))


def parameters_csv(rows: list[ParameterRow]) -> str:
    """The rows as CSV; what is not known is empty."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    for row in rows:
        half = INTERVAL_95 * row.std
        ends = (row.value - half, row.value + half, row.true_value)
        low, high, true = ("" if np.isnan(value) else f"{value:.9g}" for value in ends)
        std = "" if np.isnan(row.std) else f"{row.std:.4g}"
        table.writerow([row.name, f"{row.value:.9g}", row.unit, std, row.identifiable, low, high, true])
    return out.getvalue()
