"""Teach to polish: a hand drags the tool along a part, its recording becomes a path (layer 9)."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.teaching_figures import measure_taught
from polish_sim.cell import Observer, Silent, tool_on_flange
from polish_sim.cell.guiding import Q, run_guided
from polish_sim.cell.torque_mode import LaidPart
from polish_sim.config import Scenario
from polish_sim.experiments.drag_hand import DragTable, drag_table
from polish_sim.experiments.drag_path import DragTask, prepare_drag
from polish_sim.experiments.guided_arm import believe, guided_arm, hand_of, torque_arm
from polish_sim.experiments.result import RunResult
from polish_sim.experiments.teach_log import PlayedMove, figures_of_moves, log_of_moves, trace_of_move
from polish_sim.experiments.teach_moves import MOVING, Move
from polish_sim.motion import forward_many
from polish_sim.planning.teaching import Recording, Taught, teach_path
from polish_sim.planning.toolpath import ToolPath
from polish_sim.spatial import inverse

Array = NDArray[np.float64]

MODE = "assist"
"""The mode a path is taught in, unless another is asked for."""


def run_drag(scenario: Scenario, observer: Observer | None = None) -> RunResult:
    """Let a hand drag the tool along a part's rim or a path, and make a path of the recording.

    Args:
        scenario: Part, ``drag``, ``guide`` and ``hand``. The part is not touched: contact is not simulated.
        observer: Told of the progress.

    Returns:
        Log, figures and the taught path; without a path if the arm stopped itself or was interrupted.

    Raises:
        PolishSimError: Part or path cannot be used or reached; the mode is unknown.
    """
    observer = observer or Silent()
    observer.stage("prepare the part")
    task, mode = prepare_drag(scenario), scenario.guide.mode or MODE
    grip = replace(
        scenario.hand, turn_stiffness_nm_rad=scenario.drag.turn_stiffness_nm_rad,
        turn_damping_nm_s_rad=scenario.drag.turn_damping_nm_s_rad,
    )  # fmt: skip
    model = torque_arm(scenario, LaidPart(task.mesh, task.reach.T_base_work))
    arm = guided_arm(scenario, mode, model, believe(scenario), hand_of(grip))
    dragged = drag_table(
        task.positions_base, task.rotations, scenario.drag, scenario.hand, scenario.simulation.timestep_s,
        np.random.default_rng(scenario.seed),
    )  # fmt: skip
    observer.stage("drag by hand")
    started = time.perf_counter()
    run = run_guided(arm, task.reach.q_start, dragged.table.motion, dragged.table.servos, observer)
    move = Move(mode, "rim" if scenario.drag.follow == "rim" else "file", math.nan, 0.0)
    play = PlayedMove(move, dragged.table, run)
    figures = figures_of_moves(scenario, [play], 1, time.perf_counter() - started)
    figures["T_base_work"] = task.reach.T_base_work.tolist()
    meant = play._replace(table=dragged.table._replace(motion=dragged.meant))
    path: ToolPath | None = None
    if run.stop_reason is None and not run.interrupted:
        taught, told = _teach(scenario, task, dragged, run.rows[:, Q : Q + 6])
        path, figures = taught.path, figures | told
    return RunResult(
        scenario, log_of_moves([meant], scenario), trace_of_move(meant), figures, run.stop_reason, run.interrupted, path
    )


def _teach(scenario: Scenario, task: DragTask, dragged: DragTable, q: Array) -> tuple[Taught, dict[str, Any]]:
    """The recording at the log's rate as a path, and how near it came."""
    drag, sim = scenario.drag, scenario.simulation
    every = max(1, round(1.0 / (sim.log_rate_hz * sim.timestep_s))) if sim.log_rate_hz else 1
    # What the encoders say is all that is known of the tool.
    step = scenario.guide.encoder_rad
    read = step * np.round(q[::every] / step) if step else q[::every]
    T_work_tool = inverse(task.reach.T_base_work) @ forward_many(np.ascontiguousarray(read)) @ tool_on_flange()
    clock: Array = np.arange(len(read)) * np.float64(every * sim.timestep_s)
    record = Recording(clock, T_work_tool[:, :3, 3], -T_work_tool[:, :3, 2])
    taught = teach_path(record, task.surface, drag.filter_hz, drag.tolerance_m, drag.spacing_m)
    moving = dragged.table.phase[::every] == MOVING
    figures: dict[str, Any] = dict(measure_taught(record.positions[moving], taught.path, task.path))
    counts = {"points_recorded": int(moving.sum()), "knots": taught.knots, "points_taught": len(taught.path.s)}
    return taught, figures | counts | {"off_surface_max_m": taught.off_surface}
