"""The order of the runs: short ways through the air, and what may not be changed stays."""

from __future__ import annotations

from itertools import pairwise, permutations, product

import numpy as np
import pytest

from polish_sim.planning.moves.travel import nearest_neighbours, order_blocks


def air(ends, order, flips):
    """Length of the ways from block to block."""
    walked = [ends[block][::-1] if flip else ends[block] for block, flip in zip(order, flips, strict=True)]
    return sum(np.linalg.norm(b[0] - a[1]) for a, b in pairwise(walked))


def shortest(ends, free):
    """The best of all orders that begin with the first block as it is."""
    n = len(ends)
    best = np.inf
    for rest in permutations(range(1, n)):
        for turns in product(*([[0, 1] if free else [0]] * (n - 1))):
            best = min(best, air(ends, (0, *rest), (0, *turns)))
    return best


@pytest.mark.parametrize("free", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_the_way_is_within_a_tenth_of_the_shortest_of_all(free, seed):
    ends = np.random.default_rng(seed).uniform(size=(6, 2, 3))
    tour = order_blocks(ends, free)
    assert sorted(tour.order) == list(range(6))
    assert air(ends, *tour) <= 1.1 * shortest(ends, free)
    assert free or not tour.backwards.any()


def test_stripes_that_may_be_walked_backwards_become_a_zig_zag():
    y = np.concatenate([[0], np.random.default_rng(1).permutation(39) + 1]) * 0.01
    ends = np.stack([np.stack([0 * y, y, 0 * y], axis=1), np.stack([0 * y + 1.0, y, 0 * y], axis=1)], axis=1)
    tour = order_blocks(ends, True)
    assert air(ends, *tour) == pytest.approx(39 * 0.01)
    assert np.diff(y[tour.order]) == pytest.approx(np.full(39, 0.01))
    assert list(tour.backwards) == [k % 2 == 1 for k in range(40)]


def test_the_first_block_is_the_given_one_unless_a_start_is_asked_for():
    ends = np.random.default_rng(5).uniform(size=(20, 2, 3))
    assert order_blocks(ends, True).order[0] == 0
    assert not order_blocks(ends, True).backwards[0]
    tour = order_blocks(ends, True, ends[7, 1] + 1e-4)
    assert (tour.order[0], tour.backwards[0]) == (7, True)
    assert order_blocks(ends, False, ends[7, 0]).order[0] == 7
    assert order_blocks(ends[:1], True, ends[0, 1]).backwards[0]
    assert not order_blocks(ends[:1], False, ends[0, 1]).backwards[0]


def test_three_hundred_blocks_are_ordered_better_than_by_nearest_neighbours_alone():
    ends = np.random.default_rng(0).uniform(size=(300, 2, 3))
    assert air(ends, *order_blocks(ends, True)) < air(ends, *nearest_neighbours(ends, True, None))
