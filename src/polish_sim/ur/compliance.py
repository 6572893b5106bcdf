"""Force mode: along selected axes of a task frame the arm presses, along the others it follows its
set-points.

    v <- (1 - damping) v + scaling / M (F_wanted - F) h        every h = 2 ms,

the law of the controller ``force-mode`` on each axis; see there what of it is public. The mass M turns with
the radius of gyration `GYRATION_M`.
"""

from __future__ import annotations

import numpy as np

from polish_sim.arrays import Array
from polish_sim.spatial import transform, unit
from polish_sim.ur.kinematics import matrix_of, pose_of

GYRATION_M = 0.25  #: Of the virtual mass [m]
BACK_HZ = 5.0  #: Rate at which the axes that follow return to their set-points [1/s]
FREE_DAMPING = 0.05  #: Of freedrive: it comes to rest where nothing pulls
TO_ORIGIN, FIXED, ALONG_SPEED = 1, 2, 3  #: Types of force mode


class Compliance:
    """Force mode as set by a programme."""

    def __init__(self, mass: float, damping: float, scaling: float) -> None:
        self.mass = mass
        self.damping = damping
        self.scaling = scaling
        self.speed = np.zeros(6)  #: Along the task frame's axes
        self.free = False  #: Freedrive

    def set(self, frame: Array, selection: Array, wrench: Array, kind: int, limits: Array) -> None:
        """Take a task frame (a pose in the base frame) and what to press with there."""
        self._frame = matrix_of(frame)
        self.kind = kind
        self.selection = np.asarray(selection) != 0
        self.wrench = np.asarray(wrench)
        self.limits = np.abs(limits)

    def axes(self, p: Array, twist: Array) -> Array:
        """The task frame's axes (3, 3) with the TCP at ``p`` moving with a ``twist``."""
        R = self._frame[:3, :3]
        if self.kind == TO_ORIGIN:
            y = self._frame[:3, 3] - p
            if np.linalg.norm(y) > 1e-6:
                y = unit(y)
                x = np.cross(y, R[:, 2])
                x = unit(x if np.linalg.norm(x) > 1e-6 else np.cross(y, R[:, 1]))
                return np.column_stack([x, y, np.cross(x, y)])
        if self.kind == ALONG_SPEED:
            x = twist[:3] - (twist[:3] @ R[:, 2]) * R[:, 2]
            if np.linalg.norm(x) > 1e-4:
                x = unit(x)
                return np.column_stack([x, np.cross(R[:, 2], x), R[:, 2]])
        return np.asarray(R)

    def twist(self, pose: Array, moved: Array, wanted: Array, force: Array, dt: float) -> Array:
        """Twist of the TCP, base axes.

        Args:
            pose: Of the TCP as commanded, (4, 4).
            moved: Twist of the set-points.
            wanted: Pose of the set-points, (4, 4).
            force: On the tool, torque about the TCP, base axes.
            dt: Tick [s].
        """
        R = self.axes(pose[:3, 3], moved)
        off = pose_of(transform(wanted[:3, :3] @ pose[:3, :3].T, wanted[:3, 3] - pose[:3, 3]))
        follow = _turned(R.T, moved + BACK_HZ * off)
        masses = self.mass * np.array([1.0, 1.0, 1.0, *[GYRATION_M**2] * 3])
        damping = FREE_DAMPING if self.free else self.damping
        pushed = self.scaling / masses * (self.wrench + _turned(R.T, force)) * dt
        speed = np.clip((1.0 - damping) * self.speed + pushed, -self.limits, self.limits)
        self.speed = np.where(self.selection, speed, 0.0)
        return _turned(R, np.where(self.selection, self.speed, follow))


def _turned(R: Array, six: Array) -> Array:
    return np.concatenate([R @ six[:3], R @ six[3:]])
