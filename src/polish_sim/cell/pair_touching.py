"""What may touch what in a scene of two robots, before it is compiled (layer 8a).

A cell's own geoms, capsules on the links, touch each other. Besides, pad and shaft touch the other arm and its
gripper, never the part: the pad's contact with that is computed on its signed distance. Where a way is checked
beforehand the links count as they are drawn, each shell by its convex hull, because they are up to 4 cm thicker than
their capsules.
"""

from __future__ import annotations

from typing import Any, Final

import mujoco

PAD: Final = ("head_pad", "head_plate", "head_shaft")
"""Geoms that are nearer to the part than the housing is."""
CAPSULES, PAD_GROUP, SHELLS, PART = 1, 2, 4, 8
"""Bits of the engine's contact types: a geom of this kind meets what has the bit in its affinity."""


def let_pad_touch(follower: Any, master: Any) -> None:
    """Let pad and shaft of one robot touch what is there of the other."""
    for name in PAD:
        follower.geom(name).contype = PAD_GROUP
    for geom in master.geoms:
        if geom.contype:
            geom.conaffinity |= PAD_GROUP


def let_shells_touch(follower: Any, master: Any, reach: float) -> None:
    """Let what is drawn of one arm meet what is drawn of the other; contacts are found up to ``reach`` [m]."""
    for geom in follower.geoms:
        if geom.name not in PAD and _solid(geom):
            geom.contype |= SHELLS
            geom.margin = reach
    for geom in master.geoms:
        if _solid(geom):
            geom.conaffinity |= PAD_GROUP | SHELLS | PART
            geom.margin = reach


def let_part_touch(part: Any, reach: float) -> None:
    """Let a carried part, as its convex hull, meet both arms."""
    geom = part.geoms[0]
    geom.contype, geom.conaffinity, geom.margin = CAPSULES | PART, CAPSULES | SHELLS, reach


def _solid(geom: Any) -> bool:
    """Whether a geom stands for the arm itself: a shell that is drawn, or what collides and is no capsule."""
    if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
        return True
    return bool(geom.contype) and geom.type != mujoco.mjtGeom.mjGEOM_CAPSULE
