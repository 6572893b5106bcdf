"""Paths and plans as files: every format in and out (layer between planning and motion)."""

from typing import TYPE_CHECKING

from polish_sim.lazy import names_on_use

if TYPE_CHECKING:
    from polish_sim.exchange.formats import FORMATS, check_formats, export_plan, read_path, read_way_points
    from polish_sim.exchange.plan_folder import path_csv, plan_facts, read_cuts, write_plan
    from polish_sim.exchange.strokes import ExportSetup, RobotTool
    from polish_sim.exchange.way_points import WayPoints, refuse_unknown
else:
    __getattr__ = names_on_use(__name__)
