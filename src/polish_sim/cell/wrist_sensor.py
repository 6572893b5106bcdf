"""The six-axis wrist sensor: from the exact wrench at its plane to what the host computer reads.

Everything mounted on the sensor is felt: weight, inertia, contact. Bias, drift and noise are added, the reading
saturates, is quantised and low-passed at the sensor's own rate, and arrives late. The host subtracts the payload it
believes in and what it tared.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.config import SensorConfig
from polish_sim.kernel_cache import njit

Array = NDArray[np.float64]

GRAVITY = 9.81  # [m/s^2], MuJoCo's default and the model's

SAMPLES, NEXT, CHANGED = 0, 1, 2  # of the clock


class SensorModel(NamedTuple):
    """Parameters of the sensor, per axis (force; torque), shape (6,) each."""

    bias: Array
    noise: Array
    drift: Array
    """Standard deviation of the drift's step per sample."""
    quantum: Array
    range: Array
    blend: float
    """Weight of a new sample in the low-pass [-]; 1 = no filter."""
    period: float
    """Time between samples [s]."""
    delay: int
    """Samples from measuring to reading; one more step passes in the engine."""
    creep: Array
    """Steady drift per sample (force; torque), shape (6,): of a faulty sensor."""
    reach: float = 1.0
    """1 if the reading reaches the host; of a faulty sensor 0 (zeros arrive) or not a number."""


class SensorState(NamedTuple):
    """Memory of the sensor."""

    drift: Array
    """Present drift, shape (6,)."""
    filtered: Array
    """Low-passed sample, shape (6,)."""
    line: Array
    """Samples under way, shape (delay + 1, 6)."""
    reading: Array
    """What the host reads, before compensation, shape (6,)."""
    tare: Array
    """Subtracted by the host, tool axes at the tool point, shape (6,)."""
    clock: Array
    """Samples taken, time of the next one [s], time of the last change [s], shape (3,)."""


class Payload(NamedTuple):
    """What the host believes is mounted on the sensor."""

    mass: float
    """[kg]"""
    center: Array
    """Centre of mass in the sensor frame [m], shape (3,)."""
    lever: Array
    """From the sensor's origin to the tool point, sensor frame [m], shape (3,)."""


def build_sensor(config: SensorConfig, rng: np.random.Generator) -> tuple[SensorModel, SensorState]:
    """Make a sensor with a seeded bias.

    Args:
        config: The sensor's figures.
        rng: Draws the bias, uniform within its size on each axis.

    Returns:
        Parameters and fresh memory.
    """
    period = 1.0 / config.rate_hz
    blend = 1.0 - math.exp(-2.0 * math.pi * config.bandwidth_hz * period) if config.bandwidth_hz else 1.0
    delay = max(0, round(config.latency_s / period) - 1)
    model = SensorModel(
        _per_axis(config.force_bias_n, config.torque_bias_nm) * rng.uniform(-1.0, 1.0, 6),
        _per_axis(config.force_noise_n, config.torque_noise_nm),
        _per_axis(config.force_drift_n_s, config.torque_drift_nm_s) * math.sqrt(period),
        _per_axis(config.force_quantum_n, config.torque_quantum_nm),
        _per_axis(config.force_range_n, config.torque_range_nm),
        blend,
        period,
        delay,
        np.zeros(6),
    )
    state = SensorState(
        np.zeros(6), np.zeros(6), np.zeros((delay + 1, 6)), np.zeros(6), np.zeros(6), np.array([0.0, 0.0, 0.0])
    )
    return model, state


def _per_axis(force: float, torque: float) -> Array:
    return np.repeat([force, torque], 3)


