"""Experiment ``teach``: a hand guides the arm without a force sensor in its loop (paper 3, fig. 6; layer 9)."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell import Observer, Silent
from polish_sim.cell.guiding import run_guided
from polish_sim.config import Scenario
from polish_sim.experiments.guided_arm import HOME, believe, guided_arm, hand_of, home_pose, joints_for, torque_arm
from polish_sim.experiments.part_progress import PartOf
from polish_sim.experiments.result import RunResult
from polish_sim.experiments.teach_log import PlayedMove, figures_of_moves, log_of_moves, trace_of_move
from polish_sim.experiments.teach_moves import move_table, moves_of

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
    figures = figures_of_moves(scenario, played, len(moves), time.perf_counter() - started)
    return RunResult(
        scenario, log_of_moves(played, scenario), trace_of_move(played[-1]), figures,
        figures["protective_stop"], bool(figures["interrupted"]),
    )  # fmt: skip
