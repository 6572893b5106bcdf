"""Readings that a tool's weight does not explain: refused, and where it can be told, why (layer 8b)."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.identifiability import check_identifiable
from polish_sim.calibration.payload import BIAS, GRAVITY, MASS, PayloadEstimate, payload_regressor
from polish_sim.calibration.readings import PayloadReadings
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

LARGEST_REST = 0.3
"""Of the weight, what the forces may leave unexplained, rms."""
FARTHEST = 1.0
"""How far from the sensor's origin a tool's centre of mass may be [m]."""
_BETTER, _GOOD = 0.2, 0.05


def refuse_swapped_columns(readings: PayloadReadings) -> None:
    """Refuse forces or torques that follow a weight far better in another order or with other signs.

    Raises:
        CalibrationError: Naming what fits, or poses that tell nothing. Forces of the opposite sign all three are left
            to the fit, which says so.
    """
    check_identifiable(readings.up_sensor)
    X = payload_regressor(readings.up_sensor)
    forces, torques = [MASS, *range(BIAS.start, BIAS.start + 3)], [1, 2, 3, *range(BIAS.start + 3, BIAS.stop)]
    _refuse_swapped(X[:, :3, forces], readings.wrenches[:, :3], "f", lambda theta: theta[0] > 0.0)
    _refuse_swapped(X[:, 3:, torques], readings.wrenches[:, 3:], "t", lambda _: True)


def refuse_doubtful(readings: PayloadReadings, estimate: PayloadEstimate) -> None:
    """Refuse an estimate whose readings do not follow the tool's weight.

    Raises:
        CalibrationError: Forces that follow no weight, or a centre of mass where no tool has it.
    """
    weight = GRAVITY * estimate.mass
    rest = float(np.sqrt(np.mean(estimate.residuals[estimate.used, :3] ** 2)))
    if rest > LARGEST_REST * weight:
        raise CalibrationError(
            f"the forces do not follow a tool's weight: {rest:.3g} N rms are left of the {weight:.3g} N that fit best. "
            "Are units mixed, lines of several tools in one file, or the orientations not those of the readings?"
        )
    far = float(np.linalg.norm(estimate.center))
    if far > FARTHEST:
        raise CalibrationError(
            f"the tool's centre of mass comes out {far:.3g} m from the sensor: are the torques in N m, as the header "
            "says, and about the sensor's origin?"
        )


def _refuse_swapped(X: Array, y: Array, letter: str, possible: Callable[[Array], bool]) -> None:
    """Refuse three columns that fit five times better in another order or with other signs."""
    left = _left(X, y)[0]
    if left < _GOOD * float(np.std(y - y.mean(axis=0))):
        return
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order == (0, 1, 2) and max(signs) < 0.0:
            continue
        rest, theta = _left(X, y[:, order] * signs)
        if rest < _BETTER * left and possible(theta):
            named = ", ".join(
                ("-" if s < 0.0 else "") + letter + "xyz"[axis] for axis, s in zip(order, signs, strict=True)
            )
            raise CalibrationError(
                f"{letter}x, {letter}y, {letter}z follow the tool's weight far better if they are read as {named}: "
                "columns are swapped, a sign is lost, or the sensor stands otherwise than its orientations say."
            )


def _left(X: Array, y: Array) -> tuple[float, Array]:
    """What a fit leaves, rms, and the fit."""
    theta: Array = np.linalg.lstsq(X.reshape(-1, X.shape[2]), y.ravel(), rcond=None)[0].astype(np.float64)
    return float(np.sqrt(np.mean((y - X @ theta) ** 2))), theta