@njit(cache=True, error_model="numpy", forceinline=True)
def sample_sensor(model: SensorModel, state: SensorState, t: float, exact: Array, draws: Array) -> None:
    """Take a sample if one is due and pass on the one that arrives.

    Args:
        model: The sensor.
        state: Its memory; ``reading`` is written.
        t: Time [s].
        exact: Exact wrench at the sensor plane (force [N]; torque [N m]), shape (6,).
        draws: Standard normal numbers for noise and drift, shape (12,).
    """
    if t < state.clock[NEXT] - 1e-9:
        return
    first = state.clock[SAMPLES] == 0.0
    state.clock[SAMPLES] += 1.0
    state.clock[NEXT] += model.period
    slot = int(state.clock[SAMPLES]) % (model.delay + 1)
    changed = False
    for i in range(6):
        state.drift[i] += model.drift[i] * draws[6 + i] + model.creep[i]
        value = exact[i] + model.bias[i] + state.drift[i] + model.noise[i] * draws[i]
        value = min(max(value, -model.range[i]), model.range[i])
        if model.quantum[i] > 0.0:
            value = model.quantum[i] * math.floor(value / model.quantum[i] + 0.5)
        state.filtered[i] += (1.0 if first else model.blend) * (value - state.filtered[i])
        if first:
            for k in range(model.delay + 1):
                state.line[k, i] = state.filtered[i]
        state.line[slot, i] = state.filtered[i]
        arriving = model.reach * state.line[(slot + 1) % (model.delay + 1), i]
        changed = changed or arriving != state.reading[i]
        state.reading[i] = arriving
    if changed:
        state.clock[CHANGED] = t


@njit(cache=True, error_model="numpy", forceinline=True)
def tool_wrench(payload: Payload, state: SensorState, R_base_tool: Array, out: Array) -> None:
    """Wrench the tool exerts on the part as the host computes it, tool axes, about the tool point.

    The sensor reads sum m (a - g) - contact; the believed weight is subtracted (accelerations are not), the moment is
    moved to the tool point and the tare is taken off.
    """
    c, lever = payload.center, payload.lever
    fx = state.reading[0] - payload.mass * GRAVITY * R_base_tool[2, 0]
    fy = state.reading[1] - payload.mass * GRAVITY * R_base_tool[2, 1]
    fz = state.reading[2] - payload.mass * GRAVITY * R_base_tool[2, 2]
    wx, wy, wz = (
        payload.mass * GRAVITY * R_base_tool[2, 0],
        payload.mass * GRAVITY * R_base_tool[2, 1],
        payload.mass * GRAVITY * R_base_tool[2, 2],
    )
    mx = state.reading[3] - (c[1] * wz - c[2] * wy)
    my = state.reading[4] - (c[2] * wx - c[0] * wz)
    mz = state.reading[5] - (c[0] * wy - c[1] * wx)
    out[0], out[1], out[2] = fx - state.tare[0], fy - state.tare[1], fz - state.tare[2]
    out[3] = mx - (lever[1] * fz - lever[2] * fy) - state.tare[3]
    out[4] = my - (lever[2] * fx - lever[0] * fz) - state.tare[4]
    out[5] = mz - (lever[0] * fy - lever[1] * fx) - state.tare[5]


# The tool as it really is, and what its weight does to the wrist sensor.


def carried_payload(model: mujoco.MjModel, data: mujoco.MjData, arm: str = "") -> Payload:
    """The tool as it is: everything mounted on the sensor of the ``arm``; ``data`` at rest."""
    bodies = [model.body(f"{arm}tool_mount").id, model.body(f"{arm}head").id]
    mass = model.body_mass[bodies]
    center = (mass @ data.xipos[bodies]) / mass.sum()
    sensor, tool = data.site(f"{arm}sensor"), data.site(f"{arm}tool")
    R_sensor_base = sensor.xmat.reshape(3, 3).T
    return Payload(float(mass.sum()), R_sensor_base @ (center - sensor.xpos), R_sensor_base @ (tool.xpos - sensor.xpos))


def weight_of(payload: Payload, R_base_sensor: Array) -> Array:
    """What a tool at rest loads the sensor with.

    Args:
        payload: The tool.
        R_base_sensor: How the sensor stands, shape (n, 3, 3).

    Returns:
        Wrench in sensor axes about the sensor's origin [N, N m], shape (n, 6).
    """
    force = payload.mass * GRAVITY * R_base_sensor[:, 2, :]
    return np.concatenate([force, np.cross(payload.center, force)], axis=1)


# What the wrist sensor reads while the robot stands still in given poses, the arm's way between them left out.

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
