"""Whether a modelled force loop is stable: eigenvalues where the law has a state space, else Nyquist (layer 7)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from polish_sim.control.linear_law import LinearLaw, PiLaw
from polish_sim.control.loop_model import Setup, build_plant, plant_response
from polish_sim.control.margins import Response

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Loop = Callable[[Complex], Complex]
"""Open loop L(z), closed by 1 + L = 0."""
SLOWEST = 0.2
"""Modes that grow more slowly count as stable [1/s]."""


def force_loop(setup: Setup, law: LinearLaw) -> Loop:
    """Open loop of plant, latencies and law, cut at the command.

    Args:
        setup: The plant.
        law: The law.

    Returns:
        L(z).
    """
    plant = build_plant(setup)

    def loop(z: Complex) -> Complex:
        reading = plant_response(plant, plant.reading, z) * z ** float(-setup.sensor_steps)
        velocity = plant_response(plant, plant.velocity, z)
        return -(law.by_force(z) * reading + law.by_motion(z) * velocity) * z ** float(-setup.command_steps)

    return loop


def response_of(loop: Loop, dt: float) -> Response:
    """A loop over frequency [rad/s], as ``margins`` wants it."""
    return lambda omega: loop(np.exp(1j * omega * dt))


def closed_loop_matrix(setup: Setup, law: PiLaw) -> Array:
    """One step of the closed loop: plant, law, samples under way to the host, commands under way to the servos.

    Args:
        setup: The plant.
        law: A law with a state space.

    Returns:
        The matrix; its eigenvalues are the loop's poles.
    """
    plant = build_plant(setup)
    n, m, late, far = len(plant.B), len(law.B), setup.sensor_steps, setup.command_steps
    size = n + m + late + far
    laws, samples, commands = n, n + m, n + m + late
    read = np.zeros(size)
    if late:
        read[samples + late - 1] = 1.0
    else:
        read[:n] = plant.reading
    answer = law.D * read
    answer[laws:samples] += law.C
    acting = answer
    if far:
        acting = np.zeros(size)
        acting[commands + far - 1] = 1.0
    step = np.zeros((size, size))
    step[:n, :n] = plant.A
    step[:n] += np.outer(plant.B, acting)
    step[laws:samples, laws:samples] = law.A
    step[laws:samples] += np.outer(law.B, read)
    if late:
        step[samples, :n] = plant.reading
        step[samples + 1 : commands, samples : commands - 1] = np.eye(late - 1)
    if far:
        step[commands] = answer
        step[commands + 1 :, commands:-1] = np.eye(far - 1)
    return step


def growth(matrix: Array, dt: float) -> float:
    """Rate at which the slowest mode of a closed loop dies away; positive when it grows [1/s]."""
    return math.log(max(float(np.abs(np.linalg.eigvals(matrix)).max()), 1e-12)) / dt


def growing_modes(loop: Loop, dt: float) -> int:
    """Number of closed-loop poles that grow, by counting turns about -1 (Nyquist).

    Args:
        loop: L(z); its own poles must be inside ``contour``.
        dt: Control cycle [s].

    Returns:
        How many; 0 means stable but for modes slower than ``SLOWEST``.
    """
    return turns_about_minus_one(loop(contour(dt)))


def contour(dt: float) -> Complex:
    """Upper half of the circle |z| = exp(SLOWEST dt), which keeps clear of the integrators at z = 1, shape (n,)."""
    omega = np.concatenate([[0.0], np.geomspace(1e-2, math.pi / dt, 1200)])
    return np.exp((SLOWEST + 1j * omega) * dt)


def turns_about_minus_one(response: Complex) -> int:
    """How often an open loop on ``contour`` and its mirror image goes clockwise around -1."""
    angle = np.unwrap(np.angle(1.0 + response))
    return -round(2.0 * (angle[-1] - angle[0]) / (2.0 * math.pi))
