"""The smoothing rules by name."""

from __future__ import annotations

from collections.abc import Mapping

from polish_sim.lazy import FunctionOnUse
from polish_sim.motion.rules.rule import Rule

RULES: Mapping[str, Rule] = {
    "certified": FunctionOnUse("polish_sim.motion.rules.certified_rule", "plan_certified"),
    "joint-jerk": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_jerk"),
    "joint-acceleration": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_acceleration"),
}
"""Name -> plan function."""
