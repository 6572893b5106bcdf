"""A smoothed motion as files: trajectory.npz and trajectory.csv, sampled evenly in time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.smoothing.figures import Motion

Array = NDArray[np.float64]

NPZ, CSV = "trajectory.npz", "trajectory.csv"
TOOL: Final = ("time_s", "x_m", "y_m", "z_m", "nx", "ny", "nz")
JOINTS: Final = tuple(f"q{j}_rad" for j in range(1, 7))
BLOCK: Final = 100_000


def even_times(end: float, rate: float) -> Iterator[Array]:
    """Times of a motion of duration ``end`` [s] at a rate [Hz], blocks (k,) of rising times; the last is its end."""
    # The end is its own sample; one that rounding puts beside it is left out.
    count = int(np.ceil(end * rate - 1e-6))
    for begin in range(0, count + 1, BLOCK):
        times = np.arange(begin, min(begin + BLOCK, count + 1)) / rate
        yield np.minimum(times, end)


def write_trajectory(folder: Path, motions: Iterable[Motion]) -> int:
    """Write a motion as NPZ (to the last bit) and CSV (to 1e-9 m and rad).

    Positions and tool axes are those of the path's frame, the axis from the part to the tool, as in path files; without
    a robot there are no joint angles.

    Args:
        folder: An existing folder.
        motions: The motion, block by block.

    Returns:
        Number of samples.
    """
    blocks: list[tuple[Array, ...]] = []
    with (folder / CSV).open("w", encoding="utf-8", newline="\n") as file:
        for motion in motions:
            block = (motion.times, motion.tool.tips[:, 0], -motion.tool.axes[:, 0], motion.q[0], motion.q[1])
            if not blocks:
                file.write(",".join(TOOL + (JOINTS if motion.q.shape[2] else ())) + "\n")
            # Adding zero turns -0.0 into 0.0.
            np.savetxt(file, np.column_stack(block[:4]) + 0.0, fmt="%.9f", delimiter=",")
            blocks.append(tuple(np.array(column) for column in block))
    names = ("time_s", "tip_m", "axis", "q_rad", "qd_rad_s")
    columns = {name: np.concatenate(parts) for name, parts in zip(names, zip(*blocks, strict=True), strict=True)}
    kept = {name: column for name, column in columns.items() if column.size}
    np.savez_compressed(folder / NPZ, allow_pickle=False, **kept)
    return len(columns["time_s"])
