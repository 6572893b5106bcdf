"""The filtered box against exact rational arithmetic, and the fastest one from rest to rest."""

from fractions import Fraction
from itertools import chain as joined
from itertools import combinations

import numpy as np
import pytest

from polish_sim.motion.rules import fir

SUBSETS = list(joined.from_iterable(combinations(range(3), k) for k in range(4)))
FACTORIALS = (6, 2, 1, 1)


def exact(triple: list[float], time: float, derivative: int) -> Fraction:
    """The sum over the subsets, with fractions."""
    times, t = [Fraction(value) for value in triple], Fraction(time)
    total = Fraction(0)
    for subset in SUBSETS:
        late = t - sum((times[i] for i in subset), Fraction(0))
        if late > 0:
            total += (-1) ** len(subset) * late ** (3 - derivative)
    return total / (FACTORIALS[derivative] * times[0] * times[1] * times[2])


def triples(count: int, seed: int) -> np.ndarray:
    """Times that differ by up to five orders, some equal."""
    rng = np.random.default_rng(seed)
    drawn = 10.0 ** rng.uniform(-4.0, 1.0, (count, 3))
    drawn[::5, 1] = drawn[::5, 0]
    drawn[::10, 2] = drawn[::10, 0]
    return drawn


def progress(triple: np.ndarray, time: float) -> np.ndarray:
    rates = np.empty(4)
    fir.box_progress(*fir.sorted_times(*triple), time, rates)
    return rates


def test_progress_and_derivatives_are_the_sum_over_subsets_to_1e_12():
    """The third derivative away from its steps."""
    rng = np.random.default_rng(1)
    for triple in triples(200, 0):
        steps = np.array([triple[list(subset)].sum() for subset in SUBSETS])
        for time in rng.uniform(0.0, triple.sum(), 6):
            found = progress(triple, time)
            size = 1.0 / np.cumprod(np.concatenate([[1.0], np.sort(triple)[::-1]]))
            for derivative in range(3):
                true = exact(list(triple), time, derivative)
                assert abs(Fraction(found[derivative]) - true) <= 1e-12 * size[derivative]
            if np.abs(steps - time).min() > 1e-9:
                true = float(exact(list(triple), time, 3))
                assert found[3] == pytest.approx(true, rel=1e-12, abs=1e-12 / triple.prod())


def test_it_begins_at_nought_and_ends_at_one_and_times_of_nought_leave_fewer_filters():
    for triple in triples(50, 4):
        np.testing.assert_array_equal(progress(triple, 0.0)[:3], [0.0, 0.0, 0.0])
        np.testing.assert_array_equal(progress(triple, -1.0), [0.0, 0.0, 0.0, 0.0])
        np.testing.assert_array_equal(progress(triple, triple.sum() + 1.0), [1.0, 0.0, 0.0, 0.0])
    assert progress(np.array([2.0, 0.0, 0.0]), 0.5)[0] == 0.25
    np.testing.assert_allclose(progress(np.array([0.0, 2.0, 1.0]), 0.5)[:3], [1 / 16, 0.25, 0.5])


def test_the_pieces_are_the_closed_form():
    durations, coefficients = np.empty(fir.PIECES), np.empty((fir.PIECES, 4))
    special = [[1.0, 1.0, 1.0], [1.0, 0.5, 0.5], [0.0, 2.0, 1.0], [3.0, 0.0, 0.0]]
    for triple in np.concatenate([triples(50, 6), special]):
        count = fir.box_pieces(*triple, durations, coefficients)
        assert durations[:count].sum() == pytest.approx(triple.sum(), rel=1e-14)
        begin = 0.0
        for length, piece in zip(durations[:count], coefficients[:count], strict=True):
            for share in (0.01, 0.5, 0.99):
                t = share * length
                true = progress(triple, begin + t)
                assert piece @ t ** np.arange(4) == pytest.approx(true[0], abs=1e-13)
                rate = piece[1:] @ [1.0, 2.0 * t, 3.0 * t * t]
                assert rate == pytest.approx(true[1], rel=1e-9, abs=1e-12 * true[1])
            begin += length


def test_no_profile_within_the_limits_is_shorter():
    """Each limit is kept, and the profile is limited throughout, and a search finds no shorter one."""
    rng = np.random.default_rng(7)
    for length, v, a, j in 10.0 ** rng.uniform(-3.0, 3.0, (500, 4)):
        times = np.array(fir.stop_times(length, v, a, j))
        # peaks of a box of length 1 whose longest time is at least b + c
        plateau = 1.0 / (times[0] * times[1])
        ratios = [length / times[0] / v, length * plateau / a, length * plateau / times[2] / j]
        assert max(ratios) <= 1.0 + 1e-9
        assert times[0] >= (times[1] + times[2]) * (1.0 - 1e-12)
        assert ratios[2] == pytest.approx(1.0) or ratios[0] == pytest.approx(1.0)
        assert sum(times) <= shortest_by_search(length, v, a, j) * (1.0 + 1e-9)


def shortest_by_search(length: float, v: float, a: float, j: float) -> float:
    """Best of many times of symmetric jerk, acceleration and speed plateaus, from a grid of them."""
    ramp = np.geomspace(1e-4, 1.0, 60) * min(a / j, np.sqrt(v / j), np.cbrt(0.5 * length / j))
    hold = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 60)])[:, None] * v / a
    top = j * ramp * (ramp + hold)
    way = top * (2.0 * ramp + hold)
    time = 2.0 * (2.0 * ramp + hold) + (length - way) / top
    return float(np.where((top <= v) & (way <= length), time, np.inf).min())
