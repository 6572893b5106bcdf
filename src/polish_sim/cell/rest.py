"""What the wrist sensor reads while the robot stands still in given poses, the arm's way between them left out (8a)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.wrist_sensor import NEXT, SensorModel, SensorState, sample_sensor

Array = NDArray[np.float64]

_DRAWS = 12  # standard normal numbers a sample takes


def read_at_rest(
    sensor: SensorModel, state: SensorState, loads: Array, travel: Array, settle: float, average: float,
    rng: np.random.Generator,
) -> Array:  # fmt: skip
    """Mean readings in pose after pose: bias, drift, noise, filter, quantisation and saturation as in a run.

    Args:
        sensor: The sensor.
        state: Its memory; it goes on from there. While the arm would travel only the drift does.
        loads: Exact wrench at the sensor in each pose [N, N m], shape (n, 6).
        travel: Time before each pose in which the arm would move there [s], shape (n,).
        settle: Time it then stands still before readings are taken [s].
        average: Time over which readings are averaged [s].
        rng: Draws noise and drift.

    Returns:
        Mean reading in each pose, shape (n, 6).
    """
    wait, count = round(settle / sensor.period), max(1, round(average / sensor.period))
    means = np.zeros((len(loads), 6))
    for load, pause, mean in zip(loads, travel, means, strict=True):
        state.drift[:] += sensor.drift * math.sqrt(pause / sensor.period) * rng.standard_normal(6)
        _average(sensor, state, load, rng.standard_normal((wait + count, _DRAWS)), wait, mean)
    return means


@njit(cache=True, error_model="numpy")
def _average(sensor: SensorModel, state: SensorState, load: Array, draws: Array, wait: int, mean: Array) -> None:
    """Mean over the samples after the first ``wait`` ones."""
    count = draws.shape[0] - wait
    for k in range(draws.shape[0]):
        sample_sensor(sensor, state, state.clock[NEXT], load, draws[k])
        if k >= wait:
            for i in range(6):
                mean[i] += state.reading[i] / count
