"""Calibration of base frames: circles of single axes, matched points, one base in another (layer 8b)."""

from polish_sim.calibration.frames.axes import BaseFrame, base_from_circles, base_from_meeting_axes
from polish_sim.calibration.frames.circle import GOOD_ARC, Circle, fit_circle, fit_circle_without_outliers
from polish_sim.calibration.frames.matched_points import FrameEstimate, fit_frame, fit_frame_without_outliers
from polish_sim.calibration.frames.relative import point_covariance, relative_frame

__all__ = [
    "GOOD_ARC",
    "BaseFrame",
    "Circle",
    "FrameEstimate",
    "base_from_circles",
    "base_from_meeting_axes",
    "fit_circle",
    "fit_circle_without_outliers",
    "fit_frame",
    "fit_frame_without_outliers",
    "point_covariance",
    "relative_frame",
]
