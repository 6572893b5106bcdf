"""First steps of a stepwise identification, on the simulated arm and in a robot's own log.

``stepwise``: poses passed slowly from both sides, then motion. ``stepwise-axes``: the first three axes move while the
others hold, then all. Whatever the first step tells, its covariance is carried into the second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import IdentificationError
from polish_sim.identification.arm import STEP_S, Arm, play_motion, play_states
from polish_sim.identification.base_parameters import BaseParameters
from polish_sim.identification.estimate import STANDING, TURNING, JointSums, sum_samples
from polish_sim.identification.excitation import ExcitationTask, random_motion, shrunk
from polish_sim.identification.fourier import FourierMotion
from polish_sim.identification.log_file import RobotLog, periodic_states, with_noise
from polish_sim.identification.regressor import States, TorqueModel
from polish_sim.identification.settings import IdentifySettings
from polish_sim.identification.stepwise import Step, fit_axes, fit_rest, rest_rows, sum_rest, sum_rows

# Poses approached slowly from both sides: what the first step of a stepwise identification measures.

Array = NDArray[np.float64]

SPEED: Final = 0.1
"""Of every joint when it passes the pose [rad/s]."""
START_S: Final = 0.3
"""Until that speed is reached [s]."""
STEADY_S: Final = 0.2
"""At that speed until the pose is passed [s]."""
WINDOW_S: Final = 0.1
"""Over which torques are averaged, the pose in its middle [s]."""


class AtRest(NamedTuple):
    """Readings as if at rest, two of each pose."""

    states: States
    """The pose, the speed of its approach, no acceleration; shape (m, n) each."""
    torque: Array
    """Means [N m], shape (m, n)."""
    sigma: Array
    """Their noise [N m], shape (n,)."""


def approach_poses(arm: Arm, task: ExcitationTask, settings: IdentifySettings, rng: np.random.Generator) -> AtRest:
    """Pass random poses, clear of everything, at a slow steady speed from either side.

    Args:
        arm: The arm.
        task: Limits and clearance.
        settings: Noise and number of poses.
        rng: Draws poses and noise.
    """
    rows, torques = [], []
    samples = WINDOW_S * settings.rate
    for pose in _clear_poses(task, settings.poses, rng):
        for side in (1.0, -1.0):
            log = play_states(arm, _passing(pose, side))
            middle, half = round((START_S + STEADY_S) / STEP_S), round(0.5 * WINDOW_S / STEP_S)
            window = slice(middle - half, middle + half)
            rows.append(log.q[window].mean(axis=0))
            noise = rng.normal(size=6) * np.array(settings.sigma) / np.sqrt(samples)
            torques.append(log.torque[window].mean(axis=0) + noise)
    q = np.array(rows)
    sides = np.where(np.arange(len(q)) % 2, -1.0, 1.0)[:, None]
    states = States(q, sides * SPEED * np.ones_like(q), np.zeros_like(q))
    # The little that speed does besides friction is taken off as the drawing has it.
    of_speed = (task.model.regressor(states) - rest_rows(task.model, states)) @ task.parameters
    return AtRest(states, np.array(torques) - of_speed, np.array(settings.sigma) / np.sqrt(samples))


def _clear_poses(task: ExcitationTask, count: int, rng: np.random.Generator) -> Array:
    low, high = 0.9 * task.limits.position.T
    poses: list[Array] = []
    while len(poses) < count:
        pose = rng.uniform(np.minimum(low, high), np.maximum(low, high))
        if task.clearance is None or float(task.clearance(pose[None]).distance.min()) > task.limits.clearance:
            poses.append(pose)
    return np.array(poses)


def _passing(pose: Array, side: float) -> States:
    """From rest to a steady speed, through the pose, all joints alike."""
    t: Array = np.arange(round((START_S + STEADY_S + WINDOW_S) / STEP_S)) * np.float64(STEP_S)
    x = np.clip(t / START_S, 0.0, 1.0)
    speed = SPEED * (3.0 * x**2 - 2.0 * x**3)
    gone = START_S * (x**3 - 0.5 * x**4) + np.maximum(t - START_S, 0.0)
    way: Array = SPEED * (gone - (0.5 * START_S + STEADY_S))
    change = SPEED * 6.0 * (x - x**2) / START_S
    one = np.ones((1, 6))
    return States(pose + side * way[:, None] * one, side * speed[:, None] * one, side * change[:, None] * one)


Mask = NDArray[np.bool_]

AXES_FIRST: Final = 3
"""Axes that move in the first step of ``stepwise-axes``."""
SLOW, STEADY = 0.15, 0.2
"""In a log a sample is as good as at rest if every joint is below this speed [rad/s] and acceleration [rad/s^2]."""
_LEAST_SAMPLES: Final = 200
_DRAWS: Final = 50


class FirstStep(NamedTuple):
    """What the first step found, and its samples for comparison with a fit of everything at once."""

    step: Step
    sums: JointSums
    """In the whole base."""
    sigma: Array
    """Noise of its torques, where it is known [N m], shape (n,)."""


Simulated = Callable[[Arm, ExcitationTask, IdentifySettings, np.random.Generator], FirstStep]


def pass_poses(arm: Arm, task: ExcitationTask, settings: IdentifySettings, rng: np.random.Generator) -> FirstStep:
    """Pass poses slowly from both sides: masses, first moments, Coulomb friction."""
    at_rest = approach_poses(arm, task, settings, rng)
    step = fit_rest(task.model, at_rest.states, at_rest.torque)
    rows = rest_rows(task.model, at_rest.states)
    return FirstStep(step, sum_rows(rows, at_rest.torque, task.base.columns), at_rest.sigma)


def move_first_axes(arm: Arm, task: ExcitationTask, settings: IdentifySettings, rng: np.random.Generator) -> FirstStep:
    """Move the first three axes for a period while the wrist holds: what the wrist weighs is a load of the third."""
    motion, sigma = _held_motion(task, rng), np.array(settings.sigma)
    log = with_noise(play_motion(arm, motion, 1, settings.rate), settings.encoder, sigma, rng)
    states = standing(periodic_states(log, motion.period), slice(AXES_FIRST, None))
    step = fit_axes(task.model, states, log.torque)
    return FirstStep(step, sum_samples(task.model, task.base, states, log.torque), sigma)


SIMULATED: Final[dict[str, Simulated]] = {"stepwise": pass_poses, "stepwise-axes": move_first_axes}
"""First steps by the name of their method."""


def _held_motion(task: ExcitationTask, rng: np.random.Generator) -> FourierMotion:
    for _draw in range(_DRAWS):
        drawn = random_motion(task.limits, rng)
        drawn.coefficients[AXES_FIRST:, 1:] = 0.0
        motion = shrunk(drawn, task)
        if motion is not None:
            return motion
    raise IdentificationError("no motion of the first three axes keeps clear of the surroundings: start anew.")


def standing(states: States, joints: slice) -> States:
    """The states with some joints exactly at rest in the middle of where they were."""
    q, qd, qdd = (part.copy() for part in states)
    q[:, joints] = q[:, joints].mean(axis=0)
    qd[:, joints] = qdd[:, joints] = 0.0
    return States(q, qd, qdd)


class SplitLog(NamedTuple):
    """A robot's own log in two steps."""

    first: FirstStep
    motion: Mask
    """Samples that are left for the second step, shape (m,)."""


