"""What noise and surface make of the force in a modelled loop."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.scoring.loop_model import LinearLaw, Setup, build_plant, plant_response
from polish_sim.scoring.margins import force_loop

Complex = NDArray[np.complex128]


def surface_error(setup: Setup, law: LinearLaw) -> Callable[[Array], Complex]:
    """Force error per height of the surface [N/m] over frequency [rad/s], the loop closed.

    The contact meets a rising surface as it meets a sinking arm, but for the servos' give: F = G s / (1 + L).
    """
    plant, loop = build_plant(setup), force_loop(setup, law)

    def response(omega: Array) -> Complex:
        z = np.exp(1j * omega * setup.dt)
        pressed = plant_response(plant, plant.force, z) / plant_response(plant, plant.position, z)
        return pressed / (1.0 + loop(z))

    return response


def noise_rms(setup: Setup, law: LinearLaw, noise: float) -> float:
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


def form_rms(setup: Setup, law: LinearLaw, height: float, feed: float, wavelengths: tuple[float, float]) -> float:
    """Rms of the force error on a wavy surface under feed.

    Args:
        setup: Plant.
        law: Law.
        height: Rms of the surface's height [m].
        feed: [m/s].
        wavelengths: Shortest and longest [m], uniformly drawn, their directions drawn in space: along the path a wave
            of number q is seen with numbers uniform in 0 to q.

    Returns:
        The rms [N].
    """
    numbers = 2.0 * math.pi / np.linspace(*wavelengths, 24)
    omega = feed * numbers[:, None] * (np.arange(40) + 0.5) / 40
    return height * math.sqrt(float(np.mean(np.abs(surface_error(setup, law)(omega.ravel())) ** 2)))
