"""How far the robot is from itself and what stands around it, asked of MuJoCo pose by pose (layer 8a)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FAR: Final = 0.05
"""Distances are not told beyond this [m]."""
_TOUCH: Final = 1e-9


class RobotClearance:
    """Distances between geoms that could touch, and their derivatives by the joints."""

    def __init__(self, model: mujoco.MjModel, joints: int, also: Sequence[str] = ()) -> None:
        """Prepare for a model.

        Args:
            model: The scene.
            joints: How many joints, the first ones, the poses name.
            also: Geoms that count although the engine lets them touch nothing, such as the head's pad.
        """
        self._model, self._data, self._joints = model, mujoco.MjData(model), joints
        self._pairs = _pairs(model, also)

    def measure(self, q: Array) -> tuple[Array, Array]:
        """Clearance of poses.

        Args:
            q: Joint positions [rad], shape (m, n); joints beyond n stay where the model starts.

        Returns:
            Distance of each pair of geoms [m], at most `FAR`, shape (m, pairs), and its derivatives [m/rad], shape
            (m, pairs, n), zero where it is far.
        """
        shape = (len(q), len(self._pairs))
        distance, slope, ends = np.full(shape, FAR), np.zeros((*shape, self._joints)), np.empty(6)
        for row, pose in enumerate(q):
            self._data.qpos[: self._joints] = pose
            mujoco.mj_kinematics(self._model, self._data)
            near = []
            for number, pair in enumerate(self._pairs):
                distance[row, number] = mujoco.mj_geomDistance(self._model, self._data, *pair, FAR, ends)
                if distance[row, number] < FAR:
                    near.append((number, ends.copy()))
            if near:
                mujoco.mj_comPos(self._model, self._data)
            for number, points in near:
                slope[row, number] = self._slope(distance[row, number], points, self._pairs[number])
        return distance, slope

    def _slope(self, distance: float, ends: Array, pair: tuple[int, int]) -> Array:
        way = ends[3:] - ends[:3]
        length = float(np.linalg.norm(way))
        if length < _TOUCH:
            return np.zeros(self._joints)
        jacobians = []
        for geom, point in zip(pair, (ends[:3], ends[3:]), strict=True):
            J = np.zeros((3, self._model.nv))
            mujoco.mj_jac(self._model, self._data, J, None, point, int(self._model.geom_bodyid[geom]))
            jacobians.append(J)
        direction = way / length * np.sign(distance)
        return np.asarray(direction @ (jacobians[1] - jacobians[0])[:, : self._joints])


def _pairs(model: mujoco.MjModel, also: Sequence[str]) -> list[tuple[int, int]]:
    """Pairs of geoms the engine would let touch: not on one body, not on neighbours, not excluded."""
    weld, parent = model.body_weldid, model.body_parentid
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    type_, affinity = model.geom_contype.copy(), model.geom_conaffinity.copy()
    for name in also:
        type_[model.geom(name).id], affinity[model.geom(name).id] = 1, 1
    pairs = []
    for one in range(model.ngeom):
        for two in range(one + 1, model.ngeom):
            meets = (type_[one] & affinity[two]) or (type_[two] & affinity[one])
            bodies = (int(model.geom_bodyid[one]), int(model.geom_bodyid[two]))
            a, b = (int(weld[body]) for body in bodies)
            next_to = 0 not in (a, b) and (a == weld[parent[b]] or b == weld[parent[a]])
            if meets and a != b and not next_to and bodies not in excluded and bodies[::-1] not in excluded:
                pairs.append((one, two))
    return pairs