def slow_part(model: TorqueModel, base: BaseParameters, log: RobotLog, states: States, believed: Array) -> SplitLog:
    """The samples in which every joint moves slowly and steadily, as poses passed at rest.

    Args:
        model: The torque model.
        base: Its base.
        log: The log.
        states: Its states.
        believed: What the drawing says of all parameters; it takes off the little that acceleration does, shape (p,).

    Raises:
        IdentificationError: There are too few such samples.
    """
    speed = np.abs(states.qd)
    slow = np.all((speed <= SLOW) & (np.abs(states.qdd) <= STEADY), axis=1)
    told = slow[:, None] & (speed > TURNING)
    _require(
        told, "in which a joint passes a pose slowly and steadily "
        f"({TURNING:g} to {SLOW:g} rad/s, all others slower than {SLOW:g})",
    )  # fmt: skip
    rows = np.flatnonzero(told.any(axis=1))
    chosen = states.rows(rows)
    of_speed = (model.regressor(chosen) - rest_rows(model, chosen)) @ believed
    torque = log.torque[rows] - of_speed
    step = fit_rest(model, chosen, torque, told=told[rows])
    sums = sum_rest(model, base.columns, chosen, torque, told[rows])
    return SplitLog(FirstStep(step, sums, step.found.sigma), ~slow)


def first_axes_part(
    model: TorqueModel, base: BaseParameters, log: RobotLog, states: States, believed: Array
) -> SplitLog:
    """The samples in which only the first three axes move, pose by pose of the axes that hold."""
    speed_limit, acceleration_limit = STANDING
    still = (np.abs(states.qd) <= speed_limit) & (np.abs(states.qdd) <= acceleration_limit)
    held = np.all(still[:, AXES_FIRST:], axis=1) & ~np.all(still[:, :AXES_FIRST], axis=1)
    _require(held[:, None], f"in which joints {AXES_FIRST + 1} to {model.joints} hold while others move")
    rows = np.flatnonzero(held)
    pieces = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    parts = [standing(states.rows(piece), slice(AXES_FIRST, None)) for piece in pieces]
    chosen = States(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    step = fit_axes(model, chosen, log.torque[rows])
    return SplitLog(
        FirstStep(step, sum_samples(model, base, chosen, log.torque[rows]), step.found.sigma), ~held
    )  # fmt: skip


IN_LOG: Final = {"stepwise": slow_part, "stepwise-axes": first_axes_part}
"""First steps of a log by the name of their method."""


def _require(told: Mask, which: str) -> None:
    count = int(told.any(axis=1).sum())
    if count < _LEAST_SAMPLES:
        raise IdentificationError(
            f"the log holds {count} samples {which}; the first step takes at least {_LEAST_SAMPLES}. Log such a part "
            "before the motion, or use --method joint."
        )
