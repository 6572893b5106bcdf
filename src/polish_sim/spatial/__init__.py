"""Rigid-body maths: rotations, transforms (layer 2)."""

from polish_sim.spatial.rotations import (
    quaternion_from_rotation,
    rotation_angle,
    rotation_from_quaternion,
    rotation_to_axis,
    skew,
)
from polish_sim.spatial.transforms import apply, from_pose, inverse, transform
from polish_sim.spatial.vectors import perpendicular, unit

__all__ = [
    "apply",
    "from_pose",
    "inverse",
    "perpendicular",
    "quaternion_from_rotation",
    "rotation_angle",
    "rotation_from_quaternion",
    "rotation_to_axis",
    "skew",
    "transform",
    "unit",
]
