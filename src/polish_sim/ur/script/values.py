"""Values of URScript: lists and poses, never changed in place, so that an assignment copies as on a robot."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from math import dist, fmod, sqrt
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.errors import LARGEST
from polish_sim.spatial import from_pose, inverse, transform
from polish_sim.ur.kinematics import pose_from, pose_of

LARGEST_INTEGER = 2**31
LONGEST_TEXT = 8192
LONGEST_LIST = 5000  #: With the elements of lists in it


class List(tuple[Any, ...]):
    """A list; operators act on each element, as for a robot's vectors."""

    __slots__ = ()

    def _each(self, other: Any, of: Any) -> List:
        if isinstance(other, List):
            if len(other) != len(self):
                raise ValueError(f"lists of {len(self)} and {len(other)} elements")
            return type(self)(of(mine, theirs) for mine, theirs in zip(self, other, strict=True))
        return type(self)(of(mine, other) for mine in self)

    def __add__(self, other: Any) -> List:
        return self._each(other, add)

    __radd__ = __add__

    def __sub__(self, other: Any) -> List:
        return self._each(other, sub)

    def __rsub__(self, other: Any) -> List:
        return self._each(other, lambda mine, theirs: sub(theirs, mine))

    def __mul__(self, other: Any) -> List:
        return self._each(other, mul)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> List:
        return self._each(other, lambda mine, theirs: mine / theirs)

    def __neg__(self) -> List:
        return type(self)(-value for value in self)


class Pose(List):
    """A pose ``p[x, y, z, rx, ry, rz]``: metres and rotation vector."""

    __slots__ = ()


def pose(*values: Any) -> Pose:
    """A pose of six numbers."""
    return Pose(numbers(values, 6))


def add(a: Any, b: Any) -> Any:
    """Sum; texts are joined by ``str_cat`` only."""
    if isinstance(a, str):
        raise TypeError("texts are joined by str_cat")
    return whole(a + b)


def sub(a: Any, b: Any) -> Any:
    """Difference."""
    return whole(a - b)


def mul(a: Any, b: Any) -> Any:
    """Product."""
    if isinstance(a, str) or isinstance(b, str):
        raise TypeError("a text is no number")
    return whole(a * b)


def whole(result: Any) -> Any:
    """A result as it is; OverflowError for an integer of more than 32 bits."""
    if type(result) is int and not -LARGEST_INTEGER <= result < LARGEST_INTEGER:
        raise OverflowError(f"{result} is no 32-bit integer")
    return result


def mod(a: Any, b: Any) -> Any:
    """Remainder with the sign of the dividend."""
    remainder = fmod(a, b)
    return remainder if isinstance(a, float) or isinstance(b, float) else int(remainder)


def xor(a: Any, b: Any) -> bool:
    """Exclusive or."""
    return bool(a) != bool(b)


def element(values: Any, index: Any) -> Any:
    """An element of a list."""
    if index < 0:
        raise IndexError
    return values[int(index)]


def replaced(values: List, value: Any, index: Any, *inner: Any) -> List:
    """The list with another element; of a matrix with two indices."""
    row = element(values, index)
    changed = list(values)
    changed[int(index)] = replaced(row, value, *inner) if inner else value
    return type(values)(checked(changed))


def checked(values: Sequence[Any]) -> Sequence[Any]:
    """Elements of a list as they are; ValueError for too many, or lists within lists within lists.

    A list that holds itself twice, again and again, would be endless to compare.
    """
    rows = [value for value in values if isinstance(value, List)]
    if len(values) + sum(map(len, rows)) > LONGEST_LIST:
        raise ValueError(f"a list of more than {LONGEST_LIST} elements")
    if any(isinstance(inner, List) for row in rows for inner in row):
        raise ValueError("a list within a list within a list")
    return values


def as_list(values: Iterable[float] | Array) -> List:
    """A list from an array of one or two dimensions."""
    rows = values.tolist() if isinstance(values, np.ndarray) else values
    return List(List(row) if isinstance(row, list) else row for row in rows)


