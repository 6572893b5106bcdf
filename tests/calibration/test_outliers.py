"""A knocked sensor is found; an honest one is believed."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.calibration import PayloadReadings, fit_without_outliers
from polish_sim.errors import CalibrationError
from tests.calibration.test_payload import MASS, NOISE, POSES, THETA, Array, readings_in


def knocked(rng: np.random.Generator, knocks: dict[int, Array]) -> PayloadReadings:
    errors = NOISE * rng.standard_normal((12, 6))
    for reading, knock in knocks.items():
        errors[reading] += knock
    return readings_in(POSES, errors=errors)


PUSH, TWIST = np.array([0.0, 1.0, 0.0, 0, 0, 0]), np.array([0, 0, 0, 0.0, 0.0, 0.05])


@pytest.mark.parametrize("knocks", [{4: PUSH}, {9: TWIST}, {0: PUSH, 7: TWIST}, {2: PUSH, 3: -PUSH, 11: TWIST}])
def test_touched_readings_are_left_out_and_named(knocks: dict[int, Array]) -> None:
    found = [fit_without_outliers(knocked(np.random.default_rng(seed), knocks)) for seed in range(40)]
    right = [set(np.flatnonzero(~one.used)) == set(knocks) for one in found]
    assert np.mean(right) > 0.9
    assert max(abs(one.mass - MASS) for one, good in zip(found, right, strict=True) if good) < 0.01


@pytest.mark.parametrize("knock", [1e2, 1e4, 1e6])
def test_a_reading_however_far_off_is_left_out_and_the_tool_is_found(knock: float) -> None:
    found = fit_without_outliers(knocked(np.random.default_rng(0), {4: knock * PUSH}))
    assert set(np.flatnonzero(~found.used)) == {4}
    assert found.mass == pytest.approx(MASS, rel=0.01)


def test_honest_readings_are_kept() -> None:
    found = [fit_without_outliers(knocked(np.random.default_rng(seed), {})) for seed in range(300)]
    assert np.mean([one.used.all() for one in found]) > 0.99


def test_exact_readings_are_kept() -> None:
    found = fit_without_outliers(readings_in(POSES))
    assert found.used.all()
    np.testing.assert_allclose(found.theta, THETA, atol=1e-9)


def test_when_too_many_disagree_nobody_is_believed() -> None:
    rng = np.random.default_rng(0)
    knocks = {reading: rng.uniform(2.0, 9.0) * np.roll(PUSH, reading) for reading in range(5)}
    with pytest.raises(CalibrationError, match="more than 25% of the 12 readings"):
        fit_without_outliers(knocked(rng, knocks))


def test_of_a_few_readings_none_is_left_out() -> None:
    first = knocked(np.random.default_rng(1), {0: PUSH})
    assert fit_without_outliers(first.rows(np.arange(12) < 6)).used.all()
