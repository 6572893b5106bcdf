"""From tool poses to joint angles and back, and a tool path as a callable of its arc length (layer 6)."""

from polish_sim.motion.inverse_kinematics import inverse_all, inverse_near, nearest_solution, wrap_near
from polish_sim.motion.joint_motion import JointPath, track
from polish_sim.motion.kinematics import (
    JOINT_LIMITS,
    JOINT_SPEED_LIMIT,
    forward,
    forward_many,
    jacobian,
    jacobian_many,
    link_frames,
    manipulability,
    smallest_singular_values,
)

__all__ = [
    "JOINT_LIMITS",
    "JOINT_SPEED_LIMIT",
    "JointPath",
    "forward",
    "forward_many",
    "inverse_all",
    "inverse_near",
    "jacobian",
    "jacobian_many",
    "link_frames",
    "manipulability",
    "nearest_solution",
    "smallest_singular_values",
    "track",
    "wrap_near",
]
