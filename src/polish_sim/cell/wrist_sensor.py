"""The six-axis wrist sensor: from the exact wrench at its plane to what the host computer reads.

Everything mounted on the sensor is felt: weight, inertia, contact. Bias, drift, cross-talk and noise are
added, the reading saturates, is quantised and low-passed at the sensor's own rate, and arrives late. The host
subtracts the payload it believes in and what it tared.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.config import SensorConfig
from polish_sim.control.loops import low_pass_share
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Matrix6, Record, Vector3, Vector6, cross, kernel, minus, scaled, set_to
from polish_sim.spatial import GRAVITY

DRAWS = 12  # standard normal numbers a sample takes: noise and drift of six axes


class SensorErrors(Record):
    """What the sensor does wrong; arrays per axis (force [N]; torque [N m])."""

    bias: Vector6
    noise: Vector6
    drift_step: Vector6  #: Standard deviation of the drift's step per sample
    creep: Vector6  #: Steady drift per sample, of a faulty sensor
    warm_up: Vector6  #: Drift from cold to warm
    warming: float  #: Share of the rest of it that comes in a sample [-]
    talk: Matrix6  #: What a load on the axis of a column adds to the reading of a row's
    talks: bool
    quantum: Vector6
    range: Vector6
    overload: float  #: Share of the range from which the sensor is overloaded, 0 for none [-]
    reach: float  #: 1 if the reading reaches the host; of a faulty sensor 0 (zeros arrive) or not a number


class WristSensor(Record):
    """The sensor and its memory."""

    errors: SensorErrors
    blend: float  #: Weight of a new sample in the low-pass [-]; 1 = no filter
    period: float  #: Time between samples [s]
    delay: int  #: Samples from measuring to reading; one more step passes in the engine
    drift: Vector6  #: Present drift (force; torque)
    warmth: float  #: 0 cold, 1 warm
    load: float  #: Share of its range the present load takes [-]
    filtered: Vector6  #: Low-passed sample
    reading: Vector6  #: What the host reads, before compensation
    tare: Vector6  #: Subtracted by the host, tool axes at the tool point
    samples: int  #: Taken so far
    next: float  #: Time of the next sample [s]
    changed: float  #: Time of the reading's last change [s]


class Payload(Record):
    """What the host believes is mounted on the sensor."""

    mass: float  #: [kg]
    center: Vector3  #: Centre of mass in the sensor frame [m]
    lever: Vector3  #: From the sensor's origin to the tool point, sensor frame [m]


def build_sensor(config: SensorConfig, rng: np.random.Generator) -> WristSensor:
    """Make a sensor, its memory fresh; ``rng`` draws bias and warm-up, uniform within their size on
    each axis, and cross-talk."""
    period = 1.0 / config.rate_hz
    own = rng.spawn(1)[0]
    full = _per_axis(config.force_range_n, config.torque_range_nm)
    talk = config.cross_talk * own.standard_normal((6, 6)) * np.outer(full, 1.0 / full)
    np.fill_diagonal(talk, 0.0)
    errors = SensorErrors(
        bias=_per_axis(config.force_bias_n, config.torque_bias_nm) * rng.uniform(-1.0, 1.0, 6),
        warm_up=_per_axis(config.warm_up_force_n, config.warm_up_torque_nm) * own.uniform(-1.0, 1.0, 6),
        warming=1.0 - math.exp(-period / config.warm_up_s), talk=talk, talks=config.cross_talk > 0.0,
        noise=_per_axis(config.force_noise_n, config.torque_noise_nm),
        drift_step=_per_axis(config.force_drift_n_s, config.torque_drift_nm_s) * math.sqrt(period),
        quantum=_per_axis(config.force_quantum_n, config.torque_quantum_nm),
        range=full, overload=config.overload, reach=1.0,
    )  # fmt: skip
    blend = low_pass_share(config.bandwidth_hz, period) or 1.0
    delay = max(0, round(config.latency_s / period) - 1)
    return WristSensor(errors=errors, blend=blend, period=period, delay=delay)


def build_sample_line(sensor: WristSensor) -> Array:
    """Samples on their way to the host, shape (delay + 1, 6)."""
    return np.zeros((int(sensor.delay) + 1, 6))


def _per_axis(force: float, torque: float) -> Array:
    return np.repeat([force, torque], 3)


@kernel
def share_of_range(full: Array, load: Array) -> float:
    """Share of the range ``full`` (6,) that a load (6,) takes, forces and torques that strain the same beams
    together.

    ATI, Ethernet Axia manual, 5.5.1: forces across and torque along the axis; force along and torques across.
    """
    across = math.hypot(load[0], load[1]) / full[0] + abs(load[5]) / full[5]
    return max(across, abs(load[2]) / full[2] + math.hypot(load[3], load[4]) / full[3])


@kernel
def sample_sensor(sensor: WristSensor, line: Array, t: float, exact: Array, draws: Array) -> None:
    """Take a sample if one is due at ``t`` [s] and pass on the one that arrives: ``sensor.reading`` is
    written.

    ``line`` (delay + 1, 6) holds samples under way, ``exact`` (6,) is the exact wrench at the sensor plane
    (force [N]; torque [N m]), ``draws`` (12,) are standard normal numbers for noise and drift.
    """
    if t < sensor.next - 1e-9:
        return
    errors, first, length = sensor.errors, sensor.samples == 0, line.shape[0]
    sensor.samples += 1
    sensor.next += sensor.period
    slot = sensor.samples % length
    changed = False
    sensor.warmth += errors.warming * (1.0 - sensor.warmth)
    if errors.overload > 0.0:
        sensor.load = share_of_range(errors.range, exact)
    for i in range(6):
        sensor.drift[i] += errors.drift_step[i] * draws[6 + i] + errors.creep[i]
        value = exact[i] + errors.bias[i] + sensor.drift[i] + errors.noise[i] * draws[i]
        value += errors.warm_up[i] * sensor.warmth
        if errors.talks:
            for j in range(6):
                value += errors.talk[i, j] * exact[j]
        value = min(max(value, -errors.range[i]), errors.range[i])
        if errors.quantum[i] > 0.0:
            value = errors.quantum[i] * math.floor(value / errors.quantum[i] + 0.5)
        sensor.filtered[i] += (1.0 if first else sensor.blend) * (value - sensor.filtered[i])
        if first:
            for k in range(length):
                line[k, i] = sensor.filtered[i]
        line[slot, i] = sensor.filtered[i]
        arriving = errors.reach * line[(slot + 1) % length, i]
        changed = changed or arriving != sensor.reading[i]
        sensor.reading[i] = arriving
    if changed:
        sensor.changed = t


@kernel
def tool_wrench(payload: Payload, sensor: WristSensor, R_base_tool: Array, out: Array) -> None:
    """Wrench the tool exerts on the part as the host computes it, tool axes, about the tool point.

    The sensor reads sum m (a - g) - contact; the believed weight is subtracted (accelerations are not), the
    moment is moved to the tool point and the tare is taken off.
    """
    reading, tare = sensor.reading, sensor.tare
    weight = scaled(payload.mass * GRAVITY, R_base_tool[2])
    force = minus(reading[0:3], weight)
    moment = minus(reading[3:6], cross(payload.center, weight))
    set_to(out[0:3], minus(force, tare[0:3]))
    set_to(out[3:6], minus(minus(moment, cross(payload.lever, force)), tare[3:6]))


# The tool as it really is, and what its weight does to the wrist sensor.


def carried_payload(model: mujoco.MjModel, data: mujoco.MjData, arm: str) -> Payload:
    """The tool as it is: everything mounted on the sensor of the ``arm``; ``data`` at rest."""
    mount, sensor, tool = f"{arm}tool_mount", data.site(f"{arm}sensor"), data.site(f"{arm}tool")
    R_sensor_base = sensor.xmat.reshape(3, 3).T
    return Payload(
        mass=model.body(mount).subtreemass[0],
        center=R_sensor_base @ (data.body(mount).subtree_com - sensor.xpos),
        lever=R_sensor_base @ (tool.xpos - sensor.xpos),
    )


def weight_of(payload: Payload, R_base_sensor: Array) -> Array:
    """What a tool at rest loads a sensor that stands at ``R_base_sensor`` (n, 3, 3) with.

    Wrench in sensor axes about the sensor's origin [N, N m], shape (n, 6).
    """
    force = payload.mass * GRAVITY * R_base_sensor[:, 2, :]
    return np.concatenate([force, np.cross(payload.center, force)], axis=1)


# What the wrist sensor reads while the robot stands still in given poses, the arm's way between them left
# out.


def fresh_sensor(sensor: WristSensor) -> WristSensor:
    """A sensor with the same errors before its first sample, without drift."""
    return WristSensor(sensor.errors, sensor.blend, sensor.period, sensor.delay)


def read_at_rest(
    sensor: WristSensor, loads: Array, travel: Array, settle: float, average: float, rng: np.random.Generator
) -> Array:
    """Mean readings in pose after pose: bias, drift, noise, filter, quantisation and saturation as in a run.

    Args:
        sensor: The sensor, `fresh_sensor` or as a run has left it; only its drift changes
            while the arm travels.
        loads: Exact wrench at the sensor in each pose [N, N m], shape (n, 6).
        travel: Time before each pose in which the arm moves there [s], shape (n,).
        settle: Time it then stands still before readings are taken, no shorter than the delay of a sensor
            a run has left [s].
        average: Time over which readings are averaged [s].
        rng: Draws noise and drift.

    Returns:
        Mean reading in each pose, shape (n, 6).
    """
    wait, count = round(settle / sensor.period), max(1, round(average / sensor.period))
    line, means = build_sample_line(sensor), np.zeros((len(loads), 6))
    for load, pause, mean in zip(loads, travel, means, strict=True):
        sensor.drift += sensor.errors.drift_step * math.sqrt(pause / sensor.period) * rng.standard_normal(6)
        sensor.warmth = 1.0 - (1.0 - sensor.warmth) * (1.0 - sensor.errors.warming) ** (pause / sensor.period)
        _average(sensor, line, load, rng.standard_normal((wait + count, DRAWS)), wait, mean)
    return means


@njit
def _average(sensor: WristSensor, line: Array, load: Array, draws: Array, wait: int, mean: Array) -> None:
    """Mean over the samples after the first ``wait`` ones."""
    count = draws.shape[0] - wait
    for k in range(draws.shape[0]):
        sample_sensor(sensor, line, sensor.next, load, draws[k])
        if k >= wait:
            for i in range(6):
                mean[i] += sensor.reading[i] / count
