"""What the host believes to carry: from a calibration before every run, or from a file (layer 9)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration import PayloadReadings, fit_payload, plan_payload_poses, read_calibrated_tool
from polish_sim.cell import Cell, read_at_rest, weight_of

Array = NDArray[np.float64]


def believe_tool(cell: Cell, rng: np.random.Generator) -> None:
    """Let a cell's host learn its tool as the scenario's ``payload`` section says.

    Without a file the tool is calibrated: this run's sensor, with its bias, noise, drift, filter and quantisation,
    is read at rest in the poses of ``calibrate payload`` and the same estimator fits the readings. The arm's way
    between the poses is not simulated; the drift of that time is.

    Args:
        cell: The cell, not yet run.
        rng: Draws the noise of the calibration.

    Raises:
        InputError: If the file cannot be used.
        CalibrationError: If the readings do not tell the tool.
    """
    config = cell.scenario.payload
    if config.file:
        mass, center = read_calibrated_tool(Path(config.file))
    else:
        estimate = fit_payload(readings_at_rest(cell, rng))
        mass, center = estimate.mass, estimate.center
    cell.compensate(mass, center)


def readings_at_rest(cell: Cell, rng: np.random.Generator) -> PayloadReadings:
    """Readings of a cell's sensor in the calibration's poses, the robot not simulated."""
    config = cell.scenario.payload
    poses = plan_payload_poses(config.poses)
    loads = weight_of(cell.carried, poses.R_base_sensor)
    wrenches = read_at_rest(
        cell.sensor, cell.idle_sensor(), loads, poses.move_times, config.settle_s, config.average_s, rng
    )
    time = np.cumsum(poses.move_times + config.settle_s + config.average_s) - 0.5 * config.average_s
    return PayloadReadings(time, poses.R_base_sensor.copy(), wrenches)
