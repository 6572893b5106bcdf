"""Deviations of smoothed motions from their polyline: closed forms of paper 4 against what is measured."""

import numpy as np
import pytest

from polish_sim.motion.rules.chain import Chain, build_chain, chain_from_axes
from polish_sim.motion.rules.deviation import measure_deviation, vertex_distances
from polish_sim.motion.rules.fir import box_progress, corner_overlap, corner_speed, filter_rise, fir_schedule
from polish_sim.motion.rules.schedule import Schedule, Smoothed

MM = 1e-3
TRIPLE = np.array([0.1, 0.05, 0.02])


def straight(tips: np.ndarray) -> Chain:
    return build_chain(tips, np.tile(np.eye(3), (len(tips), 1, 1)))


def overlapped(chain: Chain, overlap: float) -> Schedule:
    n = len(chain.lengths)
    return fir_schedule(np.arange(n) * (TRIPLE.sum() - overlap), np.tile(TRIPLE, (n, 1)))


def vertex_error(overlap: float, t2: float, t3: float, change: float) -> float:
    """Distance from the vertex of two segments with the same filters (paper 4, eq. 12)."""
    if overlap <= 2.0 * t3:
        return overlap**3 * change / (48.0 * t2 * t3)
    return (4.0 * t3**2 - 6.0 * t3 * overlap + 3.0 * overlap**2) * change / (24.0 * t2)


def contour_error(overlap: float, t2: float, t3: float, change: float, cosine: float) -> float:
    """Distance from the polyline: the vertex error times the cosine of half the turn."""
    return vertex_error(overlap, t2, t3, change) * np.sqrt(0.5 * (1.0 + cosine))


def test_symmetric_corners_use_their_tolerance_and_no_more_to_1e_12_mm():
    """At the vertex half way through the overlap, which is at most as long as the filters."""
    rng, rates, limited = np.random.default_rng(0), np.empty(4), 0
    for _ in range(2000):
        a, b, c = -np.sort(-(10.0 ** rng.uniform(-3.0, 0.5, 3)))
        length, tolerance = 10.0 ** rng.uniform([-1.7, -4.0], [1.7, 0.0])  # [mm]
        turn = rng.uniform(0.0, np.pi)
        change = corner_speed(length / a, length / a, np.cos(turn))
        overlap = corner_overlap(tolerance, change, b, c, b, c)
        most = vertex_error(b + c, b, c, change)
        box_progress(a, b, c, 0.5 * overlap, rates)
        measured = length * rates[0] * 2.0 * np.sin(0.5 * turn)
        assert vertex_error(overlap, b, c, change) == pytest.approx(min(tolerance, most), abs=1e-12)
        assert measured == pytest.approx(min(tolerance, most), abs=1e-12)
        limited += most < tolerance
    assert 200 < limited < 1800  # both branches


@pytest.mark.parametrize(("t2", "t3"), [(0.07, 0.03), (0.05, 0.05), (0.07, 0.0)])
def test_the_time_of_a_rise_is_the_inverse_of_the_papers_error(t2, t3):
    for overlap in np.linspace(0.001, t2 + t3, 40):
        assert 2.0 * filter_rise(t2, t3, vertex_error(overlap, t2, t3, 1.0)) == pytest.approx(
            overlap, rel=1e-9
        )
    assert filter_rise(t2, t3, 100.0) == pytest.approx(0.5 * (t2 + t3))


@pytest.mark.parametrize("turn", [0.05, 1.5, 3.1])
def test_a_corner_s_vertex_and_contour_error_are_what_is_measured(turn):
    chain = straight(5.0 * MM * np.array([[-1.0, 0, 0], [0, 0, 0], [np.cos(turn), np.sin(turn), 0.0]]))
    found = measure_deviation(Smoothed(chain, overlapped(chain, 0.05)), chain)
    change = corner_speed(0.05, 0.05, np.cos(turn))
    contour = contour_error(0.05, 0.05, 0.02, change, np.cos(turn))
    assert found.vertex.value == pytest.approx(vertex_error(0.05, 0.05, 0.02, change), abs=1e-15)
    assert found.contour.value == pytest.approx(contour, rel=1e-10)
    assert found.contour.time == pytest.approx(found.vertex.time, abs=1e-3)
    assert found.vertex.time == pytest.approx(TRIPLE.sum() - 0.025, abs=1e-6)


