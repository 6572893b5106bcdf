"""The reach map: how well the arm does a path at every distance, turn and height of the part (path -> map ->
poses).

The robot's first joint is vertical, so a part beside the robot is reached as one in front of it: the map
holds parts whose path has its middle straight in front. Its value is Yoshikawa's manipulability, |det J|, at
the path's worst point.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, box_middle, norms
from polish_sim.cell.scene import tool_on_flange
from polish_sim.errors import ReachError
from polish_sim.experiments.placement import LOWEST_JOINT, SPINS, tool_rotations, upright
from polish_sim.kernel_cache import njit
from polish_sim.motion.kinematics import arm_lengths, solve_row
from polish_sim.spatial import inverse, rotations_from_vectors, transform

DISTANCES = np.arange(0.20, 0.96, 0.05)  #: Of the path's middle from the base axis [m]
HEIGHTS = np.array([0.0, 0.03, 0.08, 0.16, 0.25, 0.35, 0.45, 0.6, 0.75])
"""Heights of the part's lowest point above the table [m]."""
TURNS = np.radians(np.arange(0.0, 360.0, 15.0))  #: Of the part about the vertical [rad]
_SAMPLES = 12  #: Points along the path, besides the outermost ones


class ReachMap(NamedTuple):
    """How well the arm does a path, by where the part stands."""

    values: Array
    """Least |det J| over the path in the best configuration, 0 where a point is out of reach or a joint too
    low [m^3], shape (heights, distances, turns, spins)."""
    R_up: Array  #: The part turned upright, R_base_work at turn 0, shape (3, 3)
    middle: Array  #: Of the path's box when upright [m], shape (3,)
    lowest: float  #: Extent of the part along its up side at its lowest [m]

    def pose(self, height: int, distance: int, turn: int) -> Array:
        """T_base_work of a cell of the map, shape (4, 4)."""
        R_turn = rotations_from_vectors([0.0, 0.0, TURNS[turn]])
        x, y, _ = R_turn @ self.middle
        place = np.array([-x, -DISTANCES[distance] - y, HEIGHTS[height] - self.lowest])
        return transform(R_turn @ self.R_up, place)

    def best_first(self) -> Iterator[tuple[Array, float]]:
        """Poses within reach and their tool spin: the best of every height and distance, then their second
        best, ..."""
        heights, distances, turns, spins = self.values.shape
        flat = self.values.reshape(heights * distances, turns * spins)
        order = np.argsort(-flat, axis=1, kind="stable")
        for rank in range(turns * spins):
            rows = np.arange(len(flat))
            values = flat[rows, order[:, rank]]
            if values.max() <= 0.0:
                return
            for row in np.argsort(-values, kind="stable"):
                if values[row] > 0.0:
                    turn, spin = divmod(int(order[row, rank]), spins)
                    height, distance = divmod(row, distances)
                    yield self.pose(height, distance, turn), SPINS[spin]


def map_reach(positions: Array, axes: Array, up: Array, lowest: float) -> ReachMap:
    """Find out how well the arm does a path, wherever the part may stand.

    Tool points and axes from the part to the tool are (n, 3) in the work frame [m]; ``up`` (3,) is the side
    turned up, ``lowest`` [m] the extent of the part along it at its lowest.
    """
    R_up, rows = upright(up), outermost(positions, axes)
    high, out = positions @ R_up.T, axes[rows] @ R_up.T
    middle = box_middle(high)
    points = high[rows] - [*middle[:2], lowest]
    grid = np.meshgrid(HEIGHTS, DISTANCES, indexing="ij")
    shifts = np.stack([np.zeros(grid[0].size), -grid[1].ravel(), grid[0].ravel()], axis=1)
    values, T_tool_flange = np.zeros((len(shifts), len(TURNS), len(SPINS))), inverse(tool_on_flange())
    for turn, angle in enumerate(TURNS):
        R_turn = rotations_from_vectors([0.0, 0.0, angle])
        for spin, around in enumerate(SPINS):
            try:
                rotations = tool_rotations(out @ R_turn.T, around)
            except ReachError:
                continue  # this spin fits no axis of the path
            flanges = transform(rotations, points @ R_turn.T) @ T_tool_flange
            values[:, turn, spin] = _least_manipulability(
                arm_lengths(), np.ascontiguousarray(flanges), shifts
            )
    return ReachMap(values.reshape(*grid[0].shape, len(TURNS), len(SPINS)), R_up, middle, lowest)


def outermost(positions: Array, axes: Array) -> Indices:
    """Rows of the path that go furthest in any direction, and some along it; the furthest from the middle
    first."""
    directions = np.indices((3, 3, 3)).reshape(3, 27) - 1
    extreme = [(values @ directions).argmax(axis=0) for values in (positions, axes)]
    rows = np.unique([*np.linspace(0, len(positions) - 1, _SAMPLES).astype(int), *extreme[0], *extreme[1]])
    away = norms(positions[rows] - positions[rows].mean(axis=0))
    return rows[np.argsort(-away, kind="stable")]


@njit
def _least_manipulability(lengths: Array, T_base_flange: Array, shifts: Array) -> Array:
    """Least |det J| over poses (n, 4, 4) in the best configuration, after each of the shifts (k, 3) of all,
    (k,); ``lengths`` as of `arm_lengths`."""
    values, q = np.zeros(len(shifts)), np.empty(6)
    d1, d5, a2, a3 = lengths[0], lengths[2], lengths[4], lengths[5]
    for k in range(len(shifts)):
        least = np.full(8, np.inf)
        for i in range(len(T_base_flange)):
            T = T_base_flange[i].copy()
            for j in range(3):
                T[j, 3] += shifts[k, j]
            for row in range(8):
                if least[row] == 0.0:
                    continue  # it stays 0
                solve_row(lengths, T, row, 0.0, q)
                value = 0.0
                if not math.isnan(q[0]):
                    q2 = q[1]
                    q23 = q2 + q[2]
                    q234 = q23 + q[3]
                    elbow = d1 + a2 * math.sin(q2)
                    wrist = elbow + a3 * math.sin(q23)
                    if min(elbow, wrist, wrist - d5 * math.cos(q234)) >= LOWEST_JOINT:
                        reach = a2 * math.cos(q2) + a3 * math.cos(q23) + d5 * math.sin(q234)
                        value = abs(a2 * a3 * math.sin(q[2]) * math.sin(q[4]) * reach)
                least[row] = min(least[row], value)
            if least.max() == 0.0:
                break
        values[k] = least.max()
    return values
