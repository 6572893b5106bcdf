"""A run with its tool axes: what the tool does in contact from one lift to the next (SurfaceRun -> Stroke)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import PlanConfig
from polish_sim.geometry import Surface
from polish_sim.planning.moves.approach import Move, process_move
from polish_sim.planning.moves.tool_axes import angles_between, lean, smooth_axes, soften_creases
from polish_sim.planning.patterns.run import SurfaceRun
from polish_sim.planning.toolpath import arc_length
from polish_sim.spatial import unit

Array = NDArray[np.float64]

CREASE_REACH = 0.5
"""The tool axis turns over a crease within this many step-overs on either side."""


class Stroke(NamedTuple):
    """A run in contact."""

    process: Move
    curvature: Array
    """Normal curvature of the surface along it [1/m], shape (n,)."""
    axis_deviation_rad: float
    """Largest angle by which smoothing turned an axis [rad]."""

    def rows(self, first: int, last: int) -> Stroke:
        """The stroke from one of its points to another, both included."""
        kept = np.s_[first : last + 1]
        move = self.process
        short = process_move(move.positions[kept], move.axes[kept], move.pass_index[kept])
        return Stroke(short, self.curvature[kept], self.axis_deviation_rad)


def give_axes(run: SurfaceRun, surface: Surface, plan: PlanConfig, first_pass: int) -> Stroke:
    """Set the tool on a run: along the normal, softened over creases, leaned by lead and tilt, smoothed.

    Args:
        run: Points on the surface, in the direction they are walked.
        surface: The surface.
        plan: Lead, tilt, smoothing.
        first_pass: Number of the first of its passes.

    Returns:
        The stroke.
    """
    s = arc_length(run.positions)
    tangents = unit(np.gradient(run.positions, axis=0))
    normals = soften_creases(run.points.normals, s, CREASE_REACH * plan.stepover_m)
    leaned = lean(normals, tangents, plan.lead_angle_rad, plan.tilt_angle_rad)
    axes = smooth_axes(leaned, run.points.normals, s, plan.axis_smoothing_m, plan.axis_deviation_rad)
    passes = run.pass_index - int(run.pass_index.min()) + first_pass
    return Stroke(
        process_move(run.positions, axes, passes),
        surface.normal_curvature(run.points.facets, run.points.barycentric, tangents),
        float(angles_between(leaned, axes).max()) if axes is not leaned else 0.0,
    )
