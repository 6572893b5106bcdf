"""Calibration of an arm's own table: errors of its Denavit-Hartenberg parameters (layer 8b)."""

from polish_sim.calibration.arm.fit import ArmEstimate, Tolerance, TrackedArm, fit_arm, fit_placement
from polish_sim.calibration.arm.pair import PairTables, fit_pair, pair_figures
from polish_sim.calibration.arm.pair_file import CalibratedArms, read_arm_calibration, write_arm_calibration
from polish_sim.calibration.arm.tracked_file import read_tracked, tracked_table
from polish_sim.motion.arm_table import NOMINAL, arm_frames, table_slopes

__all__ = [
    "NOMINAL",
    "ArmEstimate",
    "CalibratedArms",
    "PairTables",
    "Tolerance",
    "TrackedArm",
    "arm_frames",
    "fit_arm",
    "fit_pair",
    "fit_placement",
    "pair_figures",
    "read_arm_calibration",
    "read_tracked",
    "table_slopes",
    "tracked_table",
    "write_arm_calibration",
]
