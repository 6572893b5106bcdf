"""How a part is moved while it is worked on: a callable of time, from the pose it starts at (layer 6)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from polish_sim.spatial import inverse, transform

Array = NDArray[np.float64]


class PartWay(NamedTuple):
    """A motion of a part: its origin goes along, and the part moves in its own frame. Smooth, C2 or better."""

    shift: Callable[[Array], Array]
    """Times (n,) [s] to how far its origin has gone, base of the robot that moves it [m], shape (n, 3)."""
    turn: Callable[[Array], Array]
    """Times (n,) [s] to how it has moved in its own frame, shape (n, 4, 4)."""
    lasts: float = math.inf
    """How long it goes on [s]."""

    def __call__(self, T_base_start: Array, times: Array) -> Array:
        """Poses of the part at times [s], (n, 4, 4), from that at time zero, (4, 4)."""
        poses = T_base_start @ self.turn(times)
        poses[:, :3, 3] += self.shift(times)
        return np.asarray(poses)


def along_arc(velocity: Array, bend: float) -> Callable[[Array], Array]:
    """Constant speed along a straight line, or along an arc about the base's z axis.

    Args:
        velocity: At time zero [m/s], shape (3,).
        bend: Rate at which its direction turns about z [rad/s]; 0: straight.
    """
    across = np.array([-velocity[1], velocity[0], 0.0])
    level = np.array([velocity[0], velocity[1], 0.0])

    def shift(times: Array) -> Array:
        half = 0.5 * bend * times
        ratio = np.sinc(half / math.pi)  # sin(half) / half
        along, aside = ratio * np.cos(half), ratio * np.sin(half)
        rise = np.array([0.0, 0.0, velocity[2]])
        return np.asarray(times[:, None] * (along[:, None] * level + aside[:, None] * across + rise))

    return shift


def about_axis(axis: Array, center: Array, rate: float) -> Callable[[Array], Array]:
    """A turn at constant rate about an axis of the part.

    Args:
        axis: Its unit direction, work frame, shape (3,).
        center: A point on it, work frame [m], shape (3,).
        rate: Right-handed [rad/s]; 0: the part keeps its orientation.
    """

    def turn(times: Array) -> Array:
        R = Rotation.from_rotvec(rate * times[:, None] * axis).as_matrix()
        return np.asarray(transform(R, center - R @ center))

    return turn


def through_poses(times: Array, poses: Array) -> PartWay:
    """Through poses at given times: position by a cubic spline, orientation by a rotation spline, both C2.

    Args:
        times: From zero, increasing [s], shape (n,), n at least 2.
        poses: Of the part, shape (n, 4, 4).
    """
    places = CubicSpline(times, poses[:, :3, 3] - poses[0, :3, 3])
    turned = RotationSpline(times, Rotation.from_matrix((inverse(poses[0]) @ poses)[:, :3, :3]))
    end = float(times[-1])

    def shift(t: Array) -> Array:
        return np.asarray(places(np.clip(t, 0.0, end)))

    def turn(t: Array) -> Array:
        return np.asarray(transform(turned(np.clip(t, 0.0, end)).as_matrix(), np.zeros(3)))

    return PartWay(shift, turn, end)
