"""How good an information matrix is, in one number to be made small, and its gradient (layer 8d)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.information import inverse_of

Array = NDArray[np.float64]


class Judged(NamedTuple):
    """Value of an objective and its gradient by the information matrix."""

    value: float
    slope: Array
    """Symmetric, shape (r, r)."""


_NORM: Final = 12

Objective = Callable[[Array, Array], Judged]
"""From information H and the task's own matrix G (both (r, r)) to a value."""


def i_optimal(H: Array, G: Array) -> Judged:
    """Logarithm of the mean variance predicted on the task, log trace(H^-1 G)."""
    C = inverse_of(H)
    CG = C @ G
    mean = float(np.trace(CG))
    return Judged(float(np.log(mean)), -(CG @ C) / mean)


def d_optimal(H: Array, G: Array) -> Judged:
    """Mean logarithm of the variances along the principal axes, -log det(H) / r; it needs no task."""
    r = len(H)
    return Judged(-float(np.linalg.slogdet(H)[1]) / r, -inverse_of(H) / r)


def condition(H: Array, G: Array) -> Judged:
    """Logarithm of the condition number of the stacked regressor, what the paper makes small, by a smooth bound.

    The largest of the eigenvalues is replaced by their p-norm, so that the search does not stop where two meet.
    """
    values, vectors = np.linalg.eigh(H)
    values = np.maximum(values, 1e-12 * values[-1])
    high, low = (values / values[-1]) ** _NORM, (values[0] / values) ** _NORM
    value = 0.5 * (np.log(values[-1] / values[0]) + (np.log(high.sum()) + np.log(low.sum())) / _NORM)
    slopes = 0.5 * (high / high.sum() - low / low.sum()) / values
    return Judged(float(value), (vectors * slopes) @ vectors.T)


def condition_number(H: Array) -> float:
    """Condition number of the stacked regressor whose information is H."""
    values = np.linalg.eigvalsh(H)
    return float(np.sqrt(values[-1] / max(float(values[0]), 1e-300)))


class Choice(NamedTuple):
    """An objective and the noise that weighs the torques in it."""

    judge: Objective
    sigma: Callable[[Array], Array]
    """From the expected noise (n,) to the one that weighs."""


OBJECTIVES: Final[dict[str, Choice]] = {
    "i-optimal": Choice(i_optimal, np.asarray),
    "d-optimal": Choice(d_optimal, np.asarray),
    # The paper's: the regressor as it stands, in SI units.
    "condition": Choice(condition, np.ones_like),
}
"""Names a user may give."""
