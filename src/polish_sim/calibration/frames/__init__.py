"""Calibration of base frames: circles of single axes, matched points, one base in another (layer 8b)."""

from polish_sim.calibration.frames.axes import BaseFrame, base_from_circles, base_from_meeting_axes
from polish_sim.calibration.frames.base_file import (
    CalibratedBases,
    base_figures,
    read_base_calibration,
    write_base_calibration,
)
from polish_sim.calibration.frames.circle import GOOD_ARC, Circle, fit_circle, fit_circle_without_outliers
from polish_sim.calibration.frames.matched_points import FrameEstimate, fit_frame, fit_frame_without_outliers
from polish_sim.calibration.frames.measurements import (
    ROBOTS,
    AxisArcs,
    BaseCalibration,
    BaseMeasurements,
    Group,
    Handshake,
    TrackedPoses,
)
from polish_sim.calibration.frames.measurements_file import METHODS, method_named, read_base_measurements
from polish_sim.calibration.frames.relative import point_covariance, relative_frame

__all__ = [
    "GOOD_ARC",
    "METHODS",
    "ROBOTS",
    "AxisArcs",
    "BaseCalibration",
    "BaseFrame",
    "BaseMeasurements",
    "CalibratedBases",
    "Circle",
    "FrameEstimate",
    "Group",
    "Handshake",
    "TrackedPoses",
    "base_figures",
    "base_from_circles",
    "base_from_meeting_axes",
    "fit_circle",
    "fit_circle_without_outliers",
    "fit_frame",
    "fit_frame_without_outliers",
    "method_named",
    "point_covariance",
    "read_base_calibration",
    "read_base_measurements",
    "relative_frame",
    "write_base_calibration",
]
