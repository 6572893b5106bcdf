"""Rules played one after the other as a log and a trace like any other run's (layer 9)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.cell import tool_on_flange
from polish_sim.cell.playback import Played
from polish_sim.config import Scenario
from polish_sim.log import RunLog, from_rows, row_layout, row_width, with_column
from polish_sim.motion import forward_many
from polish_sim.motion.segment_rates import JointRates
from polish_sim.trace import Trace

Array = NDArray[np.float64]

PROCESS = 2


class RulePlay(NamedTuple):
    """A path played with one rule, one row a step of the simulation."""

    rule: str
    time: Array
    """[s], shape (n,)."""
    place: Array
    """Arc length of the path the targets are at [m], shape (n,)."""
    targets: JointRates
    played: Played

    @property
    def error(self) -> Array:
        """Target less joint position [rad], shape (n, 6)."""
        return np.asarray(self.targets.q - self.played.q)


class _Tool(NamedTuple):
    """Tool poses of joint angles."""

    positions: Array
    rotations: Array


def log_of_rules(plays: list[RulePlay], scenario: Scenario) -> RunLog:
    """One log of all rules, one after the other, each at its own time from 0; column ``rule`` counts them."""
    rate = scenario.simulation.log_rate_hz
    every = max(1, round(1.0 / (rate * scenario.simulation.timestep_s))) if rate else 1
    log = from_rows(np.concatenate([_rows(play, every) for play in plays]))
    added = {
        "rule": [np.full(len(play.time), k, dtype=float) for k, play in enumerate(plays)],
        "target_q_rad": [play.targets.q for play in plays],
        "target_qd_rad_s": [play.targets.first for play in plays],
        "target_qdd_rad_s2": [play.targets.second for play in plays],
        "target_qddd_rad_s3": [play.targets.third for play in plays],
    }
    for name, columns in added.items():
        log = with_column(log, name, np.concatenate([column[::every] for column in columns]))
    return log


def trace_of_rule(play: RulePlay) -> Trace:
    """The exact trace of one rule, with no contact."""
    n = len(play.time)
    tool, wanted = _tool(play.played.q), _tool(play.targets.q)
    off = wanted.positions - tool.positions
    across = off - np.sum(off * wanted.rotations[:, :, 2], axis=1)[:, None] * wanted.rotations[:, :, 2]
    turned = Rotation.from_matrix(wanted.rotations) * Rotation.from_matrix(tool.rotations).inv()
    nothing = np.zeros(n)
    return Trace(
        play.time, np.full(n, PROCESS, np.int8), nothing, np.linalg.norm(off, axis=1), np.linalg.norm(across, axis=1),
        turned.magnitude(), tool.positions, _speed(tool.positions, play.time), play.place, np.zeros((n, 3)), nothing,
        nothing, off, np.zeros((n, 3)),
    )  # fmt: skip


def _rows(play: RulePlay, every: int) -> Array:
    """Packed rows of the log; what a path in free space does not have is zero."""
    time = play.time[::every]
    tool, wanted = _tool(play.played.q[::every]), _tool(play.targets.q[::every])
    known = {
        "time_s": time,
        "q_rad": play.played.q[::every],
        "qd_rad_s": play.played.qd[::every],
        "torque_nm": play.played.torque[::every],
        "tcp_position_m": tool.positions,
        "tcp_quaternion_wxyz": Rotation.from_matrix(tool.rotations).as_quat(scalar_first=True),
        "target_position_m": wanted.positions,
        "target_quaternion_wxyz": Rotation.from_matrix(wanted.rotations).as_quat(scalar_first=True),
        "tcp_speed_m_s": _speed(tool.positions, time),
        "path_s_m": play.place[::every],
        "phase": np.full(len(time), float(PROCESS)),
    }
    rows = np.zeros((len(time), row_width()))
    for name, (start, width) in row_layout().items():
        if name in known:
            rows[:, start : start + max(width, 1)] = known[name].reshape(len(time), -1)
    return rows


def _tool(q: Array) -> _Tool:
    T_base_tool = forward_many(np.ascontiguousarray(q)) @ tool_on_flange()
    return _Tool(T_base_tool[:, :3, 3], T_base_tool[:, :3, :3])


def _speed(positions: Array, time: Array) -> Array:
    return np.linalg.norm(np.gradient(positions, time, axis=0), axis=1)
