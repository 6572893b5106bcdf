"""The interface of smoothing rules, and all of them by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from polish_sim.arrays import Array
from polish_sim.errors import InputError, unknown_name
from polish_sim.lazy import FunctionOnUse
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.rules.schedule import SmoothMotion

Rule = Callable[[Chain, SmoothingLimits, float, float, Arm | None, Array | None], SmoothMotion]
"""Plans the motion along a chain, within limits of tool and joints and tolerances of tip [m] and tool axis
[rad].

The rule says of which distance of the tip. An arm of None leaves the joints out. Last come the tip's largest
speeds on the segments [m/s], shape (n,), infinite where there is none; None for no such limits. Raises a
ReachError for a place out of reach or singular, a SmoothingError if no speed keeps the joint limits."""

RULES: Mapping[str, Rule] = {
    "spline": FunctionOnUse("polish_sim.motion.spline.motion", "smooth_by_spline"),
    "joint-jerk": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_jerk"),
    "joint-acceleration": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_acceleration"),
}


def check_rule(where: str, name: str, known: Mapping[str, object]) -> None:
    """Raise an InputError, which says where the rule was named, if it is not a known one."""
    if name == "certified":
        raise InputError(f"{where} 'certified' is no longer there: set it to 'spline', which took its place.")
    if name not in known:
        raise unknown_name(where, name, known)
