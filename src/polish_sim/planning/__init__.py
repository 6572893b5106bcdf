"""From a region of a part's surface to a tool path that covers it (layer 5)."""

from polish_sim.planning.patterns import PATTERNS
from polish_sim.planning.planner import plan_path
from polish_sim.planning.toolpath import SEGMENTS, ToolPath, pressed

__all__ = ["PATTERNS", "SEGMENTS", "ToolPath", "plan_path", "pressed"]
