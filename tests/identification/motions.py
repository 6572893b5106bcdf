"""Motions, noise and synthetic torques for the tests of identification."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.estimate import BaseParameters, base_of
from polish_sim.identification.excitation import random_motion
from polish_sim.identification.fourier import FourierMotion, MotionLimits
from polish_sim.identification.regressor import FULL, States, TorqueModel
from tests.identification.chains import arm_chain

Array = NDArray[np.float64]
SIGMA = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])
LIMITS = MotionLimits(
    np.array([[-0.9, 0.9]] * 6) * np.pi, np.full(6, 3.0), np.full(6, 12.0), np.array([150.0] * 3 + [28.0] * 3)
)


class Known(NamedTuple):
    """A robot of which everything is known, and one of its motions."""

    model: TorqueModel
    base: BaseParameters
    truth: Array
    motion: FourierMotion
    states: States
    torque: Array

    def with_still(self, joints: slice) -> FourierMotion:
        """The motion with some joints held in the middle of theirs."""
        coefficients = self.motion.coefficients.copy()
        coefficients[joints, 1:] = 0.0
        return FourierMotion(coefficients)


def known_robot(samples: int = 2000, terms: tuple[str, ...] = FULL, seed: int = 0) -> Known:
    """The arm on a random motion of one period, its torques without noise."""
    model = TorqueModel(arm_chain(), terms)
    base = base_of(model)
    motion = random_motion(LIMITS, np.random.default_rng(seed))
    states = motion(np.arange(samples) / samples * motion.period)
    truth = model.truth()
    return Known(model, base, base.combination @ truth, motion, states, model.torque(states, truth))


def noisy(torque: Array, rng: np.random.Generator) -> Array:
    """Torques as a sensor with `SIGMA` reads them."""
    return torque + rng.normal(size=torque.shape) * SIGMA
