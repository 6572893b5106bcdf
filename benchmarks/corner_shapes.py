"""`python -m benchmarks.corner_shapes FILE.npz`: remake the table of corner kernels (needs the extra `bench`)."""

from __future__ import annotations

import math
import sys
from itertools import product
from multiprocessing import Pool
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.corner_program import Corner, braking_time, solve_half

Array = NDArray[np.float64]

HALF = 6
ANGLES = np.array([3, 6, 9, 12, 15, 18, 22, 26, 30, 35, 40, 45, 50, 55, 60, 67.5, 75, 82.5, 90, 97.5, 105, 112.5, 120,
                   130, 140, 150, 160, 170, 178])  # fmt: skip
TOLERANCES = np.array([1e-4, 3e-4, 6e-4, 1e-3, 1.5e-3, 2.2e-3, 3.2e-3, 4.6e-3, 7e-3, 0.01, 0.016, 0.025, 0.04,
                       0.06, 0.1, 0.16, 0.25, 0.4, 0.8, 2.0])  # fmt: skip
SPEEDS = np.array([0.5, 1.0, 2.0, 3.5, 7.0])


class Node(NamedTuple):
    """Where the programme is solved; angle in degrees."""

    angle: float
    tolerance: float
    speed: float


def half_duration(tolerance: float) -> float:
    """Time of half a kernel: longer ones gain little there, and take more of the segments."""
    decades = math.log10(tolerance / 1e-3)
    return max(1.1, 1.2 + 0.667 * decades, 2.33 + 1.4 * (decades - 1.7))


def shape_at(node: Node) -> Array:
    """One node of the table: half duration, X at knots 0 to HALF - 1, Y at knots 1 to HALF."""
    angle = math.radians(node.angle)
    time = half_duration(node.tolerance)
    straight = np.full(30, braking_time(node.speed) / 30)
    half = solve_half(Corner(angle, node.tolerance, node.speed), straight, np.full(HALF, time / HALF), 6)
    difference = np.append(-half.accelerations[1:-1, 0] / math.cos(angle / 2), 0.0)
    new = 0.5 * (half.accelerations[1:, 1] / math.sin(angle / 2) - difference)
    return np.concatenate([[time, half.slowing], difference[:-1], new * math.sin(min(angle, math.pi / 2))])


def main() -> None:
    nodes = [Node(*map(float, node)) for node in product(ANGLES, TOLERANCES, SPEEDS)]
    with Pool() as pool:
        values = np.array(pool.map(shape_at, nodes, chunksize=16), dtype=np.float32)
    shape = (len(ANGLES), len(TOLERANCES), len(SPEEDS), 1 + 2 * HALF)
    np.savez_compressed(
        sys.argv[1],
        angles=np.radians(ANGLES),
        tolerances=TOLERANCES,
        speeds=SPEEDS,
        values=values.reshape(shape),
    )
    print(f"{len(nodes)} kernels")


if __name__ == "__main__":
    main()
