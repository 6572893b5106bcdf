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
    Share,
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


@pytest.fixture(scope="module")
def shares(prediction: Prediction, drawn: dict[str, Array]) -> dict[str, Share]:
    return compare_shares(TRIAL, prediction.covariances, drawn)


def test_each_source_alone_and_all_together_are_drawn_as_predicted(shares: dict[str, Share]) -> None:
    """Four standard errors; sixty draws determine an rms to about 5%, so a wrong lever or a missing source
    shows."""
    assert set(shares) == {*SOURCES, TOGETHER}
    for share in shares.values():
        assert abs(share.deviation_sigma) < 4.0
        assert share.drawn_rms_std_m < 0.1 * share.drawn_rms_m
        assert share.drawn_p95_m == pytest.approx(share.predicted_p95_m, rel=0.2)


@pytest.mark.parametrize("source", [*SOURCES, TOGETHER])
def test_errors_stretch_as_their_covariance_does(
    source: str, prediction: Prediction, drawn: dict[str, Array]
) -> None:
    """Whitened by the prediction each place's errors have mean 0 and variance 1 in every direction."""
    covariances = prediction.covariances[source]
    white = np.stack(
        [np.linalg.solve(np.linalg.cholesky(C), drawn[source][:, k].T) for k, C in enumerate(covariances)]
    )
    # 60 draws: a variance has a standard error of sqrt(2 / 60), a mean of 1 / sqrt(60).
    assert np.abs(np.mean(white**2, axis=2) - 1.0).max() < 4.5 * np.sqrt(2.0 / 60.0)
    assert np.abs(np.mean(white, axis=2)).max() < 4.5 / np.sqrt(60.0)


def test_sources_add_up_as_vectors_draw_by_draw(drawn: dict[str, Array]) -> None:
    """To first order: what is left is a product of two of them, nanometres."""
    np.testing.assert_allclose(sum(drawn[name] for name in SOURCES), drawn[TOGETHER], atol=1e-7)


def test_one_by_one_the_tool_is_off_by_its_tips_bound_wherever_it_works(alone: Prediction) -> None:
    """Closed form for a cone of 45 deg: sigma sqrt((2 + 1 / sin^2 45) / 10)."""
    rms = np.sqrt(np.trace(alone.covariances["tool"], axis1=1, axis2=2))
    np.testing.assert_allclose(rms, 5e-5 * np.sqrt(0.4), rtol=1e-6)


def test_ten_times_the_noise_is_ten_times_the_error(prediction: Prediction) -> None:
    ten = replace(TRIAL, dual=DualConfig(tracker_noise_m=3e-4, touch_noise_m=5e-4))
    one, many = prediction.covariances, predict(ten).covariances
    for name in one:
        np.testing.assert_allclose(many[name], 100.0 * one[name], rtol=1e-3, atol=1e-13)


@pytest.fixture
def one_design(monkeypatch: pytest.MonkeyPatch) -> None:
    """What holds for every design of the calibrations is looked at for one."""
    monkeypatch.setattr("polish_sim.dual.budget.DESIGNS", 1)


@pytest.mark.usefixtures("one_design")
def test_an_exact_tracker_leaves_the_touches_alone() -> None:
    exact = replace(ONE_BY_ONE, draws=2, dual=replace(ONE_BY_ONE.dual, tracker_noise_m=0.0))
    errors = list(draw_errors(exact))
    shares = compare_shares(
        exact, predict(exact).covariances, {name: np.stack([e[name] for e in errors]) for name in errors[0]}
    )
    assert shares["bases"].predicted_rms_m == 0.0
    assert shares["bases"].drawn_rms_m < 1e-10
    assert shares["closing"].predicted_rms_m == 0.0
    assert shares["closing"].drawn_rms_m < 1e-14
    assert shares[TOGETHER].predicted_rms_m == pytest.approx(
        np.hypot(shares["tool"].predicted_rms_m, shares["part"].predicted_rms_m)
    )


@pytest.mark.usefixtures("one_design")
def test_exact_instruments_put_the_tool_where_it_is_wanted() -> None:
    exact = replace(TRIAL, draws=1, dual=DualConfig(tracker_noise_m=0.0, touch_noise_m=0.0))
    for errors in next(draw_errors(exact)).values():
        assert np.abs(errors).max() < 1e-11
    assert all(not covariance.any() for covariance in predict(exact).covariances.values())


def test_the_tool_on_the_part_is_as_close_as_asked_with_or_without_closing_touches(
    shares: dict[str, Share], alone: Prediction
) -> None:
    assert np.sqrt(np.mean(np.trace(alone.covariances[TOGETHER], axis1=1, axis2=2))) <= 6e-5
    assert shares[TOGETHER].predicted_rms_m <= 6e-5
    assert shares[TOGETHER].predicted_p95_m <= 1e-4


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
