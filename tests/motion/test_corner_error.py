"""Errors of overlapped corners: the formulas of paper 4 against what the motion does."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from polish_sim.motion.rules.chain import build_chain, chain_from_axes
from polish_sim.motion.rules.deviation import measure_deviation
from polish_sim.motion.rules.fir import box_progress, corner_overlap, corner_speed, fir_schedule, rise_time
from polish_sim.motion.rules.schedule import Smoothed

MM = 1e-3


@njit
def rise_way(b, c, time):  # type: ignore[no-untyped-def]
    """Way of a speed that rises from 0 to 1 over b + c, within the first half of that."""
    if time < c:
        return time * (time / b) * (time / c) / 6.0
    return (3.0 * time * (time - c) + c * c) / (6.0 * b)


@njit
def vertex_error(overlap, t2, t3, change):  # type: ignore[no-untyped-def]
    """Distance from the vertex of two segments with the same filters (paper 4, eq. 12)."""
    return change * rise_way(t2, t3, 0.5 * overlap)


def contour_error(overlap: float, t2: float, t3: float, change: float, cosine: float) -> float:
    """Distance from the polyline: the vertex error times the cosine of half the turn."""
    return float(vertex_error(overlap, t2, t3, change)) * np.sqrt(0.5 * (1.0 + cosine))


@njit
def symmetric_corners(lengths, triples, turns, tolerances, formula, planned, measured):  # type: ignore[no-untyped-def]
    """Per corner: error at the largest overlap, and the distance from the vertex half way through the planned
    one."""
    rates = np.empty(4)
    for i in range(len(lengths)):
        a, b, c = triples[i]
        speed = lengths[i] / a
        change = corner_speed(speed, speed, np.cos(turns[i]))
        overlap = corner_overlap(tolerances[i], change, b, c, b, c)
        formula[i] = vertex_error(b + c, b, c, change)
        planned[i] = vertex_error(overlap, b, c, change)
        box_progress(a, b, c, 0.5 * overlap, rates)
        measured[i] = lengths[i] * rates[0] * 2.0 * np.sin(0.5 * turns[i])


def test_symmetric_corners_use_their_tolerance_and_no_more_to_1e_12_mm() -> None:
    rng, n = np.random.default_rng(0), 20_000
    triples = -np.sort(-(10.0 ** rng.uniform(-3.0, 0.5, (n, 3))), axis=1)
    lengths, turns = 10.0 ** rng.uniform(-1.7, 1.7, n), rng.uniform(0.0, np.pi, n)  # [mm]
    tolerances = 10.0 ** rng.uniform(-4.0, 0.0, n)
    formula, planned, measured = np.empty((3, n))
    symmetric_corners(lengths, triples, turns, tolerances, formula, planned, measured)
    wanted = np.minimum(tolerances, formula)
    assert np.abs(planned - wanted).max() < 1e-12
    assert np.abs(measured - wanted).max() < 1e-12
    assert 0.1 < np.mean(formula < tolerances) < 0.9  # both branches


def test_both_branches_are_those_of_the_paper() -> None:
    t2, t3, change = 0.07, 0.03, 0.04
    for overlap in np.linspace(0.001, t2 + t3, 40):
        first = overlap**3 * change / (48.0 * t2 * t3)
        second = (4.0 * t3**2 - 6.0 * t3 * overlap + 3.0 * overlap**2) * change / (24.0 * t2)
        wanted = first if overlap <= 2.0 * t3 else second
        assert vertex_error(overlap, t2, t3, change) == pytest.approx(wanted, rel=1e-12)
        assert 2.0 * rise_time(t2, t3, wanted / change) == pytest.approx(overlap, rel=1e-9)


def test_the_way_of_a_rise_has_its_filters_inverse() -> None:
    for b, c in ((1.0, 0.3), (1.0, 1.0), (1.0, 0.0)):
        for time in np.linspace(0.01, 0.5 * (b + c), 9):
            assert rise_time(b, c, rise_way(b, c, time)) == pytest.approx(time, rel=1e-12)
    assert rise_time(1.0, 0.2, 100.0) == 0.6


@pytest.mark.parametrize("turn", [0.05, 0.7, 1.5, 2.4, 3.1])
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
    for _ in range(200):
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
