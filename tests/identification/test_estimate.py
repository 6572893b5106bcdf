"""Estimates at the Cramér-Rao bound, intervals that hold the truth, whatever the noise's colour."""

import numpy as np
import pytest
from scipy.signal import lfilter

from polish_sim.errors import IdentificationError
from polish_sim.identification import estimate
from tests.identification.known import SIGMA, covers, known_robot, noisy

KNOWN = known_robot()


def sums_of(torque: np.ndarray) -> estimate.JointSums:
    return estimate.sum_samples(KNOWN.model, KNOWN.base, KNOWN.states, torque)


def test_torques_without_noise_give_the_parameters_back():
    found = estimate.estimate(sums_of(KNOWN.torque))
    np.testing.assert_allclose(found.theta, KNOWN.truth, atol=1e-8)
    np.testing.assert_allclose(found.r_squared, 1.0, atol=1e-9)


def test_errors_are_at_the_cramer_rao_bound_and_intervals_hold_the_truth():
    rng = np.random.default_rng(0)
    squares, covered = [], []
    for _draw in range(50):
        sums = sums_of(noisy(KNOWN.torque, rng))
        found = estimate.estimate(sums)
        squares.append((found.theta - KNOWN.truth) ** 2)
        covered.append(covers(found, KNOWN.truth))
    bound = np.diag(estimate.inverse_of(estimate.information(sums, SIGMA)))
    ratio = float(np.sqrt(np.mean(np.mean(squares, axis=0) / bound)))
    # Fifty draws of fifty-eight correlated numbers determine this ratio to some 2%.
    assert 0.95 < ratio < 1.05
    assert 0.93 <= float(np.mean(covered)) <= 0.97


def test_the_noise_of_every_joint_is_found_and_another_motion_predicted_within_it():
    other = known_robot(seed=5)
    found = estimate.estimate(sums_of(noisy(KNOWN.torque, np.random.default_rng(1))))
    np.testing.assert_allclose(found.sigma, SIGMA, rtol=0.05)
    predicted = KNOWN.model.torque_of_base(other.states, KNOWN.base.columns, found.theta)
    assert estimate.torque_error(predicted, other.torque).max() < 0.01


@pytest.mark.parametrize(
    ("still", "said"), [(slice(3, 4), "wrist_1_joint .*fc4.*fv4"), (slice(1, 6), r"of 58 base parameters")]
)
def test_a_joint_that_stands_still_is_named_with_what_stays_unknown(still, said):
    states = KNOWN.with_still(still)(np.arange(1000) / 100.0)
    sums = estimate.sum_samples(
        KNOWN.model, KNOWN.base, states, KNOWN.model.torque(states, KNOWN.model.truth())
    )
    with pytest.raises(IdentificationError, match=said):
        estimate.require_rank(sums, KNOWN.base, KNOWN.model)


LONG = known_robot(4000)


def _noise(keep: float, rng: np.random.Generator, samples: int = 4000) -> np.ndarray:
    """Noise of unit variance of which each sample keeps a share of the one before."""
    white = rng.normal(size=(samples, 6))
    return np.asarray(lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, axis=0))


@pytest.mark.parametrize("keep", [0.0, 0.9])
def test_the_inefficiency_is_that_of_the_noise(keep):
    rng = np.random.default_rng(0)
    told = rng.random((100_000, 6)) > 0.1
    found = estimate.inefficiency(_noise(keep, rng, 100_000) * [1.0, 2.0, 3.0, 1.0, 1.0, 1.0], told)
    np.testing.assert_allclose(found, (1.0 + keep) / (1.0 - keep), rtol=0.15)


@pytest.mark.parametrize(("keep", "white_covers"), [(0.0, 0.93), (0.9, 0.0)])
def test_intervals_hold_the_truth_whatever_the_noises_colour(keep, white_covers):
    rng = np.random.default_rng(1)
    white, widened = [], []
    for _draw in range(20):
        torque = LONG.torque + _noise(keep, rng) * SIGMA
        sums = estimate.sum_samples(LONG.model, LONG.base, LONG.states, torque)
        white.append(covers(estimate.estimate(sums), LONG.truth))
        found = estimate.estimate_widened(LONG.model, LONG.base, sums, LONG.states, torque)
        widened.append(covers(found, LONG.truth))
        np.testing.assert_allclose(found.sigma, SIGMA, rtol=0.25)
    assert 0.90 < float(np.mean(widened)) < 0.99
    assert white_covers <= float(np.mean(white)) < max(2.0 * white_covers, 0.6)
