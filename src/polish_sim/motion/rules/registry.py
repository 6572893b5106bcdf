"""The smoothing rules by name."""

from __future__ import annotations

from collections.abc import Mapping

from polish_sim.motion.rules.certified_rule import plan_certified
from polish_sim.motion.rules.paper_rules import plan_joint_acceleration, plan_joint_jerk
from polish_sim.motion.rules.rule import Rule

RULES: Mapping[str, Rule] = {
    "certified": plan_certified,
    "joint-jerk": plan_joint_jerk,
    "joint-acceleration": plan_joint_acceleration,
}
"""Name -> plan function."""
