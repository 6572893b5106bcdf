"""Noise of instruments to the tool on the part: what is drawn is what first order says, source by source."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.config import DualConfig
from polish_sim.dual.budget import (
    TOGETHER,
    PairBudgetTrial,
    Prediction,
    compare_shares,
    draw_errors,
    predict,
)
from polish_sim.dual.calibration.pair import SOURCES

TRIAL = PairBudgetTrial(draws=60, points=8, seed=1)
ONE_BY_ONE = replace(TRIAL, dual=DualConfig(closing_touches=0))


@pytest.fixture(scope="module")
def prediction() -> Prediction:
    return predict(TRIAL)


@pytest.fixture(scope="module")
def alone() -> Prediction:
    """Without closing touches."""
    return predict(ONE_BY_ONE)


@pytest.fixture(scope="module")
def drawn() -> dict[str, Array]:
    draws = list(draw_errors(TRIAL))
    return {name: np.stack([one[name] for one in draws]) for name in draws[0]}


def test_each_source_alone_and_all_together_are_drawn_as_predicted(
    prediction: Prediction, drawn: dict[str, Array]
) -> None:
    """Four standard errors; sixty draws determine an rms to about 5%, so a wrong lever or a missing source
    shows. Whitened by the prediction each place's errors have mean 0 and variance 1 in every direction."""
    shares = compare_shares(TRIAL, prediction.covariances, drawn)
    assert set(shares) == {*SOURCES, TOGETHER}
    for name, share in shares.items():
        assert abs(share.deviation_sigma) < 4.0
        assert share.drawn_rms_std_m < 0.1 * share.drawn_rms_m
        assert share.drawn_p95_m == pytest.approx(share.predicted_p95_m, rel=0.2)
        roots = np.linalg.cholesky(prediction.covariances[name])
        white = np.stack([np.linalg.solve(L, drawn[name][:, k].T) for k, L in enumerate(roots)])
        # 60 draws: a variance has a standard error of sqrt(2 / 60), a mean of 1 / sqrt(60).
        assert np.abs(np.mean(white**2, axis=2) - 1.0).max() < 4.5 * np.sqrt(2.0 / 60.0)
        assert np.abs(np.mean(white, axis=2)).max() < 4.5 / np.sqrt(60.0)
    # Sources add up draw by draw: what is left is a product of two of them, nanometres.
    np.testing.assert_allclose(sum(drawn[name] for name in SOURCES), drawn[TOGETHER], atol=1e-7)
    assert shares[TOGETHER].predicted_rms_m <= 6e-5  # as close as asked
    assert shares[TOGETHER].predicted_p95_m <= 1e-4


def test_one_by_one_the_tool_is_off_by_its_tips_bound_wherever_it_works(alone: Prediction) -> None:
    """Closed form for a cone of 45 deg: sigma sqrt((2 + 1 / sin^2 45) / 10)."""
    rms = np.sqrt(np.trace(alone.covariances["tool"], axis1=1, axis2=2))
    np.testing.assert_allclose(rms, 5e-5 * np.sqrt(0.4), rtol=1e-6)
    assert np.sqrt(np.mean(np.trace(alone.covariances[TOGETHER], axis1=1, axis2=2))) <= 6e-5  # as asked


@pytest.mark.parametrize("touch_noise_m", [0.0, 5e-5])
def test_exact_instruments_put_the_tool_where_it_is_wanted_and_an_exact_tracker_leaves_the_touches_alone(
    touch_noise_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("polish_sim.dual.budget.DESIGNS", 1)
    config = DualConfig(tracker_noise_m=0.0, touch_noise_m=touch_noise_m, closing_touches=0)
    exact = replace(TRIAL, draws=2, dual=config)
    errors = list(draw_errors(exact))
    covariances = predict(exact).covariances
    drawn = {name: np.stack([one[name] for one in errors]) for name in SOURCES}
    for name in SOURCES if touch_noise_m == 0.0 else ("bases", "closing"):
        assert np.abs(drawn[name]).max() < 1e-10
        assert not covariances[name].any()
    np.testing.assert_allclose(covariances[TOGETHER], covariances["tool"] + covariances["part"])


def test_closing_touches_leave_fewer_than_one_calibration_in_fifty_beyond_what_is_asked(
    prediction: Prediction, alone: Prediction
) -> None:
    """Found one by one it is one in six; touches of what is to be worked on mend that."""
    assert alone.above_share(6e-5) > 0.1
    assert prediction.above_share(6e-5) < 0.02


def test_the_share_of_calibrations_beyond_a_limit_is_that_of_gaussian_draws(prediction: Prediction) -> None:
    C = np.sum(list(prediction.shares.values()), axis=0)
    x = np.random.default_rng(0).multivariate_normal(np.zeros(15), C, 40_000)
    e = np.einsum("pij,dj->dpi", prediction.slopes, x)
    rms = np.sqrt(np.mean(np.sum(e**2, axis=2), axis=1))
    limit = float(np.percentile(rms, 90.0))
    assert prediction.above_share(limit) == pytest.approx(0.1, abs=4.0 * np.sqrt(0.09 / 40_000))
