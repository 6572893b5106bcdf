"""Guided moves one after the other as a log, a trace and figures like any other run's (layer 9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.analysis.guiding_figures import GuidedMove, compare_modes, measure_drift, measure_move
from polish_sim.cell.guiding import FORCE, LENT, QD, RAW, SPEED, TIME, TOOL, TORQUE, GuidingRun, Q
from polish_sim.config import Scenario
from polish_sim.experiments.teach_moves import MOVING, OFF, Move, MoveTable
from polish_sim.log import RunLog, from_rows, row_layout, row_width, with_column
from polish_sim.trace import Trace

Array = NDArray[np.float64]


class PlayedMove(NamedTuple):
    """A move and what came of it."""

    move: Move
    table: MoveTable
    run: GuidingRun


def log_of_moves(played: Sequence[PlayedMove], scenario: Scenario) -> RunLog:
    """One log of all moves, each at its own time from 0; column ``case`` counts them."""
    rate = scenario.simulation.log_rate_hz
    every = max(1, round(1.0 / (rate * scenario.simulation.timestep_s))) if rate else 1
    log = from_rows(np.concatenate([_rows(play, every) for play in played]))
    parts = [play.run.rows[::every] for play in played]
    log = with_column(log, "hand_force_n", np.concatenate([part[:, FORCE : FORCE + 3] for part in parts]))
    log = with_column(log, "lent_j", np.concatenate([part[:, LENT] for part in parts]))
    return with_column(log, "case", np.concatenate([np.full(len(part), float(k)) for k, part in enumerate(parts)]))


def trace_of_move(play: PlayedMove) -> Trace:
    """The exact trace of one move, with no contact."""
    rows = play.run.rows
    n, nothing = len(rows), np.zeros(len(rows))
    error = play.table.motion.positions[:n] - rows[:, TOOL : TOOL + 3]
    off = np.linalg.norm(error, axis=1)
    turned = Rotation.from_matrix(play.table.motion.rotations[:n]) * Rotation.from_matrix(play.run.rotations).inv()
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rows[:, TOOL : TOOL + 3], axis=0), axis=1))])
    return Trace(
        rows[:, TIME], play.table.phase[:n], nothing, off, off, turned.magnitude(), rows[:, TOOL : TOOL + 3],
        rows[:, SPEED], way, np.zeros((n, 3)), nothing, nothing, error, np.zeros((n, 3)),
    )  # fmt: skip


def _rows(play: PlayedMove, every: int) -> Array:
    """Packed rows of the log; what an arm in free space does not have is zero."""
    n = len(play.run.rows)
    part, motion = play.run.rows[::every], play.table.motion
    known = {
        "time_s": part[:, TIME],
        "q_rad": part[:, Q : Q + 6],
        "qd_rad_s": part[:, QD : QD + 6],
        "torque_nm": part[:, TORQUE : TORQUE + 6],
        "tcp_position_m": part[:, TOOL : TOOL + 3],
        "tcp_quaternion_wxyz": Rotation.from_matrix(play.run.rotations[::every]).as_quat(scalar_first=True),
        "target_position_m": motion.positions[:n:every],
        "target_quaternion_wxyz": Rotation.from_matrix(motion.rotations[:n:every]).as_quat(scalar_first=True),
        "tcp_speed_m_s": part[:, SPEED],
        "wrench_raw_sensor": part[:, RAW : RAW + 6],
        "phase": play.table.phase[:n:every].astype(float),
    }
    rows = np.zeros((len(part), row_width()))
    for name, (start, width) in row_layout().items():
        if name in known:
            rows[:, start : start + max(width, 1)] = known[name].reshape(len(part), -1)
    return rows


def figures_of_moves(scenario: Scenario, played: Sequence[PlayedMove], asked: int, wall: float) -> dict[str, Any]:
    """Figures of every move under its name, of the last mode as a whole, of the modes beside each other, of the run.

    Args:
        scenario: The scenario.
        played: The moves that were made, the last one followed after the hand let go.
        asked: How many were to be made.
        wall: Time it took [s].
    """
    figures: dict[str, Any] = {}
    measured = [measure_move(_seen(play)) for play in played]
    for play, values in zip(played, measured, strict=True):
        figures |= {f"{_name(play.move)}_{name}": value for name, value in values.items()}
    last = played[-1].move.mode
    of_last = [values for play, values in zip(played, measured, strict=True) if play.move.mode == last]
    # An undefined figure of one move makes that of the mode undefined.
    figures |= {name: float(np.max([values[name] for values in of_last])) for name in of_last[0]}
    figures |= measure_drift(_seen(played[-1]))
    forces = {_name(play.move): values for play, values in zip(played, measured, strict=True)}
    figures |= compare_modes(forces) | {"moves": list(forces), "model": scenario.guide.model_file or "exact"}
    return figures | _of_run(scenario, played, asked, wall)


def _seen(play: PlayedMove) -> GuidedMove:
    rows, phase = play.run.rows, play.table.phase[: len(play.run.rows)]
    return GuidedMove(
        rows[:, TIME], rows[:, FORCE : FORCE + 3], rows[:, Q : Q + 6], phase == MOVING, phase == OFF, _is_whole(play),
        play.run.lent_j,
    )  # fmt: skip


def _is_whole(play: PlayedMove) -> bool:
    """Whether neither a stop, before it or in it, nor an interrupt cut the hand's move short."""
    guided = play.run.stop_step if play.run.stop_reason else len(play.run.rows)
    moving = np.flatnonzero(play.table.phase == MOVING)
    return len(moving) > 0 and guided > int(moving[-1])


def _name(move: Move) -> str:
    return f"{move.mode}_{move.direction}_{move.pace}"


def _of_run(scenario: Scenario, played: Sequence[PlayedMove], asked: int, wall: float) -> dict[str, Any]:
    """The figures every experiment reports."""
    steps = sum(len(play.run.rows) for play in played)
    simulated = steps * scenario.simulation.timestep_s
    stops = [f"{_name(play.move).replace('_', ' ')}: {play.run.stop_reason}" for play in played if play.run.stop_reason]
    whole = [play.run.stop_reason is None and len(play.run.rows) == len(play.table.servos) for play in played]
    return {
        "path_done": sum(whole) / asked,
        "protective_stop": "; ".join(stops) or None,
        "interrupted": any(play.run.interrupted for play in played),
        "faults_missed": [],
        "T_base_work": None,
        "simulated_s": simulated,
        "wall_s": wall,
        "real_time_factor": simulated / wall if wall else 0.0,
        "steps": steps,
        "seed": scenario.seed,
    }
