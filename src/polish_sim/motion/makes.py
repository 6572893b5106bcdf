"""Which make of arm this process computes with."""

from __future__ import annotations

from polish_sim.arms import ARMS, FIRST, ArmTable, arm_table
from polish_sim.motion.kinematics import set_nominal

_used = [ARMS[FIRST]]


def use_arm(name: str) -> ArmTable:
    """Make the arm that a word of ``robot.arm`` names the one this process computes with.

    A process works with one make at a time: everything that begins with a scenario calls this first.
    """
    _used[0] = arm = arm_table(name)
    set_nominal(arm.d, arm.a, arm.label)
    return arm


def used_arm() -> ArmTable:
    """The make of the arm in use."""
    return _used[0]


use_arm(FIRST)
