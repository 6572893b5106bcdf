"""The master's gripper: where a part sits in it, and whether the master can carry the part."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import InputError, ReachError, place_in_mm
from polish_sim.experiments.placement import upright
from polish_sim.geometry import PartMesh, Surface
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.spatial import apply, from_pose, inverse, transform

GRIPPER_LENGTH = 0.1  # from the flange to its face [m]
GRIPPER_RADIUS = 0.04  # [m]
GRIPPER_MASS = 0.9  # [kg]
PAYLOAD_LIMIT = 5.0  # of the arm [kg]
TOUCHING = 1e-4  #: A part this close to the gripper is held by it [m]
_SPACING = 0.002  # between the sampled points of the gripper's face [m]
_STEPS = 2000


class Seat(NamedTuple):
    """A part in a gripper."""

    #: The part's frame on the gripper's face, whose z axis looks away from the flange, (4, 4)
    T_gripper_work: Array
    nose: float  #: How far the gripper extends beyond its face, into an opening, until it meets the part [m]


def seat_part(surface: Surface, up: Array, pose: tuple[float, ...] = ()) -> Seat:
    """Hold a part with the side ``up`` away from the gripper, the middle of its box on the gripper's axis.

    ``pose``: where the part's own frame is on the gripper instead [m], [rad], (6,); empty for none. Raises
    ReachError if there is no part in front of the gripper's face.
    """
    corners = surface.control.reshape(-1, 3)
    T_gripper_work = from_pose(pose) if pose else _on_lowest_point(corners, up)
    depth = apply(T_gripper_work, corners)[:, 2].max()
    nose = _gap_to_part(surface, inverse(T_gripper_work), depth)
    if nose is None:
        raise ReachError(
            f"the gripper's face, {2e3 * GRIPPER_RADIUS:g} mm wide, would hold nothing: at "
            f"{place_in_mm(inverse(T_gripper_work)[:3, 3])} of the part there is no part in front of it. Say "
            "where the part's own frame is on the gripper's face with --set "
            "dual.part_on_gripper=[x,y,z,rx,ry,rz] (m, rad)."
        )
    return Seat(T_gripper_work, nose)


def seat_text(T_gripper_work: Array) -> str:
    """Where the gripper takes a part, for the user."""
    T_work_gripper = inverse(T_gripper_work)
    axis = ", ".join(f"{number + 0.0:.3g}" for number in np.round(T_work_gripper[:3, 2], 4))
    return (
        f"held by the gripper at {place_in_mm(T_work_gripper[:3, 3])} of its own frame, gripper's axis "
        f"({axis})"
    )


def seat_notes(figures: Mapping[str, Any]) -> tuple[str, ...]:
    """How the part was held in a run, by its figures."""
    return (f"part: {seat_text(np.array(figures['T_gripper_work']))}",)


def _on_lowest_point(corners: Array, up: Array) -> Array:
    R = upright(up)
    turned = corners @ R.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    # To a tenth of a millimetre: facets make the box of what is round a little lopsided.
    middle = np.round(0.5 * (low + high), 4)
    return transform(R, -np.array([middle[0], middle[1], low[2]]))


def _gap_to_part(surface: Surface, T_work_gripper: Array, depth: float) -> float | None:
    """How far the gripper's face goes along its axis until it meets the part [m]; None if there is nothing.

    Each step is the distance to the nearest point of the part, so that the face never overshoots.
    """
    line = np.arange(-GRIPPER_RADIUS, GRIPPER_RADIUS + 0.5 * _SPACING, _SPACING)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    inside = np.hypot(x, y) <= GRIPPER_RADIUS + 1e-12
    face = np.stack([x[inside], y[inside], np.zeros(int(inside.sum()))], axis=1)
    way = 0.0
    for _ in range(_STEPS):
        gap = signed_distances(surface, apply(T_work_gripper, face)).min()
        if gap < TOUCHING:
            return way
        way += gap
        face[:, 2] += gap
        if way > depth:
            break
    return None


def volume_and_center(mesh: PartMesh) -> tuple[float, Array]:
    """Volume [m^3] and its centre [m] by the divergence theorem; of an open mesh what its faces enclose."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    volume = volumes.sum()
    return volume, (volumes @ (a + b + c)) / (4.0 * volume) if volume else np.zeros(3)


def check_load(mesh: PartMesh, density: float) -> None:
    """Refuse a part that encloses no volume (InputError), or is too heavy for the master (ReachError)."""
    mass = density * volume_and_center(mesh)[0]
    if not mass > 0.0:
        raise InputError(
            f"the part's mesh encloses {1e6 * mass / density:.4g} cm^3, so that the master would carry no "
            "mass: it is open or its faces look inwards. Close it, or turn its faces outwards."
        )
    if mass + GRIPPER_MASS > PAYLOAD_LIMIT:
        raise ReachError(
            f"the part weighs {mass:.2f} kg: with the gripper's {GRIPPER_MASS:g} kg the master would carry "
            f"more than its {PAYLOAD_LIMIT:g} kg. Take a smaller part, or its true density with --set "
            "dual.density_kg_m3=..."
        )
