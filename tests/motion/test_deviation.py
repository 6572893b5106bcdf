"""Deviations measured on motions whose deviation is known."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.motion.rules.chain import Chain, build_chain, chain_from_axes
from polish_sim.motion.rules.deviation import measure_deviation, vertex_distances
from polish_sim.motion.rules.fir import fir_schedule
from polish_sim.motion.rules.schedule import Schedule, Smoothed, sample_schedule

TRIPLE = np.array([0.1, 0.05, 0.02])


def straight(tips: np.ndarray) -> Chain:
    return build_chain(tips, np.tile(np.eye(3), (len(tips), 1, 1)))


def overlapped(chain: Chain, overlap: float) -> Schedule:
    n = len(chain.lengths)
    return fir_schedule(np.arange(n) * (TRIPLE.sum() - overlap), np.tile(TRIPLE, (n, 1)))


def test_stopping_everywhere_strays_nowhere() -> None:
    chain = straight(np.random.default_rng(0).normal(size=(30, 3)))
    found = measure_deviation(Smoothed(chain, overlapped(chain, 0.0)), chain)
    assert found.contour.value < 1e-14  # rounding of places some metres from the origin
    assert found.vertex.value < 1e-15
    assert found.axis.value == 0.0


def test_a_path_that_crosses_itself_is_measured_on_its_own_strand() -> None:
    """The corner at (1, 0) is cut; another strand runs through just there."""
    tips = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 1, 0], [0.97, 1, 0], [1.0, -1.0, 0]])
    chain = straight(tips)
    schedule = overlapped(chain, 0.07)
    speed = 1.0 / 0.1
    distances, _ = vertex_distances(Smoothed(chain, schedule), chain)
    wanted = speed * np.sqrt(2.0) * (4 * 0.02**2 - 6 * 0.02 * 0.07 + 3 * 0.07**2) / (24 * 0.05)
    assert distances[1] == pytest.approx(wanted, rel=1e-12)
    assert measure_deviation(Smoothed(chain, schedule), chain).contour.value >= wanted / np.sqrt(2.0) * (
        1.0 - 1e-9
    )


def test_three_and_more_at_once_are_measured_as_dense_sampling_does() -> None:
    rng = np.random.default_rng(3)
    tips = np.cumsum(rng.normal(size=(12, 3)), axis=0) * 1e-3
    axes = np.column_stack([0.05 * rng.normal(size=(12, 2)), -np.ones(12)])
    chain = chain_from_axes(tips, axes)
    schedule = overlapped(chain, 0.12)
    found = measure_deviation(Smoothed(chain, schedule), chain)
    times = np.linspace(0.0, schedule.end, 40_001)
    samples = sample_schedule(chain, schedule, times)
    to_vertex = np.linalg.norm(samples.tips[:, 0, None] - tips, axis=2).min(axis=0).max()
    assert found.vertex.value == pytest.approx(to_vertex, rel=1e-5)
    along = np.einsum("nkj,kj->nk", samples.tips[:, 0, None] - tips[:-1], chain.directions)
    feet = tips[:-1] + np.clip(along, 0.0, chain.lengths)[..., None] * chain.directions
    apart = np.linalg.norm(samples.tips[:, 0, None] - feet, axis=2)
    # the whole polyline is nearer than a stretch
    assert found.contour.value >= apart.min(axis=1).max() * (1.0 - 1e-9)
    assert found.contour.value == pytest.approx(apart.min(axis=1).max(), rel=1e-4)


def test_a_circle_in_full_overlap_shrinks_by_two_sincs() -> None:
    """Chords follow one another every T1: a polygon, R sinc(w T1/2)^2 itself, filtered: sinc(w T2/2) sinc(w
    T3/2)."""
    radius, count = 0.05, 720
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    chain = straight(radius * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]))
    step, filters = 0.002, np.array([0.11, 0.06])
    schedule = fir_schedule(np.arange(count) * step, np.tile([step, *filters], (count, 1)))
    samples = sample_schedule(chain, schedule, np.linspace(0.3, 1.2, 200))
    turning = 2.0 * np.pi / count / step
    polygon = radius * np.sinc(1.0 / count) ** 2
    wanted = polygon * np.prod(np.sinc(turning * filters / (2.0 * np.pi)))
    np.testing.assert_allclose(np.linalg.norm(samples.tips[:, 0], axis=1), wanted, rtol=1e-8)
