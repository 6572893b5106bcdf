"""Identification in steps, each step's covariance carried into the next: then it equals the joint fit."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.base_parameters import BaseParameters, base_of_rows
from polish_sim.identification.estimate import Earlier, Estimate, JointSums, estimate, sum_samples, told_rows
from polish_sim.identification.regressor import PIECE, States, TorqueModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_BASE_SAMPLES: Final = 1000
"""From so many samples of a step its base is found."""


class Step(NamedTuple):
    """What a first step found: a base of its own, smaller than the whole one."""

    base: BaseParameters
    found: Estimate


def rest_rows(model: TorqueModel, states: States) -> Array:
    """Regressor of poses approached slowly: friction has the speed's sign, inertia shows nothing, shape (m, n, p)."""
    none = np.zeros_like(states.q)
    rows = model.regressor(States(states.q, states.qd, none))
    still = States(states.q, none, none)
    links = 10 * model.joints
    rows[:, :, :links] = model.regressor(still)[:, :, :links]
    return rows


def sum_rows(rows: Array, torque: Array, columns: NDArray[np.int64], told: Mask | None = None) -> JointSums:
    """Normal equations of given regressor rows (m, n, p) and torques (m, n), where ``told`` (m, n) says they count."""
    counts = np.ones(torque.shape, dtype=bool) if told is None else told
    chosen = np.swapaxes(rows[:, :, columns] * counts[:, :, None], 0, 1)
    used = np.where(counts, torque, 0.0)
    squares = np.swapaxes(chosen, 1, 2) @ chosen
    products = np.einsum("jmr,mj->jr", chosen, used)
    return JointSums(squares, products, used.sum(0), (used**2).sum(0), counts.sum(0).astype(float))


def sum_rest(model: TorqueModel, columns: NDArray[np.int64], states: States, torque: Array, told: Mask) -> JointSums:
    """Normal equations of many samples as if at rest, piece by piece."""
    parts = [slice(first, first + PIECE) for first in range(0, len(torque), PIECE)]
    sums = [sum_rows(rest_rows(model, states.rows(part)), torque[part], columns, told[part]) for part in parts]
    total = sums[0]
    for more in sums[1:]:
        total = total.plus(more)
    return total


def fit_rest(
    model: TorqueModel, states: States, torque: Array, sigma: Array | None = None, told: Mask | None = None
) -> Step:
    """First step: poses at rest, approached from both sides, tell masses, first moments and Coulomb friction.

    Args:
        model: The torque model.
        states: Poses with the slow speed of their approach, shape (m, n) each.
        torque: Held there [N m], shape (m, n).
        sigma: The torques' noise [N m] where it is known, shape (n,).
        told: Which torques count; all if None, shape (m, n).

    Returns:
        The parameters of this step with their covariance.
    """
    counts = np.ones(torque.shape, dtype=bool) if told is None else told
    some = _some(len(torque))
    base = base_of_rows(rest_rows(model, states.rows(some))[counts[some]])
    return Step(base, estimate(sum_rest(model, base.columns, states, torque, counts), sigma=sigma))


def fit_axes(model: TorqueModel, states: States, torque: Array, sigma: Array | None = None) -> Step:
    """First step: some axes move while the others hold; only the torques of moving axes have a friction of known size.

    Args:
        model: The torque model.
        states: The motion, of holding joints exactly at rest, shape (m, n) each.
        torque: [N m], shape (m, n).
        sigma: The torques' noise [N m] where it is known, shape (n,).

    Returns:
        The parameters of this step with their covariance; what holds is a load of the last moving link.
    """
    some, told = _some(len(torque)), told_rows(states)
    base = base_of_rows(model.regressor(states.rows(some))[told[some]])
    return Step(base, estimate(sum_samples(model, base, states, torque), sigma=sigma))


def _some(samples: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, samples - 1, min(samples, _BASE_SAMPLES)).astype(np.int64))


def carried(step: Step, base: BaseParameters) -> Earlier:
    """What a first step knows, in the whole base."""
    # Each parameter of the first step is a combination of the whole base.
    M = step.base.combination[:, base.columns]
    weight = np.linalg.inv(step.found.covariance)
    return Earlier(M.T @ weight @ M, M.T @ weight @ step.found.theta)


def fit_motion_after(step: Step, base: BaseParameters, sums: JointSums, sigma: Array | None = None) -> Estimate:
    """Second step: motion, with what the first step knows and how well it knows it.

    Args:
        step: What the first step found.
        base: The whole base.
        sums: What the motion says, in the whole base.
        sigma: The torques' noise [N m] where it is known, shape (n,).

    Returns:
        All base parameters; the same as if both steps' samples had been fitted at once.
    """
    return estimate(sums, carried(step, base), sigma)
