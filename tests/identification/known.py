"""Robots, motions and logs of which everything is known."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.exchange.robot_log import columns_of
from polish_sim.identification import IdentifySettings, excitation, identify
from polish_sim.identification.estimate import INTERVAL_95, BaseParameters, Estimate, base_of
from polish_sim.identification.excitation import FourierMotion
from polish_sim.identification.regressor import FULL, States, TorqueModel
from polish_sim.identification.robot_model import ARM_JOINTS, read_chain
from polish_sim.models import robot_model_path
from polish_sim.motion.serial_chain import SerialChain

RATE, SIGMA = 250.0, np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])
RANGE, TORQUE = np.array([[-0.9, 0.9]] * 6) * np.pi, np.array([150.0] * 3 + [28.0] * 3)
ODD = Path(__file__).with_name("odd.xml").read_text()
LIMITS = excitation.MotionLimits(RANGE, np.full(6, 3.0), np.full(6, 12.0), TORQUE)


def arm_model() -> mujoco.MjModel:
    """The cell's robot, its gravity not compensated, without contacts, stops and Coulomb friction."""
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    model.body_gravcomp[:] = 0.0
    return _bare(model)


def odd_model() -> mujoco.MjModel:
    """Two joints on one body, a slide, tilted axes, a welded body, a joint that does not start at zero."""
    return _bare(mujoco.MjModel.from_xml_string(ODD))


def _bare(model: mujoco.MjModel) -> mujoco.MjModel:
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= int(off.mjDSBL_FRICTIONLOSS | off.mjDSBL_CONTACT | off.mjDSBL_LIMIT)
    return model


@cache
def arm_chain() -> SerialChain:
    """The six axes of the cell's robot, tool and head part of the last link."""
    return read_chain(arm_model(), ARM_JOINTS)


def inverse_dynamics(model: mujoco.MjModel, q: Array, qd: Array, qdd: Array) -> Array:
    """MuJoCo's torques of the first joints; further joints stand still."""
    data, n = mujoco.MjData(model), q.shape[1]
    torques = np.empty_like(q)
    for row in range(len(q)):
        data.qpos[:n], data.qvel[:n], data.qacc[:n] = q[row], qd[row], qdd[row]
        mujoco.mj_inverse(model, data)
        torques[row] = data.qfrc_inverse[:n]
    return torques


class Known(NamedTuple):
    """A robot of which everything is known, and one of its motions."""

    model: TorqueModel
    base: BaseParameters
    truth: Array
    motion: FourierMotion
    states: States
    torque: Array

    def with_still(self, joints: slice) -> FourierMotion:
        coefficients = self.motion.coefficients.copy()
        coefficients[joints, 1:] = 0.0
        return FourierMotion(coefficients)


@cache
def known_robot(samples: int = 2000, terms: tuple[str, ...] = FULL, seed: int = 0) -> Known:
    """The arm on a random motion of one period, its torques without noise."""
    model, base = _arm(terms)
    motion = excitation.random_motion(LIMITS, np.random.default_rng(seed))
    states = motion(np.arange(samples) / samples * motion.period)
    truth = model.truth()
    return Known(model, base, base.combination @ truth, motion, states, model.torque(states, truth))


@cache
def _arm(terms: tuple[str, ...]) -> tuple[TorqueModel, BaseParameters]:
    model = TorqueModel(arm_chain(), terms)
    return model, base_of(model)


def noisy(torque: Array, rng: np.random.Generator) -> Array:
    return torque + rng.normal(size=torque.shape) * SIGMA


def covers(found: Estimate, truth: Array) -> Array:
    return np.abs(found.theta - truth) <= INTERVAL_95 * found.std


def design_once(patch: pytest.MonkeyPatch, iterations: int) -> list[IdentifySettings]:
    """Let the motion searched first, in a few iterations, serve all identifications; what each asked for."""
    search, asked, found = identify._design, list[IdentifySettings](), list[Any]()

    def design(arm: Any, base: Any, drawing: Any, settings: IdentifySettings, *more: Any) -> Any:
        asked.append(settings)
        if not found:
            found.append(search(arm, base, drawing, replace(settings, iterations=iterations), *more))
        return found[0]

    patch.setattr(identify, "_design", design)
    return asked


def write_log(file: Path, model: TorqueModel, states: States, sigma=0.0, truth=None, seed=0) -> Path:
    """Write states and noisy torques as a log at `RATE`; ``truth`` (p,) if it is not the model's own."""
    torque = model.torque(states, model.truth() if truth is None else truth)
    torque = torque + np.random.default_rng(seed).normal(size=torque.shape) * sigma
    q, force = columns_of(model.chain.geometry.kind.tolist()).wanted.values()
    table = np.column_stack([np.arange(len(torque)) / RATE, states.q, torque])
    np.savetxt(file, table, delimiter=",", header=",".join(["time_s", *q, *force]), comments="", fmt="%.9g")
    return file


def played(motion: FourierMotion, periods: int) -> States:
    """A periodic motion entered and left at rest."""
    end = periods * motion.period + 4.0
    return excitation.started_and_stopped(motion, np.arange(round(end * RATE)) / RATE, 2.0, end)
