"""Whether poses tell a tool's weight from the sensor's bias, and how well (layer 8b)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

LEAST_READINGS = 3
LEAST_SPREAD = 0.02
"""Least spread of the up directions along two axes [-]; 1/sqrt(3) is that of a full sphere."""
LARGEST_CONDITION = 1e5
"""Of the whole regressor; beyond it the drift cannot be told from the rest."""


def check_identifiable(up_sensor: Array) -> None:
    """Refuse poses from which mass, centre and bias cannot be told apart.

    A weight shows only by how its direction changes in the sensor: readings differ by m g times the difference of
    two up directions and by its moment. Differences along one line leave the centre along that line unseen.

    Args:
        up_sensor: Unit vectors against gravity in the sensor frame, shape (n, 3).

    Raises:
        CalibrationError: Saying what cannot be told and which pose is missing.
    """
    count = len(up_sensor)
    if count < LEAST_READINGS:
        raise CalibrationError(
            f"{count} reading{'s' if count != 1 else ''} cannot tell mass, centre and bias (10 unknowns) apart: "
            f"{LEAST_READINGS} poses with gravity along different axes of the sensor are the least, a dozen is good."
        )
    _, spread, axes = np.linalg.svd(up_sensor - up_sensor.mean(axis=0), full_matrices=False)
    spread = spread / np.sqrt(count)
    if spread[0] < LEAST_SPREAD:
        raise CalibrationError(
            f"gravity pulls in nearly the same direction of the sensor in all {count} poses (they differ by "
            f"{np.degrees(spread[0]):.2g} deg rms): neither mass nor centre can be told from the bias. Turn the tool: "
            "sideways, over head, about its own axis."
        )
    if spread[1] < LEAST_SPREAD:
        x, y, z = axes[0]
        raise CalibrationError(
            f"gravity changes along one line of the sensor only, ({x:.2f}, {y:.2f}, {z:.2f}): the centre of mass along "
            "it cannot be told from the torque bias. Add a pose that turns the tool about another axis."
        )


def condition_of(regressor: Array) -> float:
    """Condition number of a regressor without units: ratio of the largest to the smallest singular value.

    Best possible for the ten parameters: sqrt(3/2) = 1.22, from up directions spread over the whole sphere.

    Args:
        regressor: As in ``payload_regressor`` with gravity 1, shape (n, 6, p).
    """
    values = np.linalg.svd(regressor.reshape(-1, regressor.shape[2]), compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")
