"""Whether two robots, the part in the gripper and the tool come too close on the way, before anything moves (8a).

The part counts as its convex hull here, and the pad is let near it, as it is to touch it; everything else is drawn as
it is, see ``pair_touching``.
"""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.carrier import FIRST_JOINT, MASTER
from polish_sim.cell.pair_scene import Clearances
from polish_sim.cell.pair_touching import PAD

Array = NDArray[np.float64]

_SUFFIXES: Final = ("_collision", "_shell", "_seam", "_cap")


class PairContacts:
    """The engine's collision check of a scene of two robots."""

    def __init__(self, model: mujoco.MjModel, clearances: Clearances) -> None:
        """Take a scene that was built with the same clearances, see ``Held``."""
        self._model, self._data, self._clearances = model, mujoco.MjData(model), clearances
        names = [model.geom(g).name for g in range(model.ngeom)]
        self._pad = np.array([name.endswith(PAD) for name in names])
        self._part = model.geom_bodyid == model.body(f"{MASTER}part").id
        self._master = np.array([name.startswith(MASTER) for name in names])

    def first(self, q_master: Array, q_follower: Array) -> str:
        """The first two things too close with joints of both arms [rad], (n, 6) each; empty if there are none."""
        for master, follower in zip(q_master, q_follower, strict=True):
            self._data.qpos[:6], self._data.qpos[FIRST_JOINT:] = follower, master
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_collision(self._model, self._data)
            contacts = self._data.contact
            close = [k for k in range(self._data.ncon) if contacts.dist[k] < self._wanted(*contacts.geom[k])]
            if close:
                pair = contacts.geom[min(close, key=lambda k: float(contacts.dist[k]))]
                return " and ".join(self._name(int(geom)) for geom in pair)
        return ""

    def _wanted(self, one: int, two: int) -> float:
        """Distance two geoms keep [m]: links of one arm only must not run into each other."""
        if self._pad[one] or self._pad[two]:
            return self._clearances.pad
        apart = self._master[one] != self._master[two] or self._part[one] or self._part[two]
        return self._clearances.arms if apart else 0.0

    def _name(self, geom: int) -> str:
        name = str(self._model.geom(geom).name)
        for suffix in _SUFFIXES:
            name = name.removesuffix(suffix)
        return name
