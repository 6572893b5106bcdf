"""The checker sees what it should: the arm by its table alone, sound rules as sound, spoilt motions as
spoilt."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.arm_jets import tool_jet
from benchmarks.exact_stop import plan_exact_stop as plan
from benchmarks.random_paths import T_FLANGE_TOOL, draw_path
from benchmarks.smoothing_check import AXIS_TOLERANCE, FIGURES, TOLERANCE, judge_motion
from polish_sim.motion import forward
from polish_sim.motion.rules.limits import SmoothingLimits

LIMITS = SmoothingLimits()


def test_the_table_gives_the_tool_s_pose_and_its_derivatives_in_time() -> None:
    """Angles that are cubic in time: differences of the pose must agree with the jet."""
    rng = np.random.default_rng(0)
    c = rng.normal(size=(4, 6))
    t = 0.3 + 1e-3 * np.arange(-2, 3)[:, None]
    q = c[0] + c[1] * t + c[2] * t**2 + c[3] * t**3
    jet = tool_jet(
        np.stack([q, c[1] + 2 * c[2] * t + 3 * c[3] * t**2, 2 * c[2] + 6 * c[3] * t, 6 * c[3] + 0 * t]),
        T_FLANGE_TOOL,
    )
    np.testing.assert_allclose(jet[0], forward(q) @ T_FLANGE_TOOL, atol=1e-14)
    for order in range(3):
        slope = (jet[order][3] - jet[order][1]) / 2e-3
        np.testing.assert_allclose(jet[order + 1][2], slope, atol=1e-4 * np.abs(slope).max())


@pytest.mark.parametrize("number", range(2))
def test_exact_stops_break_nothing_and_played_too_fast_they_break_speeds_but_no_tolerance(
    number: int,
) -> None:
    path = draw_path(np.random.default_rng([0, number]), number)
    motion = plan(path.chain, LIMITS, TOLERANCE, AXIS_TOLERANCE, path.arm)
    shares = judge_motion(motion, path, LIMITS)
    assert shares.max() <= 1.0 + 1e-6
    rate = 1.5
    spoilt = judge_motion(motion.stretched(1.0 / rate), path, LIMITS)
    np.testing.assert_allclose(spoilt[:9], shares[:9] * np.tile(rate ** np.arange(1, 4), 3), rtol=1e-4)
    jerk = FIGURES.index("tip jerk")
    assert max(spoilt[jerk], spoilt[jerk + 3], spoilt[jerk + 6]) > 1.0 + 1e-6
    np.testing.assert_allclose(spoilt[9:], shares[9:], atol=1e-6)