def as_pose(values: Array) -> Pose:
    """A pose from an array of finite numbers."""
    return Pose(map(number, values.tolist()))


def numbers(values: Any, size: int) -> list[float]:
    """Finite numbers of a list of known length."""
    if not isinstance(values, tuple) or len(values) != size:
        raise ValueError(f"{size} numbers are needed, not {to_text(values)[:60]}")
    return [number(value) for value in values]


def array(values: Any, size: int = 6) -> Array:
    """``numbers`` as an array."""
    return np.array(numbers(values, size))


def number(value: Any) -> float:
    """A finite number, small enough to reckon with."""
    if not isinstance(value, (int, float)) or not abs(value) <= LARGEST:
        raise ValueError(f"a finite number up to {LARGEST:g} is needed, not {to_text(value)[:60]}")
    return float(value)


def to_text(value: Any) -> str:
    """A value as ``textmsg`` shows it."""
    if isinstance(value, List):
        text = ("p[" if isinstance(value, Pose) else "[") + ", ".join(map(to_text, value)) + "]"
    else:
        text = f"{value:.9g}" if isinstance(value, float) else str(value)
    if len(text) > LONGEST_TEXT:
        raise ValueError(f"a text of more than {LONGEST_TEXT} characters")
    return text


# Poses and rotations.


def _matrix(pose: Any) -> Array:
    return from_pose(array(pose))


def pose_trans(p_from: Any, p_from_to: Any) -> Pose:
    """``T_from @ T_from_to``."""
    return as_pose(pose_of(_matrix(p_from) @ _matrix(p_from_to)))


def pose_inv(p_from: Any) -> Pose:
    """The inverse of a pose."""
    return as_pose(pose_of(inverse(_matrix(p_from))))


def pose_add(p_1: Any, p_2: Any) -> Pose:
    """Sum of positions; rotation ``R_1 @ R_2``."""
    T, by = _matrix(p_1), _matrix(p_2)
    return as_pose(pose_of(transform(T[:3, :3] @ by[:3, :3], T[:3, 3] + by[:3, 3])))


def pose_sub(p_to: Any, p_from: Any) -> Pose:
    """Difference of positions; the rotation from one to the other, in base axes."""
    return as_pose(pose_from(_matrix(p_to), _matrix(p_from)))


def interpolate_pose(p_from: Any, p_to: Any, alpha: Any) -> Pose:
    """The pose at a share of the way between two."""
    T = _matrix(p_from)
    way = pose_of(inverse(T) @ _matrix(p_to))
    return as_pose(pose_of(T @ from_pose(number(alpha) * way)))


def wrench_trans(T_from_to: Any, w_from: Any) -> List:
    """A wrench seen from another frame."""
    T, w = _matrix(T_from_to), array(w_from)
    moment = w[3:] - np.cross(T[:3, 3], w[:3])
    return as_list(np.append(w[:3] @ T[:3, :3], moment @ T[:3, :3]))


def norm(a: Any) -> float:
    """Absolute value of a number, length of a list."""
    return sqrt(sum(value * value for value in a)) if isinstance(a, List) else abs(a)


def point_dist(p_from: Any, p_to: Any) -> float:
    """Distance of two poses' positions [m]."""
    return dist(numbers(p_from, 6)[:3], numbers(p_to, 6)[:3])


def pose_dist(p_from: Any, p_to: Any) -> float:
    """Length of the difference of two poses."""
    return norm(pose_sub(p_from, p_to))


def rpy2rotvec(rpy: Any) -> List:
    """Roll, pitch, yaw (about the fixed x, y, z) as a rotation vector."""
    return as_list(Rotation.from_euler("xyz", array(rpy, 3)).as_rotvec())


def rotvec2rpy(rotation: Any) -> List:
    """The inverse of ``rpy2rotvec``."""
    with warnings.catch_warnings(action="ignore"):  # straight up or down: roll and yaw are about one axis
        return as_list(Rotation.from_rotvec(array(rotation, 3)).as_euler("xyz"))
