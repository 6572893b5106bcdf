"""Log and common figures of an arm in free space, whose runs the cell's loop does not record."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.config import Checked
from polish_sim.log import RunLog, Trace, from_rows, row_layout, row_width, with_column


class ToolMotion(NamedTuple):
    """What the tool did and what it was to do, base frame; n instants."""

    tips: Array  #: Tool points [m], shape (n, 3)
    frames: Array  #: R_base_tool, shape (n, 3, 3)
    speed: Array  #: [m/s], shape (n,)
    wanted: Array  #: Targets [m], shape (n, 3)
    wanted_frames: Array  #: Shape (n, 3, 3)

    def columns(self) -> dict[str, Array]:
        """Columns of the log."""
        return {
            "tcp_position_m": self.tips,
            "tcp_quaternion_wxyz": Rotation.from_matrix(self.frames).as_quat(scalar_first=True),
            "target_position_m": self.wanted,
            "target_quaternion_wxyz": Rotation.from_matrix(self.wanted_frames).as_quat(scalar_first=True),
            "tcp_speed_m_s": self.speed,
        }

    def trace(self, time: Array, phase: NDArray[Any], place: Array, across: Array | None = None) -> Trace:
        """The exact trace, with no contact; ``place``: arc length [m], (n,); ``across``: part of the error
        across the target's axis [m], (n, 3), all of it if not given."""
        off, nothing = self.wanted - self.tips, np.zeros(len(time))
        still = np.zeros_like(off)
        turned = Rotation.from_matrix(self.wanted_frames) * Rotation.from_matrix(self.frames).inv()
        far, aside = (np.linalg.norm(error, axis=1) for error in (off, off if across is None else across))
        return Trace(
            time, phase.astype(np.int8), nothing, far, aside, turned.magnitude(), self.tips, self.speed,
            place, still, nothing, nothing, off, still,
        )  # fmt: skip


def free_log(
    scenario: Checked, played: Sequence[Any], columns_of: Callable[[Any, int, int, bool], dict[str, Array]]
) -> RunLog:
    """One log of what was ``played``, one after the other, each at its own time from 0.

    ``columns_of`` gives columns of the log by name, (n,) or (n, k), those of ``log.LATER`` last, of one of
    them, its number, steps a row, and whether the arm is a real one; what is not there is zero.
    """
    parts = [
        columns_of(play, number, scenario.simulation.log_every, scenario.robot.elastic)
        for number, play in enumerate(played)
    ]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    rows = np.zeros((len(columns["time_s"]), row_width()))
    for name, (start, width) in row_layout().items():
        if name in columns:
            rows[:, start : start + max(width, 1)] = columns.pop(name).reshape(len(rows), -1)
    log = from_rows(rows)
    for name, values in columns.items():
        log = with_column(log, name, values)
    return log


def free_figures(
    seed: int, T_base_work: Array | None, steps: int, simulated: float, wall: float
) -> dict[str, Any]:
    """The figures every experiment reports, of a run that went to its end; times in s."""
    return {
        "path_done": 1.0,
        "protective_stop": None,
        "interrupted": False,
        "faults_missed": [],
        "T_base_work": None if T_base_work is None else T_base_work.tolist(),
        "simulated_s": simulated,
        "wall_s": wall,
        "real_time_factor": simulated / wall if wall else 0.0,
        "steps": steps,
        "seed": seed,
    }
