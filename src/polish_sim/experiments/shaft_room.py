"""Whether the pad's shaft has room on a path, before anything moves (layer 9)."""

from __future__ import annotations

from typing import Final

import numpy as np

from polish_sim.cell.crash_points import shaft_points
from polish_sim.errors import PlanError, place_in_mm
from polish_sim.geometry import Surface
from polish_sim.geometry.distance.signed_distance import signed_distances
from polish_sim.planning import ToolPath
from polish_sim.spatial import rotation_to_axis

EVERY: Final = 0.002
"""Along the path, between places that are looked at [m]."""


def check_shaft(path: ToolPath, surface: Surface, clearance: float) -> None:
    """Refuse a path on which the shaft comes too close to the part the pad works on.

    Args:
        path: Where the pad goes.
        surface: The part.
        clearance: What the shaft keeps from it [m].

    Raises:
        PlanError: Says where.
    """
    _, rows = np.unique(np.round(path.s / EVERY).astype(int), return_index=True)
    points, tools = path.positions_work[rows], -path.axes_work[rows]
    # The shaft is round: any turn about the axis will do.
    R_work_tool = np.stack([rotation_to_axis(z[None], np.eye(3)[int(np.abs(z).argmin())])[0] for z in tools])
    shaft = np.einsum("nij,kj->nki", R_work_tool, shaft_points()) + points[:, None]
    gaps = signed_distances(surface, shaft.reshape(-1, 3)).reshape(len(rows), -1).min(axis=1)
    if gaps.min() < clearance:
        worst = int(gaps.argmin())
        raise PlanError(
            f"the pad's shaft comes within {1e3 * gaps[worst]:.1f} mm of the part where the pad is at "
            f"{place_in_mm(points[worst])} of it, less than {1e3 * clearance:g} mm (dual.pad_clearance_m). Tilt the "
            "tool away from what stands there, or leave that place out of the path."
        )
