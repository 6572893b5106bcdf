"""Paths and plans as files: every format in and out (layer between planning and motion)."""

from polish_sim.exchange.formats import FORMATS, check_formats, export_plan
from polish_sim.exchange.plan_folder import write_plan
from polish_sim.exchange.reader import READERS, read_path
from polish_sim.exchange.setup import ExportSetup, RobotTool

__all__ = [
    "FORMATS",
    "READERS",
    "ExportSetup",
    "RobotTool",
    "check_formats",
    "export_plan",
    "read_path",
    "write_plan",
]
