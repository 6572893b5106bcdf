"""Chains of segments: what the way points say, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.errors import SmoothingError
from polish_sim.motion.rules.chain import build_chain, chain_from_axes, repeated_points


def random_frames(count: int, seed: int = 0) -> np.ndarray:
    return Rotation.random(count, random_state=seed).as_matrix()


def test_every_segment_ends_in_the_next_way_point_s_frame() -> None:
    tips, frames = np.random.default_rng(0).normal(size=(40, 3)), random_frames(40)
    chain = build_chain(tips, frames)
    np.testing.assert_allclose(chain.tips[:-1] + chain.lengths[:, None] * chain.directions, tips[1:], atol=1e-14)
    turns = Rotation.from_rotvec(chain.angles[:, None] * chain.turn_axes).as_matrix()
    rolls = Rotation.from_rotvec(chain.rolls[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    np.testing.assert_allclose(turns @ frames[:-1] @ rolls, frames[1:], atol=1e-13)
    for axes in (chain.axes[:-1], chain.axes[1:]):
        np.testing.assert_allclose(np.sum(axes * chain.turn_axes, axis=1), 0.0, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 3.0, np.pi - 1e-5])
def test_angles_are_exact_from_nothing_to_nearly_half_a_turn(angle: float) -> None:
    axes = np.array([[1.0, 0.0, 0.0], [np.cos(angle), np.sin(angle), 0.0]])
    chain = chain_from_axes(np.zeros((2, 3)) + [[0.0], [0.01]], axes)
    assert chain.angles[0] == pytest.approx(angle, rel=1e-13, abs=1e-16)
    np.testing.assert_allclose(chain.turn_axes[0], [0.0, 0.0, float(angle > 0.0)], atol=1e-12)


def test_half_a_turn_of_the_axis_names_its_place() -> None:
    tips = np.array([[0.0, 0, 0], [0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]])
    axes = np.array([[0.0, 0, 1], [0.0, 0, 1], [0.0, 0, 1], [0.0, 0, -1]])
    with pytest.raises(SmoothingError, match=r"180 deg between \(10, 0, 0\) mm and \(20, 0, 0\) mm.*2 and 3"):
        chain_from_axes(tips, axes)


def test_points_that_repeat_tip_and_axis_are_left_out_others_stay() -> None:
    tips = np.array([[0.0, 0, 0], [0.0, 0, 0], [0.0, 0, 0], [0.01, 0, 0], [0.01, 0, 0]])
    axes = np.array([[0.0, 0, -1], [0.0, 0, -1], [0.0, 0.6, -0.8], [0.0, 0.6, -0.8], [0.0, 0.6, -0.8]])
    chain = chain_from_axes(tips, axes)
    np.testing.assert_array_equal(repeated_points(tips, chain_frames(axes)), [False, True, False, False, True])
    np.testing.assert_allclose(chain.lengths, [0.0, 0.01])
    np.testing.assert_allclose(chain.angles, [np.arctan2(0.6, 0.8), 0.0])
    np.testing.assert_array_equal(chain.directions[0], 0.0)
    np.testing.assert_array_equal(chain.turn_axes[1], 0.0)


def chain_frames(axes: np.ndarray) -> np.ndarray:
    return np.stack([np.cross([0.0, 1.0, 0.0], axes), np.tile([0.0, 1.0, 0.0], (len(axes), 1)), axes], axis=2)


def test_one_point_is_a_chain_of_no_segments() -> None:
    assert len(build_chain(np.zeros((1, 3)), np.eye(3)[None]).lengths) == 0


@pytest.mark.parametrize(
    ("tips", "frames", "words"),
    [
        (np.zeros((2, 2)), np.zeros((2, 3, 3)), "shape"),
        (np.zeros((0, 3)), np.zeros((0, 3, 3)), "shape"),
        (np.array([[0.0, 0, 0], [np.nan, 0, 0]]), np.tile(np.eye(3), (2, 1, 1)), "way point 1 .* not finite"),
        (np.zeros((2, 3)), np.stack([np.eye(3), 2.0 * np.eye(3)]), "way point 1 .* no rotation"),
    ],
)
def test_what_is_no_chain_is_refused_with_its_place(tips: np.ndarray, frames: np.ndarray, words: str) -> None:
    with pytest.raises(SmoothingError, match=words):
        build_chain(tips, frames)


def test_an_axis_of_no_length_names_its_way_point() -> None:
    with pytest.raises(SmoothingError, match=r"way point 1 .* zero"):
        chain_from_axes(np.zeros((2, 3)), np.array([[0.0, 0, 1], [0.0, 0, 0]]))
