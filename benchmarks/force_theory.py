"""Bounds of any controller's force error under the cell's noise, latency and acceleration limit, and modelled
errors.

The bounds assume an arm that is perfect but for latency and acceleration, and known springs and statistics,
which a real law has to estimate.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.loop_margins import force_loop
from polish_sim.arrays import Array
from polish_sim.config import Scenario
from polish_sim.scoring.loop_model import (
    Complex,
    LinearLaw,
    LoopSetup,
    build_plant,
    plant_response,
)

SAMPLE_S = 0.02  # past readings are averaged over this long for the regression
LEAST_SAMPLES = 25  # but at least this many lie within the shortest wave
PAST_M = 0.3  # of path that is remembered
SPAN_BY_SIGMA = 4.5  # peak to peak by rms of eight random waves on a region of 150 mm
DETECTION = 4.5  # separation of touching from not touching, in standard deviations of the best test


class StepBound(NamedTuple):
    """The quickest force step there is."""

    detection: float
    """From contact until the ramp of the force stands out of the noise [s]."""
    reaction: float
    """Detection and both latencies: until then the approach continues [s]."""
    settling: float
    """From contact until the force is in its band for good [s]."""
    peak: float
    """Force at which the approach could be stopped [N], if nothing were to be pressed."""


def step_bound(scenario: Scenario, approach_speed: float, band: float = 1.0) -> StepBound:
    """Least time from first contact to a settled force, and least force of a touch.

    The ramp k v t in white noise sigma per sample h is detected after n samples with
    (k v h)^2 n^3 / 3 = (d sigma)^2 (matched filter). From then on, and both latencies later, the tool runs
    what is left of D = F / k in the least time within the acceleration limit a, into the band and to a stop
    at its far side.

    Args:
        scenario: Noise, latencies, springs, force, acceleration limit.
        approach_speed: [m/s].
        band: Half-width of the band [N].

    Returns:
        The bound.
    """
    k, a, v = spring_of(scenario), scenario.robot.linear_acceleration_m_s2, approach_speed
    h, sigma = 1.0 / scenario.sensor.rate_hz, scenario.sensor.force_noise_n
    samples = (3.0 * (DETECTION * sigma / (k * v * h)) ** 2) ** (1.0 / 3.0)
    detection = max(samples, 1.0) * h
    reaction = detection + scenario.sensor.latency_s + scenario.robot.command_latency_s
    peak = k * (v * reaction + 0.5 * v**2 / a)
    way = (scenario.process.contact_force_n - band) / k - v * reaction
    speed = math.sqrt(2.0 * a * 2.0 * band / k)  # with which the band is entered and just not left again
    settling = reaction + _least_time(max(way, 0.0), v, speed, a)
    return StepBound(detection, reaction, settling, peak)


def _least_time(way: float, first: float, last: float, a: float) -> float:
    """Least time for a way [m] that begins at one speed and ends at most at another [m/s], within a
    [m/s^2]."""
    highest = math.sqrt(a * way + 0.5 * (first**2 + last**2))
    if highest < last:
        highest = last = math.sqrt(first**2 + 2.0 * a * way)
    return (2.0 * highest - first - last) / a


def spring_of(scenario: Scenario) -> float:
    """Real head and pad in series [N/m]."""
    drawn = 1.0 / (1.0 / scenario.head.stiffness_n_m + 1.0 / scenario.pad.stiffness_n_m)
    return drawn * scenario.head.spring_scale


def tracking_bound(scenario: Scenario, feed: float, wavelengths: tuple[float, float]) -> float:
    """Least rms of the force error at a steady feed on the displaced and bent part.

    The error at t is k (x(t) - s(t)), and x(t) can depend on readings up to t minus both latencies: the error
    is at least that of the best prediction of the surface s from readings in white noise (Gaussian
    regression; the part's offset and tilt unknown too). Nothing is known of neighbouring turns.

    Args:
        scenario: Noise, latencies, springs and size of the part's errors.
        feed: [m/s].
        wavelengths: Shortest and longest of the form error [m], uniformly drawn, in directions drawn in
            space.

    Returns:
        The bound [N].
    """
    k, latency = spring_of(scenario), scenario.sensor.latency_s + scenario.robot.command_latency_s
    sample = min(SAMPLE_S, wavelengths[0] / feed / LEAST_SAMPLES)
    noise = scenario.sensor.force_noise_n / math.sqrt(sample * scenario.sensor.rate_hz) / k
    ages = latency + (np.arange(min(round(PAST_M / feed / sample), 1200)) + 0.5) * sample
    past: Array = np.asarray(-feed * ages, dtype=np.float64)
    between = _covariance(past[:, None], past[None, :], scenario, wavelengths)
    ahead = _covariance(past, np.zeros(1), scenario, wavelengths)
    here = float(_covariance(np.zeros(1), np.zeros(1), scenario, wavelengths)[0])
    least = here - float(ahead @ np.linalg.solve(between + noise**2 * np.eye(len(past)), ahead))
    return k * math.sqrt(max(least, 0.0))


def _covariance(a: Array, b: Array, scenario: Scenario, wavelengths: tuple[float, float]) -> Array:
    """Covariance of the surface's height at two places along the path [m^2].

    A wave of number q in a direction drawn in space is seen along the path with numbers uniform in 0 to q:
    its covariance is sinc(q d). Offset and tilt of the part add a constant and a line.
    """
    part, numbers = scenario.part, 2.0 * math.pi / np.linspace(*wavelengths, 24)
    apart = np.abs(a - b)
    table = np.linspace(0.0, float(apart.max()), 4000)
    alike = np.sinc(table[:, None] * numbers / math.pi).mean(axis=1)
    form = (part.form_error_m / SPAN_BY_SIGMA) ** 2 * np.interp(apart, table, alike)
    return form + part.displacement_m**2 + part.rotation_rad**2 * a * b


def drift_bound(scenario: Scenario) -> float:
    """Least rms error at one point after a long time: the sensor's drift against its noise [N].

    A random walk of r per root second in white noise of sigma per sample h is known to sqrt(r sigma sqrt(h)).
    """
    sensor = scenario.sensor
    return math.sqrt(sensor.force_drift_n_s * sensor.force_noise_n * math.sqrt(1.0 / sensor.rate_hz))


# The part of the force error that noise and surface cause in a modelled loop.


def surface_error(setup: LoopSetup, law: LinearLaw) -> Callable[[Array], Complex]:
    """Force error per height of the surface [N/m] over frequency [rad/s], the loop closed.

    The contact meets a rising surface as it meets a sinking arm, but for the servos' give: F = G s / (1 + L).
    """
    plant, loop = build_plant(setup), force_loop(setup, law)

    def response(omega: Array) -> Complex:
        z = np.exp(1j * omega * setup.dt)
        pressed = plant_response(plant, plant.force, z) / plant_response(plant, plant.position, z)
        return pressed / (1.0 + loop(z))

    return response


def noise_rms(setup: LoopSetup, law: LinearLaw, noise: float) -> float:
    """Rms of the exact force that white noise of the sensor causes through the loop.

    Args:
        setup: Plant.
        law: Law.
        noise: Rms per sample, before the sensor's low-pass [N].

    Returns:
        The rms [N].
    """
    plant, loop = build_plant(setup), force_loop(setup, law)
    omega = np.linspace(0.2, math.pi / setup.dt, 6000)
    z = np.exp(1j * omega * setup.dt)
    read = setup.sensor_blend / (1.0 - (1.0 - setup.sensor_blend) / z) * z ** float(-setup.sensor_steps)
    asked = law.by_force(z) * read * z ** float(-setup.command_steps)
    force = asked * plant_response(plant, plant.force, z) / (1.0 + loop(z))
    return noise * math.sqrt(float(np.mean(np.abs(force) ** 2)))


def form_rms(
    setup: LoopSetup, law: LinearLaw, height: float, feed: float, wavelengths: tuple[float, float]
) -> float:
    """Rms of the force error on a wavy surface under feed.

    Args:
        setup: Plant.
        law: Law.
        height: Rms of the surface's height [m].
        feed: [m/s].
        wavelengths: Shortest and longest [m], uniformly drawn, their directions drawn in space: along the
            path a wave of number q is seen with numbers uniform in 0 to q.

    Returns:
        The rms [N].
    """
    numbers = 2.0 * math.pi / np.linspace(*wavelengths, 24)
    omega = feed * numbers[:, None] * (np.arange(40) + 0.5) / 40
    return height * math.sqrt(float(np.mean(np.abs(surface_error(setup, law)(omega.ravel())) ** 2)))
