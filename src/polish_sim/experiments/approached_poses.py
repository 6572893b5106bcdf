"""Poses approached slowly from both sides: what the first step of a stepwise identification measures (layer 9)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.experiments.identified_arm import STEP_S, Arm, play_states
from polish_sim.identification.excitation import ExcitationTask
from polish_sim.identification.settings import IdentifySettings
from polish_sim.identification.stepwise import rest_rows
from polish_sim.identification.torque_model import States

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
