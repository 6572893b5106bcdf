"""Experiment ``teach``: a hand guides the arm without a force sensor in its loop (paper 3, fig. 6; layer 9)."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.guiding_figures import GuidedMove, compare_modes, measure_drift, measure_move
from polish_sim.cell import Observer, Silent
from polish_sim.cell.guiding import FORCE, TIME, GuidingRun, Q, run_guided
from polish_sim.config import Scenario
from polish_sim.control.hand_guiding import MODES
from polish_sim.experiments.guided_arm import HOME, believe, guided_arm, hand_of, home_pose, joints_for, torque_arm
from polish_sim.experiments.part_progress import PartOf
from polish_sim.experiments.result import RunResult
from polish_sim.experiments.teach_log import PlayedMove, log_of_moves, trace_of_move
from polish_sim.experiments.teach_moves import MOVING, OFF, Move, move_table, moves_of

Array = NDArray[np.float64]


def run_teach(scenario: Scenario, observer: Observer | None = None) -> RunResult:
    """Let a hand move the arm in every mode, direction and pace asked for, and measure its force.

    Args:
        scenario: ``guide`` and ``hand``; part, plan and controller play no role.
        observer: Told of the progress.

    Returns:
        One log of all moves, their figures, and the modes beside each other.

    Raises:
        PolishSimError: A mode or direction is unknown, the model cannot be read, a move cannot be reached.
    """
    observer = observer or Silent()
    moves, hand = moves_of(scenario.guide, scenario.hand), hand_of(scenario.hand)
    observer.stage("guide by hand")
    started = time.perf_counter()
    model, belief, T_base_home = torque_arm(scenario), believe(scenario), home_pose()
    played: list[PlayedMove] = []
    for count, move in enumerate(moves):
        table = move_table(move, scenario.hand, T_base_home, scenario.simulation.timestep_s)
        T_base_tool = T_base_home.copy()
        T_base_tool[:3, 3] = table.motion.positions[0]
        arm = guided_arm(scenario, move.mode, model, belief, hand)
        run = run_guided(
            arm, joints_for(T_base_tool, np.array(HOME)), table.motion, table.servos,
            PartOf(observer, count, len(moves)),
        )  # fmt: skip
        played.append(PlayedMove(move, table, run))
        if run.interrupted:
            break
    figures = _figures(scenario, played) | _of_run(scenario, played, len(moves), time.perf_counter() - started)
    return RunResult(
        scenario, log_of_moves(played, scenario), trace_of_move(played[-1]), figures,
        figures["protective_stop"], bool(figures["interrupted"]),
    )  # fmt: skip


def _figures(scenario: Scenario, played: list[PlayedMove]) -> dict[str, Any]:
    """Figures of every move under its name, of the last mode as a whole, and of the modes beside each other."""
    figures: dict[str, Any] = {}
    measured = [measure_move(_seen(play)) for play in played]
    for play, values in zip(played, measured, strict=True):
        figures |= {f"{_name(play.move)}_{name}": value for name, value in values.items()}
    last = played[-1].move.mode
    of_last = [values for play, values in zip(played, measured, strict=True) if play.move.mode == last]
    figures |= {name: max(values[name] for values in of_last) for name in of_last[0]}
    figures |= measure_drift(_seen(played[-1]))
    forces = {_name(play.move): values for play, values in zip(played, measured, strict=True)}
    return figures | compare_modes(forces) | {"moves": list(forces), "model": scenario.guide.model_file or "exact"}


def _seen(play: PlayedMove) -> GuidedMove:
    rows, phase = play.run.rows, play.table.phase[: len(play.run.rows)]
    moved = bool((phase == MOVING).any()) and _stop_phase(play) != MOVING
    return GuidedMove(
        rows[:, TIME], rows[:, FORCE : FORCE + 3], rows[:, Q : Q + 6], phase == MOVING, phase == OFF, moved,
        play.run.lent_j,
    )  # fmt: skip


def _stop_phase(play: PlayedMove) -> int:
    """Phase in which the arm stopped itself, or -1."""
    run: GuidingRun = play.run
    return int(play.table.phase[min(run.stop_step, len(play.table.phase) - 1)]) if run.stop_reason else -1


def _name(move: Move) -> str:
    return f"{move.mode}_{move.direction}_{move.pace}"


def _of_run(scenario: Scenario, played: list[PlayedMove], asked: int, wall: float) -> dict[str, Any]:
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


__all__ = ["MODES", "run_teach"]
