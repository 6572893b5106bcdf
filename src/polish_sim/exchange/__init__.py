"""Paths and plans as files: every format in and out (layer between planning and motion)."""

from polish_sim.exchange.formats import FORMATS, check_formats, export_plan
from polish_sim.exchange.plan_folder import path_csv, write_plan
from polish_sim.exchange.reader import READERS, read_path, read_way_points
from polish_sim.exchange.setup import ExportSetup, RobotTool
from polish_sim.exchange.way_points import Unknown, WayPoints, refuse_unknown

__all__ = [
    "FORMATS",
    "READERS",
    "ExportSetup",
    "RobotTool",
    "Unknown",
    "WayPoints",
    "check_formats",
    "export_plan",
    "path_csv",
    "read_path",
    "read_way_points",
    "refuse_unknown",
    "write_plan",
]
