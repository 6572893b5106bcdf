"""Calibration of an arm's own table: errors of its Denavit-Hartenberg parameters (layer 8b)."""

from polish_sim.calibration.arm.fit import ArmEstimate, Tolerance, TrackedArm, fit_arm, fit_placement
from polish_sim.calibration.arm.table import NOMINAL, arm_frames, table_slopes

__all__ = [
    "NOMINAL",
    "ArmEstimate",
    "Tolerance",
    "TrackedArm",
    "arm_frames",
    "fit_arm",
    "fit_placement",
    "table_slopes",
]
