"""A tool's whole frame: its tip from touches, its axes from moves (layer 8b)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.poses_checked import check_poses
from polish_sim.calibration.tool.orientation import (
    ToolOrientation,
    orientation_from_moves,
    orientation_from_three_points,
    tip_positions_flange,
)
from polish_sim.calibration.tool.point import ToolPointEstimate, fit_tool_point_without_outliers
from polish_sim.calibration.tool.touches import ToolTouches
from polish_sim.spatial import transform

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ToolMeasurements:
    """Touches of one fixed point, and moves of the tip along known directions of the tool."""

    touches: ToolTouches
    T_base_flange_moves: Array
    """Flange poses: start, then along +x, then in the x-z plane; or start and any moves; none if not measured,
    shape (m, 4, 4)."""
    moves_tool: Array | None = None
    """How far each lies from the start, tool axes [m], shape (m, 3); None for the three points."""

    def __post_init__(self) -> None:
        check_poses(self.T_base_flange_moves, "move")
        self.T_base_flange_moves.flags.writeable = False


@dataclass(frozen=True)
class ToolFrameEstimate:
    """Where the tool's tip is and how the tool stands, on the flange."""

    tip: ToolPointEstimate
    orientation: ToolOrientation | None
    """None if no moves were measured: the tool is then taken to stand as the flange does."""

    @property
    def T_flange_tool(self) -> Array:
        """Pose of the tool on the flange, shape (4, 4)."""
        R = np.eye(3) if self.orientation is None else self.orientation.R_flange_tool
        return transform(R, self.tip.point)


def fit_tool_frame(measured: ToolMeasurements, noise: float | None = None) -> ToolFrameEstimate:
    """Tip and axes of a tool; touches too far off to be noise are left out.

    Args:
        measured: Touches and moves.
        noise: Standard deviation of one coordinate of the tip [m]; None takes it from the touches' residuals.

    Returns:
        The estimate.

    Raises:
        CalibrationError: If poses or moves cannot tell the frame, or touches do not fit each other; with unknown noise
            also columns swapped and touches no tip explains.
    """
    tip = fit_tool_point_without_outliers(measured.touches, noise)
    if len(measured.T_base_flange_moves) == 0:
        return ToolFrameEstimate(tip, None)
    points = tip_positions_flange(measured.T_base_flange_moves, tip.point)
    if measured.moves_tool is None:
        return ToolFrameEstimate(tip, orientation_from_three_points(points, tip.noise))
    return ToolFrameEstimate(tip, orientation_from_moves(points, measured.moves_tool, tip.noise))
