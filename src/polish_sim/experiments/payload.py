"""Experiment ``calibrate payload``: which tool the robot carries and what its sensor's bias is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array, Figures, norms, rms_length
from polish_sim.calibration.payload import (
    PayloadEstimate,
    PayloadReadings,
    fit_without_outliers,
    payload_regressor,
    plan_payload_poses,
    refuse_doubtful,
)
from polish_sim.calibration.tables import estimate_figures, read_readings
from polish_sim.cell import SILENT, Cell, Observer, weight_of
from polish_sim.cell.limits import check_rates
from polish_sim.cell.real_arm import take_arm
from polish_sim.cell.stroke import TARE_TIME
from polish_sim.cell.wrist_sensor import fresh_sensor, read_at_rest
from polish_sim.config import Scenario
from polish_sim.errors import CalibrationError
from polish_sim.experiments.free_space import plan_visit, run_visit, visiting_cell
from polish_sim.experiments.part_setup import random_streams
from polish_sim.spatial import GRAVITY

CHECK_POSES = 200
CHECK_SETTLE_S, CHECK_AVERAGE_S = 0.1, 0.25
LONG_RUN_S, RETARE_S, VALUE_S = 600.0, 60.0, 5.0


@dataclass(frozen=True)
class PayloadCalibration:
    """What a calibration leaves behind."""

    scenario: Scenario | None  #: None for readings of a real robot
    readings: PayloadReadings
    estimate: PayloadEstimate
    figures: Figures  #: The keys of metrics.json
    q: Array | None = None  #: Joint angles of the poses [rad], shape (n, 6)


def calibrate_from(file: Path, drift: bool) -> PayloadCalibration:
    """Calibrate from readings of a real robot; there is no truth to compare with.

    Raises:
        CalibrationError: If they do not determine the tool.
    """
    readings = read_readings(file)
    estimate = fit_without_outliers(readings, drift)
    refuse_doubtful(readings, estimate)
    return PayloadCalibration(None, readings, estimate, estimate_figures(estimate))


def run_payload_calibration(
    scenario: Scenario, drift: bool = False, observer: Observer = SILENT
) -> PayloadCalibration:
    """Visit poses in free space, return to the first, and estimate tool and bias from readings at rest.

    Part, plan, process and spindle play no role; with ``drift`` a linear drift of the bias is fitted too. The
    figures are against the truth.

    Raises:
        CalibrationError: If the readings do not determine the tool.
        ProtectiveStop: If the robot stopped itself on the way.
    """
    take_arm(scenario.robot)
    check_rates(scenario)
    observer.stage("plan the poses")
    streams = random_streams(scenario.seed)
    payload = scenario.payload
    poses = plan_payload_poses(payload.poses)
    q = np.concatenate([poses.q, poses.q[:1]])
    visit = plan_visit(q, payload, scenario.robot)
    cell = visiting_cell(scenario, visit, q[0], streams.sensor)
    observer.stage(f"visit {payload.poses} poses and the first again")
    run, readings = run_visit(cell, visit, observer)
    _check_range(cell, readings)
    observer.stage("estimate")
    estimate = fit_without_outliers(readings, drift)
    figures = estimate_figures(estimate) | _errors(cell, estimate)
    figures |= _return_figures(readings, estimate) | _residual_figures(cell, estimate, streams.payload)
    once, again = idle_force(cell, streams.payload)
    figures |= {
        "drift_600s_rms_n": rms_length(once),
        "drift_600s_retared_rms_n": rms_length(again),
        "simulated_s": run.steps * run.dt,
        "wall_s": run.wall_s,
        "steps": run.steps,
        "seed": scenario.seed,
    }
    return PayloadCalibration(scenario, readings, estimate, figures, q)


def _check_range(cell: Cell, readings: PayloadReadings) -> None:
    """Refuse readings at the end of the sensor's range: a saturated axis hides part of the weight."""
    full = np.abs(readings.wrenches) > 0.98 * cell.sensor.range
    if full.any():
        reading, axis = np.argwhere(full)[0]
        name = ("force x", "force y", "force z", "torque x", "torque y", "torque z")[axis]
        raise CalibrationError(
            f"the sensor's {name} is at the end of its range in pose {reading + 1}: tool and bias are too "
            "much for it. Take a sensor with a larger range (sensor.force_range_n, sensor.torque_range_nm)."
        )


def _errors(cell: Cell, estimate: PayloadEstimate) -> Figures:
    """Estimate minus truth."""
    carried = cell.carried
    worst = abs(estimate.mass - carried.mass) * GRAVITY
    worst += float(np.linalg.norm(_bias_error(cell, estimate)))
    return {
        "mass_error_kg": estimate.mass - carried.mass,
        "mass_error_relative": abs(estimate.mass / carried.mass - 1.0),
        "center_error_m": np.linalg.norm(estimate.center - carried.center),
        "compensation_error_max_n": worst,
    }


def _bias_error(cell: Cell, estimate: PayloadEstimate) -> Array:
    """Estimated force bias minus what bias, drift and warm-up have become [N], shape (3,)."""
    now = cell.sensor.bias + cell.state.sensor.drift + cell.sensor.warm_up * cell.state.sensor.warmth
    return (estimate.bias_at(cell.data.time) - now)[:3]


def _return_figures(readings: PayloadReadings, estimate: PayloadEstimate) -> Figures:
    """What the first pose reads at the end against what it read at the beginning: drift, and noise twice."""
    drift = (readings.wrenches[-1] - readings.wrenches[0])[:3]
    return {
        "drift_return_n": drift.tolist(),
        "drift_return_n_std": np.sqrt(2.0) * estimate.noise[0],
        "drift_return_s": readings.time[-1] - readings.time[0],
    }


def _residual_figures(cell: Cell, estimate: PayloadEstimate, rng: np.random.Generator) -> Figures:
    """The force left after compensation in random poses right after the calibration, with and without a
    tare."""
    R = Rotation.random(CHECK_POSES, random_state=rng).as_matrix()
    load = weight_of(cell.carried, R)
    read = read_at_rest(cell.state.sensor, load, np.zeros(len(R)), CHECK_SETTLE_S, CHECK_AVERAGE_S, rng)
    theta = np.concatenate([estimate.theta[:4], estimate.bias_at(float(cell.data.time))])
    left = (read - payload_regressor(R[:, 2, :]) @ theta)[:, :3]
    # The tare is taken in the first pose; tool axes turn with the sensor's.
    return {
        "residual_force_max_n": norms(left).max(),
        "residual_force_rms_n": rms_length(left),
        "residual_force_tared_max_n": norms(left - left[0])[1:].max(),
    }


def idle_force(cell: Cell, rng: np.random.Generator) -> tuple[Array, Array]:
    """The force an idle host reads in one pose in ten minutes, tared once and tared anew every minute, sensor
    axes, one value every five seconds [N], (n, 3) each.

    A tare averages as long as that of a run: its own noise stays in every force until the next one.
    """
    count, a_value, a_tare = (round(span / TARE_TIME) for span in (LONG_RUN_S, VALUE_S, RETARE_S))
    load = np.tile(weight_of(cell.carried, np.diag([1.0, -1.0, -1.0])[None]), (count, 1))
    read = read_at_rest(fresh_sensor(cell.state.sensor), load, np.zeros(count), 0.0, TARE_TIME, rng)[:, :3]
    latest = np.arange(count) // a_tare * a_tare
    once, again = ((read - tare).reshape(-1, a_value, 3).mean(axis=1) for tare in (read[0], read[latest]))
    return once, again
