"""Intervals hold for noise that stays alike from sample to sample, and are no wider than need be for white noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from polish_sim.identification.estimate import estimate, estimate_widened, inefficiency, sum_samples
from tests.identification.motions import SIGMA, known_robot

KNOWN = known_robot(4000)


def _noise(keep: float, rng: np.random.Generator, samples: int = 4000) -> np.ndarray:
    """Noise of unit variance of which each sample keeps a share of the one before."""
    white = rng.normal(size=(samples, 6))
    return np.asarray(lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, axis=0))


@pytest.mark.parametrize("keep", [0.0, 0.5, 0.9])
def test_the_inefficiency_is_that_of_the_noise(keep: float) -> None:
    rng = np.random.default_rng(0)
    told = rng.random((100_000, 6)) > 0.1
    found = inefficiency(_noise(keep, rng, 100_000) * [1.0, 2.0, 3.0, 1.0, 1.0, 1.0], told)
    np.testing.assert_allclose(found, (1.0 + keep) / (1.0 - keep), rtol=0.15)


@pytest.mark.parametrize(("keep", "white_covers"), [(0.0, 0.93), (0.9, 0.0)])
def test_intervals_hold_the_truth_whatever_the_noises_colour(keep: float, white_covers: float) -> None:
    rng = np.random.default_rng(1)
    white, widened = [], []
    for _draw in range(20):
        torque = KNOWN.torque + _noise(keep, rng) * SIGMA
        sums = sum_samples(KNOWN.model, KNOWN.base, KNOWN.states, torque)
        white.append(estimate(sums).covers(KNOWN.truth))
        found = estimate_widened(KNOWN.model, KNOWN.base, sums, KNOWN.states, torque)
        widened.append(found.covers(KNOWN.truth))
        np.testing.assert_allclose(found.sigma, SIGMA, rtol=0.25)
    assert 0.90 < float(np.mean(widened)) < 0.99
    assert white_covers <= float(np.mean(white)) < max(2.0 * white_covers, 0.6)
