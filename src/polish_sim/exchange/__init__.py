"""Paths and plans as files: every format in and out (layer between planning and motion)."""

from polish_sim.exchange.formats import FORMATS, check_formats, export_plan
from polish_sim.exchange.plan_folder import write_plan
from polish_sim.exchange.reader import READERS, read_path, read_way_points
from polish_sim.exchange.setup import ExportSetup, RobotTool
from polish_sim.exchange.way_points import Unknown, WayPoints

__all__ = [
    "FORMATS",
    "READERS",
    "ExportSetup",
    "RobotTool",
    "Unknown",
    "WayPoints",
    "check_formats",
    "export_plan",
    "read_path",
    "read_way_points",
    "write_plan",
]
