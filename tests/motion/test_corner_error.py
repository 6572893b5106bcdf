"""Errors of overlapped corners: the formulas of paper 4 against what the motion does."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.motion.rules.chain import build_chain, chain_from_axes
from polish_sim.motion.rules.deviation import measure_deviation
from polish_sim.motion.rules.fir import box_progress, corner_overlap, corner_speed, fir_schedule, rise_time
from polish_sim.motion.rules.schedule import Smoothed

MM = 1e-3


def vertex_error(overlap: float, t2: float, t3: float, change: float) -> float:
    """Distance from the vertex of two segments with the same filters (paper 4, eq. 12)."""
    if overlap <= 2.0 * t3:
        return overlap**3 * change / (48.0 * t2 * t3)
    return (4.0 * t3**2 - 6.0 * t3 * overlap + 3.0 * overlap**2) * change / (24.0 * t2)


def contour_error(overlap: float, t2: float, t3: float, change: float, cosine: float) -> float:
    """Distance from the polyline: the vertex error times the cosine of half the turn."""
    return vertex_error(overlap, t2, t3, change) * np.sqrt(0.5 * (1.0 + cosine))


def test_symmetric_corners_use_their_tolerance_and_no_more_to_1e_12_mm() -> None:
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
def test_the_time_of_a_rise_is_the_inverse_of_the_papers_error(t2: float, t3: float) -> None:
    for overlap in np.linspace(0.001, t2 + t3, 40):
        assert 2.0 * rise_time(t2, t3, vertex_error(overlap, t2, t3, 1.0)) == pytest.approx(overlap, rel=1e-9)
    assert rise_time(t2, t3, 100.0) == pytest.approx(0.5 * (t2 + t3))


@pytest.mark.parametrize("turn", [0.05, 1.5, 3.1])
def test_a_corner_s_vertex_and_contour_error_are_what_is_measured(turn: float) -> None:
    length, triple, overlap = 5.0 * MM, np.array([0.1, 0.05, 0.02]), 0.05
    tips = length * np.array([[-1.0, 0, 0], [0, 0, 0], [np.cos(turn), np.sin(turn), 0.0]])
    chain = build_chain(tips, np.tile(np.eye(3), (3, 1, 1)))
    schedule = fir_schedule(np.array([0.0, triple.sum() - overlap]), np.tile(triple, (2, 1)))
    found = measure_deviation(Smoothed(chain, schedule), chain)
    change = corner_speed(length / 0.1, length / 0.1, np.cos(turn))
    assert found.vertex.value == pytest.approx(vertex_error(overlap, 0.05, 0.02, change), abs=1e-15)
    assert found.contour.value == pytest.approx(
        contour_error(overlap, 0.05, 0.02, change, np.cos(turn)), rel=1e-10
    )
    assert found.vertex.point == found.contour.point == 1
    assert found.vertex.time == pytest.approx(triple.sum() - 0.5 * overlap, abs=1e-6)


def test_unlike_corners_stay_within_their_tolerance() -> None:
    rng, used = np.random.default_rng(1), []
    for _ in range(60):
        triples = -np.sort(-(10.0 ** rng.uniform(-2.0, 0.0, (2, 3))), axis=1)
        lengths, turn, tolerance = rng.uniform(1.0, 20.0, 2) * MM, rng.uniform(0.05, 3.1), 0.02 * MM
        tips = np.array(
            [[-lengths[0], 0, 0], [0, 0, 0], lengths[1] * np.array([np.cos(turn), np.sin(turn), 0.0])]
        )
        chain = build_chain(tips, np.tile(np.eye(3), (3, 1, 1)))
        change = corner_speed(*(lengths / triples[:, 0]), np.cos(turn))
        overlap = corner_overlap(tolerance, change, *triples[0, 1:], *triples[1, 1:])
        schedule = fir_schedule(np.array([0.0, triples[0].sum() - overlap]), triples)
        found = measure_deviation(Smoothed(chain, schedule), chain)
        assert found.vertex.value <= tolerance * (1.0 + 1e-9)
        assert found.contour.value <= tolerance * (1.0 + 1e-9)
        used.append(found.vertex.value / tolerance)
    assert max(used) > 0.95


def test_the_axis_strays_by_its_formula_on_a_flat_sphere_and_less_on_a_round_one() -> None:
    for size, exact in ((1e-3, 1e-6), (1.0, 0.2)):
        half = 0.7
        axes = np.array([[0.0, 0, 1], [np.sin(size), 0, np.cos(size)]])
        on = np.array([np.cos(2 * half) * np.sin(size), np.sin(2 * half) * np.sin(size), np.cos(size)])
        chain = chain_from_axes(np.zeros((3, 3)), np.stack([axes[1] * [-1, 1, 1], axes[0], on]))
        triple, overlap = np.array([0.1, 0.05, 0.02]), 0.06
        schedule = fir_schedule(np.array([0.0, triple.sum() - overlap]), np.tile(triple, (2, 1)))
        found = measure_deviation(Smoothed(chain, schedule), chain).axis.value
        change = corner_speed(size / 0.1, size / 0.1, np.cos(2 * half))
        bound = contour_error(overlap, 0.05, 0.02, change, np.cos(2 * half))
        assert bound * (1.0 - exact) <= found <= bound * (1.0 + 1e-9)
