"""The interface of smoothing rules, and all of them by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from polish_sim.arrays import Array
from polish_sim.lazy import FunctionOnUse
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.rules.schedule import Smoothed

Rule = Callable[[Chain, SmoothingLimits, float, float, Arm | None, Array | None], Smoothed]
"""Plans the motion along a chain, within limits of tool and joints and tolerances of tip [m] and tool axis [rad].

The rule says of which distance of the tip. An arm of None leaves the joints out. Last come the tip's largest speeds on
the segments [m/s], shape (n,), infinite where there is none; None for no such limits. Raises a ReachError for a place
out of reach or singular, a SmoothingError if no speed keeps the joint limits."""

RULES: Mapping[str, Rule] = {
    "certified": FunctionOnUse("polish_sim.motion.certified.smoother", "plan_certified"),
    "joint-jerk": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_jerk"),
    "joint-acceleration": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_acceleration"),
}
