"""Identification in two steps, the first step's covariance carried into the second: then it equals the joint fit.

``stepwise``: poses passed slowly from both sides, then motion. ``stepwise-axes``: the first three axes move while the
others hold, then all. Both work on the simulated arm and on a robot's own log.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Final, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, Indices
from polish_sim.errors import IdentificationError
from polish_sim.identification.arm import Arm, play_motion, play_states
from polish_sim.identification.estimate import (
    STANDING,
    TURNING,
    BaseParameters,
    Earlier,
    Estimate,
    JointSums,
    base_of_rows,
    estimate,
    informative,
    sum_samples,
)
from polish_sim.identification.excitation import ExcitationTask, random_motion, shrunk
from polish_sim.identification.fourier import FourierMotion
from polish_sim.identification.log_file import RobotLog, periodic_states, with_noise
from polish_sim.identification.regressor import PIECE, States, TorqueModel
from polish_sim.identification.settings import STEP_S, IdentifySettings

SPEED: Final = 0.1  #: Of every joint when it passes a pose [rad/s]
START_S: Final = 0.3  #: Until that speed is reached [s]
STEADY_S: Final = 0.2  #: At that speed until the pose is passed [s]
WINDOW_S: Final = 0.1  #: Over which torques are averaged, the pose in its middle [s]
AXES_FIRST: Final = 3  #: Axes that move in the first step of ``stepwise-axes``
SLOW, STEADY = 0.15, 0.2  #: A sample of a log is as good as at rest if all joints are below these [rad/s], [rad/s^2]
_BASE_SAMPLES: Final = 1000  #: The base of a step is found from this many of its samples
_LEAST_SAMPLES: Final = 200
_DRAWS: Final = 50


class Step(NamedTuple):
    """What a first step found: a base of its own, smaller than the whole one."""

    base: BaseParameters
    found: Estimate


class FirstStep(NamedTuple):
    """What the first step found, and its samples for comparison with a fit of everything at once."""

    step: Step
    sums: JointSums  #: In the whole base
    sigma: Array  #: Noise of its torques, where it is known [N m], shape (n,)


class SplitLog(NamedTuple):
    """A robot's own log in two steps."""

    first: FirstStep
    motion: Bools  #: Samples that are left for the second step, shape (m,)


# The fit of a first step.


def rest_rows(model: TorqueModel, states: States) -> Array:
    """Regressor of poses approached slowly: friction has the speed's sign, inertia has no effect, shape (m, n, p)."""
    none = np.zeros_like(states.q)
    rows = model.regressor(States(states.q, states.qd, none))
    links = 10 * model.joints
    rows[:, :, :links] = model.regressor(States(states.q, none, none))[:, :, :links]
    return rows


def sum_rows(rows: Array, torque: Array, columns: Indices, counts: Bools | None = None) -> JointSums:
    """Normal equations of regressor rows (m, n, p) and torques (m, n), where ``counts`` (m, n), everywhere if None."""
    used = np.ones(torque.shape, dtype=bool) if counts is None else counts
    chosen = np.swapaxes(rows[:, :, columns] * used[:, :, None], 0, 1)
    values = np.where(used, torque, 0.0)
    squares = np.swapaxes(chosen, 1, 2) @ chosen
    products = np.einsum("jmr,mj->jr", chosen, values)
    return JointSums(squares, products, values.sum(0), (values**2).sum(0), used.sum(0).astype(float))


def sum_rest(model: TorqueModel, columns: Indices, states: States, torque: Array, counts: Bools) -> JointSums:
    """Normal equations of many samples as if at rest, piece by piece."""
    parts = [slice(first, first + PIECE) for first in range(0, len(torque), PIECE)]
    sums = [sum_rows(rest_rows(model, states.rows(part)), torque[part], columns, counts[part]) for part in parts]
    return reduce(JointSums.plus, sums)


def fit_rest(
    model: TorqueModel, states: States, torque: Array, sigma: Array | None = None, counts: Bools | None = None
) -> Step:
    """First step: masses, first moments and Coulomb friction from poses at rest, approached from both sides.

    States (m, n) have the slow speed of the approach; ``torque`` (m, n) [N m] was held there, ``sigma`` (n,) is its
    noise where known, ``counts`` (m, n) which torques count; all if None.
    """
    used = np.ones(torque.shape, dtype=bool) if counts is None else counts
    some = _some(len(torque))
    base = base_of_rows(rest_rows(model, states.rows(some))[used[some]])
    return Step(base, estimate(sum_rest(model, base.columns, states, torque, used), sigma=sigma))


def fit_axes(model: TorqueModel, states: States, torque: Array) -> Step:
    """First step: some axes move while the others hold, exactly at rest in the states.

    Only the torques of moving axes count, as only their friction has a known size; what holds loads the last of them.
    """
    some, counts = _some(len(torque)), informative(states)
    base = base_of_rows(model.regressor(states.rows(some))[counts[some]])
    return Step(base, estimate(sum_samples(model, base, states, torque)))


def _some(samples: int) -> Indices:
    return np.unique(np.linspace(0, samples - 1, min(samples, _BASE_SAMPLES)).astype(np.int64))


def carried(step: Step, base: BaseParameters) -> Earlier:
    """What a first step knows, in the whole base: each of its parameters is a combination of the whole one.

    Motion estimated with it gives the same as if both steps' samples had been fitted at once.
    """
    M = step.base.combination[:, base.columns]
    weight = np.linalg.inv(step.found.covariance)
    return Earlier(M.T @ weight @ M, M.T @ weight @ step.found.theta)


