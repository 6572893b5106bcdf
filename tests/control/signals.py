"""Measurements and targets for the laws, from a few words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.control.signals import Measurement, MeasurementRecord, Target, TargetRecord, measurement_of, target_of

Array = NDArray[np.float64]


def measurement_from(rng: np.random.Generator, dt: float = 0.001) -> Measurement:
    """A random measurement of a tool near some pose, moving and pressing."""
    m = measurement_of(MeasurementRecord())
    m.position[:] = rng.normal(size=3)
    m.rotation[:] = Rotation.random(random_state=rng).as_matrix()
    m.twist[:] = 0.1 * rng.normal(size=6)
    m.wrench[:] = [3.0, -2.0, 15.0, 0.1, -0.2, 0.05] * rng.normal(size=6)
    m.clock[:] = 0.0, dt
    return m


def target_near(m: Measurement, rng: np.random.Generator, contact: float, force: float = 20.0) -> Target:
    """A target a few millimetres and degrees away from a measurement."""
    t = target_of(TargetRecord())
    t.position[:] = m.position + 0.003 * rng.normal(size=3)
    t.rotation[:] = Rotation.from_rotvec(0.02 * rng.normal(size=3)).as_matrix() @ m.rotation
    t.twist[:] = 0.05 * rng.normal(size=6)
    t.force[:] = force, 0.0
    t.contact[0] = contact
    return t
