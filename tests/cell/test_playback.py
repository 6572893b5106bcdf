"""Joint targets on the servos: what stands still stays, what moves is followed, what would touch is refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polish_sim.cell.playback import JointTargets, play_joints
from polish_sim.errors import ReachError
from polish_sim.experiments import default_scenario
from tests.cell.cells import TOUCH, joints_at

Array = NDArray[np.float64]

SCENARIO = default_scenario("arc")
TIME = np.arange(0.0, 2.0, 0.001)


def swing(amplitude: float) -> JointTargets:
    """All joints there and back once, from rest to rest."""
    angle = np.pi * TIME / TIME[-1]
    rate = np.pi / TIME[-1]
    q = joints_at(TOUCH) + amplitude * np.sin(angle)[:, None] ** 4 * np.ones(6)
    qd = 4.0 * amplitude * rate * (np.sin(angle) ** 3 * np.cos(angle))[:, None] * np.ones(6)
    return JointTargets(q, qd)


def test_a_robot_told_to_stand_still_stands_still() -> None:
    played = play_joints(SCENARIO, swing(0.0))
    assert np.abs(played.q - joints_at(TOUCH)).max() < 5e-5
    assert np.abs(played.qd).max() < 1e-3


def test_a_smooth_swing_is_followed_and_the_error_grows_with_the_acceleration() -> None:
    small, large = swing(0.05), swing(0.2)
    errors = [np.abs(play_joints(SCENARIO, targets).q - targets.q).max() for targets in (small, large)]
    assert errors[0] < 2e-4
    assert errors[0] < errors[1] < 6e-4


def test_the_same_targets_give_the_same_bytes() -> None:
    first, second = play_joints(SCENARIO, swing(0.1)), play_joints(SCENARIO, swing(0.1))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


def test_links_that_would_touch_are_refused_by_name() -> None:
    folded = joints_at(TOUCH)
    folded[2] = 3.1  # the elbow closed
    with pytest.raises(ReachError, match="would touch"):
        play_joints(SCENARIO, JointTargets(np.tile(folded, (50, 1)), np.zeros((50, 6))))
