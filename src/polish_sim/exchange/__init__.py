"""Paths and plans as files: every format in and out (layer between planning and motion)."""

from polish_sim.exchange.plan_folder import write_plan
from polish_sim.exchange.reader import READERS, read_path

read_plan = read_path

__all__ = ["READERS", "read_path", "read_plan", "write_plan"]
