"""What a calibration of the payload is made from: how the sensor stood and what it read (layer 8b)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

ROTATION_TOLERANCE = 1e-3
"""How far R^T R may be from one: the rounding of printed digits."""


@dataclass(frozen=True)
class PayloadReadings:
    """Readings of a wrist sensor that carries a tool at rest, nothing touching it."""

    time: Array
    """When each was taken [s], shape (n,)."""
    R_base_sensor: Array
    """How the sensor stood, base z up, shape (n, 3, 3)."""
    wrenches: Array
    """What it read, sensor axes, about the sensor's origin: sum of m (a - g), so a tool below a sensor that looks
    down pulls with -m g along its z axis; force [N] then torque [N m], shape (n, 6)."""

    def __post_init__(self) -> None:
        count = len(self.time)
        shapes = (self.time.shape, self.R_base_sensor.shape, self.wrenches.shape)
        if shapes != ((count,), (count, 3, 3), (count, 6)):
            raise CalibrationError(f"readings need times (n,), rotations (n, 3, 3), wrenches (n, 6); got {shapes}.")
        if not all(np.isfinite(a).all() for a in (self.time, self.R_base_sensor, self.wrenches)):
            raise CalibrationError("a reading holds a value that is not finite: leave it out.")
        turned = np.swapaxes(self.R_base_sensor, 1, 2) @ self.R_base_sensor
        wrong = np.abs(turned - np.eye(3)).max(axis=(1, 2), initial=0.0) > ROTATION_TOLERANCE
        wrong |= np.linalg.det(self.R_base_sensor) < 0.0
        if wrong.any():
            raise CalibrationError(f"the orientation of reading {int(np.argmax(wrong)) + 1} is not a rotation matrix.")
        for array in (self.time, self.R_base_sensor, self.wrenches):
            array.flags.writeable = False

    def __len__(self) -> int:
        return len(self.time)

    @property
    def up_sensor(self) -> Array:
        """Unit vectors against gravity in the sensor frame, shape (n, 3)."""
        return self.R_base_sensor[:, 2, :]

    def rows(self, mask: NDArray[np.bool_]) -> PayloadReadings:
        """Some of the readings."""
        return PayloadReadings(self.time[mask].copy(), self.R_base_sensor[mask].copy(), self.wrenches[mask].copy())
