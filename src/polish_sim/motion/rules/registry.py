"""The smoothing rules by name."""

from __future__ import annotations

from collections.abc import Mapping

from polish_sim.motion.rules import certified, joint_acceleration, joint_jerk
from polish_sim.motion.rules.rule import Rule

RULES: Mapping[str, Rule] = {
    "certified": certified.plan,
    "joint-jerk": joint_jerk.plan,
    "joint-acceleration": joint_acceleration.plan,
}
"""Name -> plan function."""
