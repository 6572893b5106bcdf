"""Base parameters: the combinations of parameters that torques can tell at all.

Columns of stacked regressors are taken in a fixed order; one that the earlier ones can make joins them in
combination: W_dependent = W_base K, theta = pi_base + K pi_dependent (paper 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.regressor import TorqueModel, random_states

Array = NDArray[np.float64]

INDEPENDENT: Final = 1e-8
"""A column is new if this share of its length stands off the earlier ones."""
_SAMPLES: Final = 200
_CLEAN: Final = 1e-9


class BaseParameters(NamedTuple):
    """Which columns stand for the rest."""

    columns: NDArray[np.int64]
    """Columns of the regressor that are kept, shape (r,)."""
    combination: Array
    """theta = combination @ pi, identity on the kept columns, shape (r, p)."""

    @property
    def rank(self) -> int:
        """Number of base parameters r."""
        return len(self.columns)

    def null_space(self) -> Array:
        """Orthonormal directions of pi that no torque tells, shape (p, p - r)."""
        return np.asarray(np.linalg.svd(self.combination)[2][self.rank :].T)


def base_of(model: TorqueModel, seed: int = 0) -> BaseParameters:
    """Base parameters of a model that may move freely."""
    states = random_states(model.joints, _SAMPLES, np.random.default_rng(seed))
    return base_of_rows(model.regressor(states).reshape(-1, model.columns))


def base_of_rows(W: Array) -> BaseParameters:
    """Base parameters of stacked regressor rows.

    Args:
        W: Rows of a regressor, shape (rows, p).

    Returns:
        Kept columns, and how the others join them.
    """
    R: Array = np.asarray(np.linalg.qr(W, mode="r")) if len(W) > W.shape[1] else W
    size = np.linalg.norm(R, axis=0)
    least = INDEPENDENT * float(size.max(initial=0.0))
    kept: list[int] = []
    basis = np.zeros((R.shape[0], 0))
    for column in np.flatnonzero(size > least):
        rest = R[:, column] / size[column]
        for _twice in range(2):
            rest = rest - basis @ (basis.T @ rest)
        length = float(np.linalg.norm(rest))
        if length > INDEPENDENT:
            kept.append(int(column))
            basis = np.column_stack([basis, rest / length])
    columns = np.array(kept, dtype=np.int64)
    scaled = R[:, columns] / size[columns]
    combination = np.linalg.lstsq(scaled, R, rcond=None)[0] / size[columns][:, None]
    combination[np.abs(combination) < _CLEAN] = 0.0
    combination[:, columns] = np.eye(len(columns))
    return BaseParameters(columns, combination)


def base_names(base: BaseParameters, names: Sequence[str]) -> tuple[str, ...]:
    """Write every base parameter as a sum: ``Izz2 + 0.181 m3 + ...``.

    Args:
        base: The base.
        names: A name for every column, shape (p,).
    """
    return tuple(_sum(row, int(column), names) for row, column in zip(base.combination, base.columns, strict=True))


def _sum(row: Array, own: int, names: Sequence[str]) -> str:
    text = names[own]
    for column in map(int, np.flatnonzero(row)):
        if column != own:
            size = "" if abs(abs(row[column]) - 1.0) < _CLEAN else f"{abs(row[column]):.4g} "
            text += f" {'-' if row[column] < 0 else '+'} {size}{names[column]}"
    return text


def identifiable(base: BaseParameters) -> tuple[str, ...]:
    """Whether torques tell each parameter: ``alone``, ``combined`` with others, or ``no``; shape (p,)."""
    hidden = np.linalg.norm(base.null_space(), axis=1)
    told = np.linalg.norm(base.combination, axis=0) > _CLEAN
    return tuple(
        "no" if not some else "alone" if off < 1e-7 else "combined" for some, off in zip(told, hidden, strict=True)
    )
