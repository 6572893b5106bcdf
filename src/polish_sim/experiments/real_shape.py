"""The part's shape as it really is: its own mesh where one is given, else the drawing (layer 9).

A plan is made on the drawing, what is polished is a casting with an edge too many. The mesh of the real part lies in
the drawing's frame and unit; displacement, rotation and form error come on top.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell import Touch
from polish_sim.config import PartConfig, Scenario
from polish_sim.errors import MeshError, place_in_mm
from polish_sim.experiments.part_setup import part_file
from polish_sim.geometry import PartMesh, Surface, fit_surface, load_part
from polish_sim.planning.toolpath import ToolPath

Array = NDArray[np.float64]

FAR_M = 0.02
"""A real part farther than this from most of the path is another part, or lies in another frame [m]."""


class RealShape(NamedTuple):
    """What stands in the cell before it is displaced and bent; work frame."""

    mesh: PartMesh
    """The mesh that is drawn."""
    surface: Surface
    """The whole of it."""
    given: bool
    """Whether it has a mesh of its own."""


def real_shape(scenario: Scenario, mesh: PartMesh, surface: Surface, path: ToolPath) -> RealShape:
    """Load the real part's mesh, if the scenario names one, and check that it is where the path is.

    Args:
        scenario: Names the real part; it is read as the nominal one is.
        mesh: The nominal part.
        surface: Its surface.
        path: The path planned on it.

    Returns:
        The shape; without a mesh of its own the nominal one.

    Raises:
        MeshError: If it cannot be read, or does not lie where the drawing says.
    """
    config = scenario.part
    if not config.real_file:
        return RealShape(mesh, surface, given=False)
    actual = load_part(part_file(config.real_file), config.unit, config.up)
    shape = RealShape(actual, fit_surface(actual, scenario.plan.feature_angle_rad), given=True)
    _check_place(shape, mesh, config, path.positions_work[path.process])
    return shape


def touched(shape: RealShape, path: ToolPath, pad_radius: float, depth: float) -> Touch:
    """Where the pad goes: on the path, and where the real surface lies above or below it, there too.

    Args:
        shape: The real part.
        path: The path on the nominal one.
        pad_radius: Radius of the pad [m].
        depth: How deep the part is to be modelled [m].

    Returns:
        Places and axes.
    """
    positions, axes = path.positions_work[path.process], path.axes_work[path.process]
    if not shape.given:
        return Touch(positions, axes, pad_radius, depth)
    there = shape.surface.closest(positions).positions
    return Touch(np.vstack([positions, there]), np.vstack([axes, axes]), pad_radius, depth)


def shape_figures(shape: RealShape, path: ToolPath) -> dict[str, Any]:
    """How far the real part, before it is displaced and bent, lies from the drawing along the path.

    Args:
        shape: The real part.
        path: The path on the nominal one.

    Returns:
        ``real_part``: lowest and highest place above the path [m] and what its mesh needed; empty without a mesh of
        its own.
    """
    if not shape.given:
        return {}
    positions, axes = path.positions_work[path.process], path.axes_work[path.process]
    above = np.sum((shape.surface.closest(positions).positions - positions) * axes, axis=1)
    facts = {"lowest_m": float(above.min()), "highest_m": float(above.max()), "notes": list(shape.mesh.notes)}
    return {"real_part": facts}


def _check_place(shape: RealShape, mesh: PartMesh, config: PartConfig, positions: Array) -> None:
    """Refuse a real part that most of the path does not lie on.

    Raises:
        MeshError: Saying how far away it is, and how large beside the drawing.
    """
    away = np.linalg.norm(shape.surface.closest(positions).positions - positions, axis=1)
    if float(np.median(away)) <= FAR_M:
        return
    nearest = int(np.argmin(away))
    raise MeshError(
        f"the real part '{config.real_file}' does not lie where '{config.file}' does: half of the path is more than "
        f"{1e3 * np.median(away):.4g} mm away from it (allowed: {1e3 * FAR_M:g} mm), the nearest point of the path, "
        f"{place_in_mm(positions[nearest])}, {1e3 * away[nearest]:.4g} mm. Read in {config.unit}, it is "
        f"{_size(shape.mesh)} large and the nominal part {_size(mesh)}. Bring it to the nominal part's unit and frame."
    )


def _size(mesh: PartMesh) -> str:
    return " x ".join(f"{1e3 * side:.4g}" for side in np.ptp(mesh.vertices, axis=0)) + " mm"
