"""Plant a tool's tip, touch a point with it, recover it: exactly without noise, at the Cramér-Rao bound with it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.dual.calibration.tool import fit_tool_point, fit_tool_point_without_outliers
from polish_sim.dual.calibration.tool_checks import (
    ToolTouches,
    orientation_spread,
    plan_touch_orientations,
    point_error_bound,
)
from polish_sim.errors import CalibrationError
from polish_sim.spatial import transform

Array = NDArray[np.float64]

TIP, POINT = np.array([0.03, -0.02, 0.21]), np.array([-0.4, 0.1, 0.3])
SIGMA = 5e-5


def touches(R: Array, errors: Array | float = 0.0) -> ToolTouches:
    return ToolTouches(transform(R, POINT - R @ TIP + errors))


def planned(count: int = 10, cone: float = 45.0) -> Array:
    return plan_touch_orientations(count, np.radians(cone))


@pytest.mark.parametrize("count", [4, 5, 10, 50])
def test_exact_touches_give_the_tip_to_a_picometre(count: int) -> None:
    for R in (planned(count), Rotation.random(count, random_state=count).as_matrix()):
        found = fit_tool_point(touches(R))
        np.testing.assert_allclose(found.point, TIP, atol=1e-12)
        np.testing.assert_allclose(found.touched, POINT, atol=1e-12)


def test_over_many_draws_the_error_is_the_cramer_rao_bound() -> None:
    """The mean square of 4000 draws tells the rms to 0.65%."""
    rng, R = np.random.default_rng(1), planned()
    errors = [fit_tool_point(touches(R, SIGMA * rng.standard_normal((10, 3)))).point - TIP for _ in range(4000)]
    rms = float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1))))
    assert 0.98 < rms / point_error_bound(R, SIGMA) <= 1.02
    assert rms <= 3.3e-5


def test_the_stated_covariance_is_that_of_the_errors() -> None:
    rng, R = np.random.default_rng(2), planned(7)
    found = [fit_tool_point(touches(R, SIGMA * rng.standard_normal((7, 3))), SIGMA) for _ in range(3000)]
    errors = np.array([np.concatenate([one.point - TIP, one.touched - POINT]) for one in found])
    scale = np.sqrt(np.diag(found[0].covariance))
    np.testing.assert_allclose(
        np.cov(errors.T) / np.outer(scale, scale), found[0].covariance / np.outer(scale, scale), atol=0.08
    )
    assert np.mean([fit_tool_point(touches(R, SIGMA * rng.standard_normal((7, 3)))).noise for _ in range(500)]) == (
        pytest.approx(SIGMA, rel=0.03)
    )


@pytest.mark.parametrize("count", range(4, 21))
@pytest.mark.parametrize("cone", [30.0, 45.0, 62.0, 90.0])
def test_the_planner_reaches_the_best_a_cone_allows(count: int, cone: float) -> None:
    best = SIGMA * np.sqrt((2.0 + 1.0 / np.sin(np.radians(cone)) ** 2) / count)
    assert point_error_bound(planned(count, cone), SIGMA) == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize("count", [4, 7, 10])
def test_from_62_degrees_on_the_plan_is_within_5_percent_of_the_best_there_is(count: int) -> None:
    assert point_error_bound(planned(count, 62.0), SIGMA) <= 1.05 * SIGMA * np.sqrt(3.0 / count)


def spin(count: int) -> Array:
    return Rotation.from_euler("z", np.linspace(0.0, 3.0, count)[:, None]).as_matrix()


def coning(count: int, sense: float) -> Array:
    """Tilted by 45 deg towards azimuth 2 pi k / n about a line in the flange's plane, then spun by it."""
    azimuth = 2.0 * np.pi * np.arange(count) / count
    tilt = np.pi / 4.0 * np.column_stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(count)])
    turned = Rotation.from_rotvec(tilt) * Rotation.from_euler("z", sense * azimuth[:, None])
    return np.asarray(turned.as_matrix())


@pytest.mark.parametrize(
    ("R", "said"),
    [
        (planned(3 + 1)[:3], "3 touches cannot tell"),
        (spin(8), r"direction \(0.00, 0.00, 1.00\) of the flange points the same way"),
        (coning(8, 1.0), "points the same way"),
        (np.tile(np.eye(3), (6, 1, 1)), "stands nearly the same in all 6 touches"),
    ],
)
def test_orientations_that_cannot_tell_are_refused(R: Array, said: str) -> None:
    with pytest.raises(CalibrationError, match=said):
        fit_tool_point(touches(R))


def test_a_cone_spun_the_other_way_tells() -> None:
    assert orientation_spread(coning(8, -1.0))[0][0] > 0.3
    np.testing.assert_allclose(fit_tool_point(touches(coning(8, -1.0))).point, TIP, atol=1e-12)


@pytest.mark.parametrize("wrong", range(10))
def test_a_touch_two_millimetres_off_is_named_and_left_out(wrong: int) -> None:
    rng = np.random.default_rng(wrong)
    errors = SIGMA * rng.standard_normal((10, 3))
    errors[wrong] += 2e-3 * np.array([0.6, -0.64, 0.48])
    found = fit_tool_point_without_outliers(touches(planned(), errors))
    assert np.flatnonzero(~found.used).tolist() == [wrong]
    assert np.linalg.norm(found.point - TIP) < 1e-4


def test_two_wrong_touches_of_ten_are_both_named() -> None:
    errors = SIGMA * np.random.default_rng(4).standard_normal((10, 3))
    errors[2] += [2e-3, 0.0, 0.0]
    errors[7] += [2e-3, 0.0, 5e-4]
    found = fit_tool_point_without_outliers(touches(planned(), errors))
    assert np.flatnonzero(~found.used).tolist() == [2, 7]


def test_nothing_is_left_out_of_good_touches() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        found = fit_tool_point_without_outliers(touches(planned(), SIGMA * rng.standard_normal((10, 3))))
        assert found.used.all()


def test_four_wrong_touches_of_ten_are_not_believed() -> None:
    errors = SIGMA * np.random.default_rng(6).standard_normal((10, 3))
    errors[:4] += 0.01 * np.random.default_rng(7).standard_normal((4, 3))
    with pytest.raises(CalibrationError, match="more than 25% of the 10 touches do not fit"):
        fit_tool_point_without_outliers(touches(planned(), errors))


def test_a_left_handed_orientation_is_named() -> None:
    R = planned()
    R[3] = R[3][:, [1, 0, 2]]
    with pytest.raises(CalibrationError, match="orientation of touch 4 is not a right-handed rotation"):
        touches(R)
