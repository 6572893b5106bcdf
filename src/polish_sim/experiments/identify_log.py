"""A robot identified from its own log instead of the simulated arm (layer 9)."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import IdentificationError
from polish_sim.experiments import first_steps
from polish_sim.experiments.identify import HeldOut, Identification, compare_steps, measure_fit
from polish_sim.experiments.logged_robot import LoggedRobot
from polish_sim.identification.base_parameters import base_of
from polish_sim.identification.coloured_noise import estimate_widened
from polish_sim.identification.estimate import require_rank
from polish_sim.identification.information import sum_samples, told_rows
from polish_sim.identification.physical import Drawing, fit_consistent
from polish_sim.identification.robot_log import RobotLog
from polish_sim.identification.stepwise import carried
from polish_sim.identification.torque_model import States, TorqueModel

Array = NDArray[np.float64]

HELD_OUT = 0.2
"""Share of the motion, its end, that is not fitted."""


def identify_from_log(robot: LoggedRobot, log: RobotLog, states: States, method: str = "joint") -> Identification:
    """Identify a robot from its own log; the last fifth of its motion is held out.

    Args:
        robot: What is known of it.
        log: What it did.
        states: Its states, from the log's positions.
        method: One of `METHODS`.

    Raises:
        IdentificationError: The motion does not tell every base parameter, or there is no first step in the log.
    """
    model, base = robot.model, base_of(robot.model)
    drawing = Drawing(model.truth(), robot.carried)
    started = time.process_time()
    first, rows = None, np.arange(len(log.time))
    if method in first_steps.IN_LOG:
        split = first_steps.IN_LOG[method](model, base, log, states, drawing.parameters)
        first, rows = split.first, np.flatnonzero(split.motion)
    cut = round(len(rows) * (1.0 - HELD_OUT))
    fitted, kept = rows[:cut], rows[cut:]
    sums = sum_samples(model, base, states.rows(fitted), log.torque[fitted])
    require_rank(sums if first is None else sums.plus(first.sums), base, model)
    held_out = _hold_out(model, log, states, kept)
    earlier = None if first is None else carried(first.step, base)
    found = estimate_widened(model, base, sums, states.rows(fitted), log.torque[fitted], earlier)
    step_figures = {} if first is None else compare_steps(model, base, sums, first, held_out)
    fit_s = time.process_time() - started
    full = fit_consistent(model, base, found, drawing)
    figures: dict[str, Any] = measure_fit(model, base, found, full, drawing, held_out) | step_figures
    figures |= {"error_over_crb": None, "interval_coverage": None, "design_s": None, "fit_s": fit_s}
    figures |= {"samples": len(log.time), "method": method}
    return Identification(model, base, found, full, drawing, held_out, figures)


def _hold_out(model: TorqueModel, log: RobotLog, states: States, rows: NDArray[np.int64]) -> HeldOut:
    told = told_rows(states.rows(rows))
    silent = [joint for j, joint in enumerate(model.chain.joints) if not told[:, j].any()]
    if silent:
        raise IdentificationError(
            f"the last fifth of the log, which is held out, tells nothing of {', '.join(silent)}: there it "
            "stands or turns round. Let every joint move until the end of the log."
        )
    some = told.any(axis=1)
    measured = np.where(told, log.torque[rows], np.nan)[some]
    return HeldOut(log.time[rows][some], states.rows(rows[some]), measured, measured)
