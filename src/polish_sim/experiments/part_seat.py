"""How the master's gripper holds a part: by its lowest point, seen along ``up``, or as a user says (layer 9)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.pair_scene import GRIPPER_RADIUS
from polish_sim.errors import ReachError, place_in_mm
from polish_sim.experiments.placement import upright
from polish_sim.geometry import Surface
from polish_sim.geometry.distance.signed_distance import signed_distances
from polish_sim.spatial import apply, from_pose, inverse, transform

Array = NDArray[np.float64]

TOUCHING: Final = 1e-4
"""A part this close to the gripper is held by it [m]."""
_SPACING: Final = 0.002  # between the points of the gripper's face that are looked at [m]
_STEPS: Final = 2000


class Seat(NamedTuple):
    """A part in a gripper."""

    T_gripper_work: Array
    """The part's own frame on the gripper's face, whose z axis looks away from the flange, shape (4, 4)."""
    nose: float
    """How far the gripper goes on beyond its face, into an opening, until it meets the part [m]."""


def seat_part(surface: Surface, up: Array, pose: tuple[float, ...] = ()) -> Seat:
    """Hold a part with the side ``up`` away from the gripper, the middle of its box on the gripper's axis.

    Args:
        surface: The part.
        up: Side to be worked on, work frame, shape (3,).
        pose: Where the part's own frame is on the gripper instead [m], [rad], shape (6,); empty for none.

    Returns:
        Where the part sits.

    Raises:
        ReachError: Nothing of the part is before the gripper's face.
    """
    corners = surface.control.reshape(-1, 3)
    T_gripper_work = from_pose(pose) if pose else _on_lowest_point(corners, up)
    depth = float(apply(T_gripper_work, corners)[:, 2].max())
    nose = _way_to_part(surface, inverse(T_gripper_work), depth)
    if nose is None:
        raise ReachError(
            f"the gripper's face, {2e3 * GRIPPER_RADIUS:g} mm wide, would hold nothing: no part is before it when it "
            f"comes to {place_in_mm(inverse(T_gripper_work)[:3, 3])} of the part. Say where the part's own frame is on "
            "the gripper's face with --set dual.part_on_gripper=[x,y,z,rx,ry,rz] (m, rad)."
        )
    return Seat(T_gripper_work, nose)


def seat_text(T_gripper_work: Array) -> str:
    """Where the gripper takes a part, for the user."""
    T_work_gripper = inverse(T_gripper_work)
    axis = ", ".join(f"{number + 0.0:.3g}" for number in np.round(T_work_gripper[:3, 2], 4))
    return f"held by the gripper at {place_in_mm(T_work_gripper[:3, 3])} of its own frame, gripper's axis ({axis})"


def _on_lowest_point(corners: Array, up: Array) -> Array:
    R = upright(up)
    turned = corners @ R.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    # To a tenth of a millimetre: facets make the box of what is round a little lopsided.
    middle = np.round(0.5 * (low + high), 4)
    return transform(R, -np.array([middle[0], middle[1], low[2]]))


def _way_to_part(surface: Surface, T_work_gripper: Array, depth: float) -> float | None:
    """How far the gripper's face goes along its axis until it meets the part [m]; None if there is nothing.

    It goes by the distance to what is nearest, which it can never overshoot.
    """
    face, way = _face(), 0.0
    for _ in range(_STEPS):
        gap = float(signed_distances(surface, apply(T_work_gripper, face)).min())
        if gap < TOUCHING:
            return way
        way += gap
        face[:, 2] += gap
        if way > depth:
            break
    return None


def _face() -> Array:
    """Points spread over the gripper's face, gripper's frame [m], shape (n, 3)."""
    line = np.arange(-GRIPPER_RADIUS, GRIPPER_RADIUS + 0.5 * _SPACING, _SPACING)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    inside = np.hypot(x, y) <= GRIPPER_RADIUS + 1e-12
    return np.stack([x[inside], y[inside], np.zeros(int(inside.sum()))], axis=1)