# First steps on the simulated arm.

Simulated = Callable[[Arm, ExcitationTask, IdentifySettings, np.random.Generator], FirstStep]


def pass_poses(arm: Arm, task: ExcitationTask, settings: IdentifySettings, rng: np.random.Generator) -> FirstStep:
    """Pass random poses, clear of everything, at a slow steady speed from either side, averaging the torques there."""
    samples, sigma = WINDOW_S * settings.rate, np.array(settings.sigma)
    middle, half = round((START_S + STEADY_S) / STEP_S), round(0.5 * WINDOW_S / STEP_S)
    window = slice(middle - half, middle + half)
    poses, torques = [], []
    for pose in _clear_poses(task, settings.poses, rng):
        for side in (1.0, -1.0):
            log = play_states(arm, _passing(pose, side))
            noise = rng.normal(size=6) * sigma / np.sqrt(samples)
            poses.append(log.q[window].mean(axis=0))
            torques.append(log.torque[window].mean(axis=0) + noise)
    q = np.array(poses)
    sides = np.where(np.arange(len(q)) % 2, -1.0, 1.0)[:, None]
    states = States(q, sides * SPEED * np.ones_like(q), np.zeros_like(q))
    torque = np.array(torques) - _of_speed(task.model, states, task.parameters)
    rows = rest_rows(task.model, states)
    return FirstStep(
        fit_rest(task.model, states, torque), sum_rows(rows, torque, task.base.columns), sigma / np.sqrt(samples)
    )


def _of_speed(model: TorqueModel, states: States, believed: Array) -> Array:
    """The small torques of speed and acceleration besides friction, as the drawing has them [N m], shape (m, n)."""
    return np.asarray((model.regressor(states) - rest_rows(model, states)) @ believed)


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


def move_first_axes(arm: Arm, task: ExcitationTask, settings: IdentifySettings, rng: np.random.Generator) -> FirstStep:
    """Move the first three axes for a period while the wrist holds, as a load of the third."""
    motion, sigma = _held_motion(task, rng), np.array(settings.sigma)
    log = with_noise(play_motion(arm, motion, 1, settings.rate), settings.encoder_step, sigma, rng)
    states = standing(periodic_states(log, motion.period), slice(AXES_FIRST, None))
    step = fit_axes(task.model, states, log.torque)
    return FirstStep(step, sum_samples(task.model, task.base, states, log.torque), sigma)


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


SIMULATED: Final[dict[str, Simulated]] = {"stepwise": pass_poses, "stepwise-axes": move_first_axes}
"""First steps by the name of their method."""


# First steps in a robot's own log.


def slow_part(model: TorqueModel, base: BaseParameters, log: RobotLog, states: States, believed: Array) -> SplitLog:
    """The samples in which every joint moves slowly and steadily, as poses passed at rest.

    ``believed``: all parameters by the drawing, (p,); they take off the small effect of acceleration. Raises
    IdentificationError if there are too few such samples.
    """
    speed = np.abs(states.qd)
    slow = np.all((speed <= SLOW) & (np.abs(states.qdd) <= STEADY), axis=1)
    counts = slow[:, None] & (speed > TURNING)
    passes = f"({TURNING:g} to {SLOW:g} rad/s, all others slower than {SLOW:g})"
    _require(counts, f"in which a joint passes a pose slowly and steadily {passes}")
    rows = np.flatnonzero(counts.any(axis=1))
    chosen = states.rows(rows)
    torque = log.torque[rows] - _of_speed(model, chosen, believed)
    step = fit_rest(model, chosen, torque, counts=counts[rows])
    sums = sum_rest(model, base.columns, chosen, torque, counts[rows])
    return SplitLog(FirstStep(step, sums, step.found.sigma), ~slow)


def first_axes_part(
    model: TorqueModel, base: BaseParameters, log: RobotLog, states: States, believed: Array
) -> SplitLog:
    """The samples in which only the first three axes move, pose by pose of the axes that hold; see `slow_part`."""
    speed_limit, acceleration_limit = STANDING
    still = (np.abs(states.qd) <= speed_limit) & (np.abs(states.qdd) <= acceleration_limit)
    held = np.all(still[:, AXES_FIRST:], axis=1) & ~np.all(still[:, :AXES_FIRST], axis=1)
    _require(held[:, None], f"in which joints {AXES_FIRST + 1} to {model.joints} hold while others move")
    rows = np.flatnonzero(held)
    pieces = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    parts = [standing(states.rows(piece), slice(AXES_FIRST, None)) for piece in pieces]
    chosen = States(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    step = fit_axes(model, chosen, log.torque[rows])
    return SplitLog(FirstStep(step, sum_samples(model, base, chosen, log.torque[rows]), step.found.sigma), ~held)


def _require(counts: Bools, which: str) -> None:
    count = int(counts.any(axis=1).sum())
    if count < _LEAST_SAMPLES:
        raise IdentificationError(
            f"the log holds {count} samples {which}; the first step takes at least {_LEAST_SAMPLES}. Log such a part "
            "before the motion, or use --method joint."
        )


IN_LOG: Final = {"stepwise": slow_part, "stepwise-axes": first_axes_part}
"""First steps of a log by the name of their method."""
