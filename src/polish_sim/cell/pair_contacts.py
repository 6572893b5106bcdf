"""Whether two robots, the part in the gripper and the tool touch each other on the way, before anything moves (8a).

The part counts as its convex hull here, with some room around it. Of the tool only the housing counts, not the pad
that is to touch the part.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.carrier import FIRST_JOINT

Array = NDArray[np.float64]

CLEARANCE = 0.03  # that links keep from the part: they are thicker than the capsules they collide as [m]


class PairContacts:
    """The engine's collision check of a scene of two robots."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Take a scene in which the part collides, see ``Held.margin``."""
        self._model, self._data = model, mujoco.MjData(model)

    def first(self, q_master: Array, q_follower: Array) -> str:
        """The first two things that touch with joints of both arms [rad], (n, 6) each; empty if nothing does."""
        for master, follower in zip(q_master, q_follower, strict=True):
            self._data.qpos[:6], self._data.qpos[FIRST_JOINT:] = follower, master
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_collision(self._model, self._data)
            if self._data.ncon:
                pair = (self._model.geom(int(g)).name for g in self._data.contact[0].geom)
                return " and ".join(name.replace("_collision", "") for name in pair)
        return ""