def test_unlike_corners_stay_within_their_tolerance():
    rng, used = np.random.default_rng(1), []
    for _ in range(60):
        triples = -np.sort(-(10.0 ** rng.uniform(-2.0, 0.0, (2, 3))), axis=1)
        lengths, turn, tolerance = rng.uniform(1.0, 20.0, 2) * MM, rng.uniform(0.05, 3.1), 0.02 * MM
        end = lengths[1] * np.array([np.cos(turn), np.sin(turn), 0.0])
        chain = straight(np.array([[-lengths[0], 0, 0], [0, 0, 0], end]))
        change = corner_speed(*(lengths / triples[:, 0]), np.cos(turn))
        overlap = corner_overlap(tolerance, change, *triples[0, 1:], *triples[1, 1:])
        schedule = fir_schedule(np.array([0.0, triples[0].sum() - overlap]), triples)
        found = measure_deviation(Smoothed(chain, schedule), chain)
        assert found.vertex.value <= tolerance * (1.0 + 1e-9)
        assert found.contour.value <= tolerance * (1.0 + 1e-9)
        used.append(found.vertex.value / tolerance)
    assert max(used) > 0.95


def test_the_axis_strays_by_its_formula_on_a_flat_sphere_and_less_on_a_round_one():
    for size, exact in ((1e-3, 1e-6), (1.0, 0.2)):
        half = 0.7
        axes = np.array([[0.0, 0, 1], [np.sin(size), 0, np.cos(size)]])
        on = np.array([np.cos(2 * half) * np.sin(size), np.sin(2 * half) * np.sin(size), np.cos(size)])
        chain = chain_from_axes(np.zeros((3, 3)), np.stack([axes[1] * [-1, 1, 1], axes[0], on]))
        found = measure_deviation(Smoothed(chain, overlapped(chain, 0.06)), chain).axis.value
        change = corner_speed(size / 0.1, size / 0.1, np.cos(2 * half))
        bound = contour_error(0.06, 0.05, 0.02, change, np.cos(2 * half))
        assert bound * (1.0 - exact) <= found <= bound * (1.0 + 1e-9)


def test_stopping_everywhere_strays_nowhere():
    chain = straight(np.random.default_rng(0).normal(size=(30, 3)))
    found = measure_deviation(Smoothed(chain, overlapped(chain, 0.0)), chain)
    assert found.contour.value < 1e-14  # rounding of places some metres from the origin
    assert found.vertex.value < 1e-15
    assert found.axis.value == 0.0


def test_a_path_that_crosses_itself_is_measured_on_its_own_strand():
    """The corner at (1, 0) is cut; another strand runs through just there."""
    chain = straight(np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 1, 0], [0.97, 1, 0], [1.0, -1.0, 0]]))
    motion = Smoothed(chain, overlapped(chain, 0.07))
    wanted = vertex_error(0.07, 0.05, 0.02, 10.0 * np.sqrt(2.0))
    assert vertex_distances(motion, chain)[0][1] == pytest.approx(wanted, rel=1e-12)
    assert measure_deviation(motion, chain).contour.value >= wanted / np.sqrt(2.0) * (1.0 - 1e-9)


def test_three_and_more_at_once_are_measured_as_dense_sampling_does():
    rng = np.random.default_rng(3)
    tips = np.cumsum(rng.normal(size=(12, 3)), axis=0) * 1e-3
    axes = np.column_stack([0.05 * rng.normal(size=(12, 2)), -np.ones(12)])
    chain = chain_from_axes(tips, axes)
    schedule = overlapped(chain, 0.12)
    found = measure_deviation(Smoothed(chain, schedule), chain)
    times = np.linspace(0.0, schedule.end, 40_001)
    samples = Smoothed(chain, schedule).sample(times)
    to_vertex = np.linalg.norm(samples.tips[:, 0, None] - tips, axis=2).min(axis=0).max()
    assert found.vertex.value == pytest.approx(to_vertex, rel=1e-5)
    along = np.einsum("nkj,kj->nk", samples.tips[:, 0, None] - tips[:-1], chain.directions)
    feet = tips[:-1] + np.clip(along, 0.0, chain.lengths)[..., None] * chain.directions
    apart = np.linalg.norm(samples.tips[:, 0, None] - feet, axis=2)
    # the whole polyline is nearer than a stretch
    assert found.contour.value >= apart.min(axis=1).max() * (1.0 - 1e-9)
    assert found.contour.value == pytest.approx(apart.min(axis=1).max(), rel=1e-4)


def test_a_circle_in_full_overlap_shrinks_by_two_sincs():
    """Chords follow one another every T1: a polygon, R sinc(w T1/2)^2, by sinc(w T2/2) sinc(w T3/2)."""
    radius, count = 0.05, 720
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    chain = straight(radius * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]))
    step, filters = 0.002, np.array([0.11, 0.06])
    schedule = fir_schedule(np.arange(count) * step, np.tile([step, *filters], (count, 1)))
    samples = Smoothed(chain, schedule).sample(np.linspace(0.3, 1.2, 200))
    turning = 2.0 * np.pi / count / step
    polygon = radius * np.sinc(1.0 / count) ** 2
    wanted = polygon * np.prod(np.sinc(turning * filters / (2.0 * np.pi)))
    np.testing.assert_allclose(np.linalg.norm(samples.tips[:, 0], axis=1), wanted, rtol=1e-8)
