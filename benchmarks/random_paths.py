"""Random tool paths before the arm: legs of 0.02-50 mm, turns of 0-179 deg, tool axes that turn, near
singularities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.errors import PolishSimError
from polish_sim.motion import forward
from polish_sim.motion.rules.chain import Chain, build_chain
from polish_sim.motion.rules.limits import Arm
from polish_sim.motion.segment_rates import chain_rates, chebyshev_nodes

Array = NDArray[np.float64]

T_FLANGE_TOOL = np.array(
    [[1.0, 0.0, 0.0, 0.01], [0.0, 1.0, 0.0, -0.02], [0.0, 0.0, 1.0, 0.2], [0.0, 0.0, 0.0, 1.0]]
)
KINDS = ("mixed", "short", "long", "zigzag", "smooth", "turning", "wrist", "elbow")
"""What a path is like; the last two begin near a singularity of wrist 2 or of the elbow."""


class RandomPath(NamedTuple):
    """One path with the arm that does it."""

    kind: str
    chain: Chain
    arm: Arm


def draw_path(rng: np.random.Generator, number: int) -> RandomPath:
    """A path the arm can follow, of the kind whose turn it is."""
    kind = KINDS[number % len(KINDS)]
    while True:
        arm = Arm(np.eye(4), T_FLANGE_TOOL, _configuration(rng, kind))
        T = forward(arm.q_start) @ T_FLANGE_TOOL
        count = int(rng.integers(3, 17))
        tips = T[:3, 3] + np.concatenate([np.zeros((1, 3)), np.cumsum(_steps(rng, kind, count), axis=0)])
        try:
            chain = build_chain(tips, _frames(rng, kind, T[:3, :3], count))
            rates = chain_rates(chain, chebyshev_nodes(9), arm)
        except PolishSimError:
            continue
        if np.abs(np.diff(rates.q.reshape(-1, 6), axis=0)).max() < 0.5:
            return RandomPath(kind, chain, arm)


def _configuration(rng: np.random.Generator, kind: str) -> Array:
    q = rng.uniform([-3, -2.2, 0.6, -3, 0.4, -3], [3, -0.6, 2.4, 0, 2.6, 3])
    if kind == "wrist":
        q[4] = np.exp(rng.uniform(np.log(0.01), np.log(0.2)))
    if kind == "elbow":
        q[2] = np.exp(rng.uniform(np.log(0.02), np.log(0.3)))
    return np.asarray(q)


def _steps(rng: np.random.Generator, kind: str, count: int) -> Array:
    """Legs, shape (count, 3) [m]."""
    least, most = {
        "short": (2e-5, 1e-3),
        "long": (5e-3, 5e-2),
        "wrist": (2e-5, 5e-3),
        "elbow": (2e-5, 5e-3),
    }.get(kind, (2e-5, 5e-2))
    lengths = np.exp(rng.uniform(np.log(least), np.log(most), count))
    if kind == "turning":
        lengths *= rng.random(count) > 0.3
    turns = {"zigzag": (170.0, 179.0), "smooth": (0.0, 10.0)}.get(kind, (0.0, 179.0))
    steps, direction = [], rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    for length in lengths:
        steps.append(length * direction)
        normal = np.cross(direction, rng.normal(size=3))
        angle = np.radians(rng.uniform(*turns))
        direction = Rotation.from_rotvec(angle * normal / np.linalg.norm(normal)).apply(direction)
    return np.array(steps)


def _frames(rng: np.random.Generator, kind: str, R: Array, count: int) -> Array:
    """Tool frames, shape (count + 1, 3, 3): each leg turns the axis by up to 5 deg, or not at all, and rolls
    a bit."""
    most = 1.0 if kind in {"wrist", "elbow", "short"} else 5.0
    angles = np.exp(rng.uniform(np.log(0.002), np.log(most), count)) * (rng.random(count) > 0.3)
    if kind == "turning":
        angles = rng.uniform(0.1, most, count)
    frames = [R]
    for angle in np.radians(angles):
        normal = np.cross(frames[-1][:, 2], rng.normal(size=3))
        turn = Rotation.from_rotvec(angle * normal / np.linalg.norm(normal))
        roll = Rotation.from_rotvec([0.0, 0.0, 0.2 * angle * rng.normal()])
        frames.append((turn * Rotation.from_matrix(frames[-1]) * roll).as_matrix())
    return np.array(frames)
