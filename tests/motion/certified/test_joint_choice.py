"""Speed, acceleration and jerk along a segment with joints: an independent optimiser finds nothing sooner."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize

from polish_sim.motion.certified.segment_limits import choose_limits, rest_to_rest, worst_share


class Case(NamedTuple):
    most: np.ndarray
    joint: np.ndarray
    tool: np.ndarray


def random_case(seed: int) -> Case:
    """Derivatives, joint limits and tool limits; the jerk limit over six decades, some joints standing still."""
    rng = np.random.default_rng(seed)
    most = np.exp(1.5 * rng.normal(size=(3, 6))) * np.array([1.0, 0.5, 0.5])[:, None]
    most[:, rng.random(6) < 0.1] = 0.0
    joint = np.array([3.0, 5.0, 10.0 ** rng.uniform(-4, 2)])[:, None] * np.exp(0.3 * rng.normal(size=(3, 6)))
    return Case(most, joint, np.exp(rng.normal(size=3)) * [3.0, 30.0, 600.0])


def left_over(x: np.ndarray, case: Case) -> np.ndarray:
    """Shares of all limits that are not used at (log V, log A, log J); the last: way left at full speed."""
    v, a, j = np.exp(x)
    q1, q2, q3 = case.most
    used = np.stack([q1 * v, q2 * v**2 + q1 * a, q3 * v**3 + 3.0 * q2 * v * a + q1 * j]) / case.joint
    return np.concatenate([np.log(case.tool) - x, 1.0 - used.ravel(), [1.0 - (v / a + a / j) * v]])


def least_time(case: Case, start: np.ndarray) -> float:
    """Least V, A, J give by sequential quadratic programming from two starts."""
    best = math.inf
    for factor in (0.9, 0.4):
        found = minimize(
            lambda x: np.log(np.exp(-x[0]) + np.exp(x[0] - x[1]) + np.exp(x[1] - x[2])),
            np.log(factor * start),
            constraints=[{"type": "ineq", "fun": left_over, "args": (case,)}],
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-13},
        )
        if left_over(found.x, case).min() > -1e-7:
            best = min(best, math.exp(found.fun))
    return best


def test_nothing_faster_is_found_by_an_independent_optimiser() -> None:
    found = 0
    for seed in range(40):
        case = random_case(seed)
        motion = case.tool.copy()
        assert choose_limits(case.most, 1.0, case.joint, 1.0, motion)
        assert worst_share(case.most, 1.0, motion, case.joint) <= 1.0
        assert (motion <= case.tool).all()
        best = least_time(case, motion)
        found += math.isfinite(best)
        assert rest_to_rest(1.0, *motion) <= best * (1.0 + 1e-5)
    assert found > 35


@pytest.mark.parametrize("jerk", [1e-6, 1e-2, 1e2])
def test_a_joint_that_goes_with_the_tool_takes_four_cube_roots(jerk: float) -> None:
    """q = 2 s over 0.3: jerk alone binds, 4 cbrt(L / 2 j) with L = 0.6."""
    most, motion = np.zeros((3, 6)), np.array([1e3, 1e4, 1e6])
    most[0, 2] = 2.0
    joint = np.array([1e3, 1e4, jerk])[:, None] * np.ones(6)
    assert choose_limits(most, 1.0, joint, 0.3, motion)
    assert rest_to_rest(0.3, *motion) == pytest.approx(4.0 * math.cbrt(0.6 / 2.0 / jerk), rel=1e-5)


def test_where_no_speed_is_slow_enough_nothing_is_chosen() -> None:
    motion = np.array([1.0, 10.0, 100.0])
    assert not choose_limits(np.full((3, 6), math.inf), 1.0, np.ones((3, 6)), 1.0, motion)
    assert motion == pytest.approx([1.0, 10.0, 100.0])
