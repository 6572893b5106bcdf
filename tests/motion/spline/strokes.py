"""Strokes to follow, and an independent look at a motion along them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.motion.rules.chain import Chain, build_chain
from polish_sim.motion.rules.limits import SmoothingLimits, six

Array = NDArray[np.float64]

LIMITS = SmoothingLimits(
    tip_speed=math.inf,
    tip_acceleration=0.6,
    tip_jerk=15.0,
    axis_speed=2.0,
    axis_acceleration=6.0,
    axis_jerk=300.0,
    joint_jerk=six(600.0),
)
TOLERANCES = (1e-4, math.radians(0.2))


def stroke(tips: Array, turns: Array | None = None) -> tuple[Chain, Array]:
    """A chain through tips (n, 3) [m] with frames turned by rotation vectors (n, 3), and arc lengths at its
    points."""
    frames = Rotation.from_rotvec(np.zeros_like(tips) if turns is None else turns).as_matrix()
    chain = build_chain(tips, frames)
    return chain, np.concatenate([[0.0], np.cumsum(chain.lengths)])


def circle(radius: float, rounds: float = 1.0, chord: float = 5e-4) -> Array:
    """Points of a circle [m]."""
    t = np.linspace(0.0, 2.0 * math.pi * rounds, int(2.0 * math.pi * rounds * radius / chord) + 1)
    return np.stack([radius * np.cos(t), radius * np.sin(t), 0.0 * t], axis=1)


def random_stroke(rng: np.random.Generator) -> tuple[Chain, Array]:
    """Steps of one size and turns of one size, both random: smooth and jagged ones."""
    n = int(rng.integers(4, 30))
    step, turn = 10.0 ** rng.uniform(-4, -2), 10.0 ** rng.uniform(-3, -1)
    return stroke(
        np.cumsum(step * rng.normal(size=(n, 3)), axis=0), np.cumsum(turn * rng.normal(size=(n, 3)), axis=0)
    )


def distance_from(points: Array, tips: Array) -> Array:
    """Of points (m, 3) from the polyline through tips (n, 3), segment by segment, shape (m,)."""
    nearest = np.full(len(points), np.inf)
    for a, b in pairwise(tips):
        share = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-30), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    return nearest
