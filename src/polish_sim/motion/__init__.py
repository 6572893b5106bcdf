"""From tool poses to joint angles and back, and tool paths as functions of arc length and of time."""

from polish_sim.motion.kinematics import (
    JOINT_LIMITS,
    JointPath,
    forward,
    inverse_all,
    inverse_near,
    jacobian,
    link_frames,
    nearest_solution,
    smallest_singular_values,
    track,
    use_arm,
)
