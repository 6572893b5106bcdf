"""Measurements and targets for the laws, from a few words."""

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.config import ControllerConfig
from polish_sim.control import CONTROLLERS
from polish_sim.control.signals import CompiledController, Measurement, Target

DT = 0.001
CONFIG = ControllerConfig()


def controller(name: str, config: ControllerConfig = CONFIG) -> CompiledController:
    made = CONTROLLERS[name](config)
    made.reset(DT)
    return made


def measurement_at_rest() -> Measurement:
    """A tool at rest at the origin, z along base z."""
    m = Measurement()
    m.rotation[:] = np.eye(3)
    m.cycle = DT
    return m


def target_to_press(force: float = 20.0, contact: float = 0.0) -> Target:
    t = Target()
    t.rotation[:] = np.eye(3)
    t.force, t.contact = force, contact
    return t


def measurement_from(rng: np.random.Generator) -> Measurement:
    """A random measurement of a tool near some pose, moving and pressing."""
    m = Measurement()
    m.position[:] = rng.normal(size=3)
    m.rotation[:] = Rotation.random(random_state=rng).as_matrix()
    m.twist[:] = 0.1 * rng.normal(size=6)
    m.wrench[:] = [3.0, -2.0, 15.0, 0.1, -0.2, 0.05] * rng.normal(size=6)
    m.time, m.cycle = 0.0, DT
    return m


def target_near(m: Measurement, rng: np.random.Generator, contact: float) -> Target:
    """A target a few millimetres and degrees away from a measurement."""
    t = Target()
    t.position[:] = m.position + 0.003 * rng.normal(size=3)
    t.rotation[:] = Rotation.from_rotvec(0.02 * rng.normal(size=3)).as_matrix() @ m.rotation
    t.twist[:] = 0.05 * rng.normal(size=6)
    t.force, t.moment = 20.0, 0.0
    t.contact = contact
    return t
