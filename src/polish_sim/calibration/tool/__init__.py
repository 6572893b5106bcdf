"""Calibration of the tool frame: tip from touches, axes from moves, poses that tell it (layer 8b)."""

from polish_sim.calibration.tool.frame import ToolFrameEstimate, ToolMeasurements, fit_tool_frame
from polish_sim.calibration.tool.identifiability import check_touches, orientation_spread
from polish_sim.calibration.tool.orientation import (
    ToolOrientation,
    orientation_from_moves,
    orientation_from_three_points,
    tip_positions_flange,
)
from polish_sim.calibration.tool.point import ToolPointEstimate, fit_tool_point, fit_tool_point_without_outliers
from polish_sim.calibration.tool.poses import plan_touch_orientations, point_error_bound
from polish_sim.calibration.tool.tool_file import (
    CalibratedToolFrame,
    read_tool_calibration,
    tool_figures,
    write_tool_calibration,
)
from polish_sim.calibration.tool.touches import ToolTouches
from polish_sim.calibration.tool.touches_file import read_tool_measurements, tool_table

__all__ = [
    "CalibratedToolFrame",
    "ToolFrameEstimate",
    "ToolMeasurements",
    "ToolOrientation",
    "ToolPointEstimate",
    "ToolTouches",
    "check_touches",
    "fit_tool_frame",
    "fit_tool_point",
    "fit_tool_point_without_outliers",
    "orientation_from_moves",
    "orientation_from_three_points",
    "orientation_spread",
    "plan_touch_orientations",
    "point_error_bound",
    "read_tool_calibration",
    "read_tool_measurements",
    "tip_positions_flange",
    "tool_figures",
    "tool_table",
    "write_tool_calibration",
]
