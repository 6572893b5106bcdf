"""Two arms on one part: the closed chain, a quintic spline around a rim, joints of both along it (layer 6)."""

from polish_sim.motion.coordination.closed_chain import Chain2, chain_residual, follower_flange, master_flange
from polish_sim.motion.coordination.closed_spline import ClosedSpline, fit_closed_spline
from polish_sim.motion.coordination.joints import CoordinatedJoints, choose_spin, follow_joints, plan_coordinated
from polish_sim.motion.coordination.part_way import PartWay, about_axis, along_arc, through_poses
from polish_sim.motion.coordination.time_law import rest_to_rest

__all__ = [
    "Chain2",
    "ClosedSpline",
    "CoordinatedJoints",
    "PartWay",
    "about_axis",
    "along_arc",
    "chain_residual",
    "choose_spin",
    "fit_closed_spline",
    "follow_joints",
    "follower_flange",
    "master_flange",
    "plan_coordinated",
    "rest_to_rest",
    "through_poses",
]
