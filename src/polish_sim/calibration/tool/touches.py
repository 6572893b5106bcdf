"""What a tool point is found from: flange poses with which the tool's tip touched one fixed point (layer 8b)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.poses_checked import check_poses

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ToolTouches:
    """Touches of one fixed point with the tip of the tool, in different orientations."""

    T_base_flange: Array
    """Pose of the flange at each touch [m], shape (n, 4, 4)."""

    def __post_init__(self) -> None:
        check_poses(self.T_base_flange, "touch")
        self.T_base_flange.flags.writeable = False

    def __len__(self) -> int:
        return len(self.T_base_flange)

    @property
    def R(self) -> Array:
        """R_base_flange, shape (n, 3, 3)."""
        return self.T_base_flange[:, :3, :3]

    @property
    def origins(self) -> Array:
        """Origins of the flange in the base frame [m], shape (n, 3)."""
        return self.T_base_flange[:, :3, 3]
