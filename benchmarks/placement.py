"""`python -m benchmarks.placement`: a pose of the part is found wherever a grid of 10,000 poses has one.

Every part is a face of a block, plate or ball of random size that looks in a random direction and is lifted
off the table or not. Where ``PartPlacing`` finds no pose, all poses of the grid are tried with the same
checks.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.config import Scenario
from polish_sim.errors import PolishSimError, ReachError
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.experiments.placement import find_reach, upright
from polish_sim.planning import plan_part
from polish_sim.scenario_file import merge
from polish_sim.spatial import transform

SIDES = ("z", "x", "y", "-z")
"""Of the part that is worked on; z is up."""


def main() -> None:
    """Place random parts and print who found a pose."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.placement", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("--count", type=int, default=12, help="parts")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    head = ("block [mm]", "side", "singular value", "poses of the grid", "planned in [s]", "placed in [s]")
    print("".join(f"{word:>19s}" for word in head))
    for number in range(given.count):
        size = rng.uniform(0.08, 0.7, 3) * [1.0, 1.0, 0.7]
        side = SIDES[number % len(SIDES)]
        begin = time.process_time()
        placing = _placing(size, side)
        if placing is None:
            continue
        planned, begin = time.process_time() - begin, time.process_time()
        try:
            found = f"{placing.chosen().smallest_singular_value:.3f}"
        except ReachError:
            found = ""
        placed, poses = time.process_time() - begin, 0
        if not found:
            poses = sum(_feasible(placing, T) for T in grid(placing))
        shape = " x ".join(f"{1e3 * side_m:.0f}" for side_m in size)
        row = (shape, side, found or "none", "-" if found else str(poses), f"{planned:.2f}", f"{placed:.2f}")
        print("".join(f"{word:>19s}" for word in row), flush=True)


def _placing(size: Array, side: str) -> PartPlacing | None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "block.stl"
        trimesh.creation.box(size * 1e3).export(file)
        axis = "xyz".index(side[-1])
        point = np.zeros(3)
        point[axis] = 0.5e3 * size[axis] * (-1.0 if side[0] == "-" else 1.0)
        region = "point:" + ",".join(f"{value:.3f}" for value in point)
        asked = {"part": {"file": str(file), "up": "z"}, "plan": {"region": region, "stepover_m": 0.03}}
        scenario = merge(Scenario(experiment="surface"), asked, "")
        try:
            plan = plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad)
        except PolishSimError:
            return None
        return PartPlacing(scenario, plan.mesh, plan.surface, plan.path)


def grid(placing: PartPlacing) -> Iterator[Array]:
    """10,000 poses: 10 by 10 places on the table, 20 turns, 5 heights."""
    middle = placing.mesh.vertices.mean(axis=0)
    for x in np.linspace(-0.45, 0.45, 10):
        for y in np.linspace(-0.95, -0.2, 10):
            for z in (0.0, 0.08, 0.2, 0.4, 0.6):
                for turn in np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False):
                    R = Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix() @ upright(placing.mesh.up)
                    yield transform(R, np.array([x, y, z - placing.lowest]) - R @ middle * [1.0, 1.0, 0.0])


def _feasible(placing: PartPlacing, T: Array) -> bool:
    try:
        find_reach(
            placing.positions, placing.axes, iter([T]), above_table=True,
            hindrance=placing.hindrance,
        )  # fmt: skip
    except ReachError:
        return False
    return True


if __name__ == "__main__":
    main()
