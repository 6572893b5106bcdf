"""A path made elsewhere gets a way down to its first point if it has none (ToolPath -> ToolPath)."""

from __future__ import annotations

import numpy as np

from polish_sim.planning.moves.approach import concatenate, landing, normal_lead, process_move
from polish_sim.planning.toolpath import ToolPath, arc_length


def with_way_down(path: ToolPath, clearance: float) -> ToolPath:
    """Let a path begin in the air: a tool that begins in contact cannot zero its force sensor.

    Args:
        path: The path.
        clearance: Height of the first point above the part along the tool axis [m].

    Returns:
        The path; as it is if it begins in the air.
    """
    if not path.process[0]:
        return path
    first = slice(0, 2)
    contact = process_move(path.positions_work[first], path.axes_work[first], path.pass_index[first])
    lead, above = landing(contact, True, normal_lead, clearance)
    positions, axes, segment, pass_index = concatenate([above, lead])
    positions = np.concatenate([positions, path.positions_work])
    before = (len(segment), 0)
    return ToolPath(
        positions,
        np.concatenate([axes, path.axes_work]),
        arc_length(positions),
        np.concatenate([pass_index, path.pass_index]),
        np.concatenate([segment, path.segment]),
        np.pad(path.curvature, before, mode="edge"),
        None if path.force is None else np.pad(path.force, before, mode="edge"),
        None if path.feed is None else np.pad(path.feed, before, mode="edge"),
    )
