"""Identification in steps, each step's covariance carried into the next: then it equals the joint fit (layer 8d)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.base_parameters import BaseParameters, base_of_rows
from polish_sim.identification.estimate import Earlier, Estimate, estimate
from polish_sim.identification.information import JointSums
from polish_sim.identification.torque_model import States, TorqueModel

Array = NDArray[np.float64]


class Step(NamedTuple):
    """What a first step found: a base of its own, smaller than the whole one."""

    base: BaseParameters
    found: Estimate


def rest_rows(model: TorqueModel, states: States) -> Array:
    """Regressor of poses approached slowly: friction has the speed's sign, inertia shows nothing, shape (m, n, p)."""
    rows = model.regressor(states)
    still = States(states.q, 0.0 * states.q, 0.0 * states.q)
    links = 10 * model.joints
    rows[:, :, :links] = model.regressor(still)[:, :, :links]
    return rows


def sum_rows(rows: Array, torque: Array, columns: NDArray[np.int64]) -> JointSums:
    """Normal equations of given regressor rows (m, n, p) and torques (m, n)."""
    chosen = np.swapaxes(rows[:, :, columns], 0, 1)
    squares = np.swapaxes(chosen, 1, 2) @ chosen
    products = np.einsum("jmr,mj->jr", chosen, torque)
    count = np.full(torque.shape[1], float(len(torque)))
    return JointSums(squares, products, torque.sum(0), (torque**2).sum(0), count)


def fit_rest(model: TorqueModel, states: States, torque: Array, sigma: Array | None = None) -> Step:
    """First step: poses at rest, approached from both sides, tell masses, first moments and Coulomb friction.

    Args:
        model: The torque model.
        states: Poses with the slow speed of their approach, shape (m, n) each.
        torque: Held there [N m], shape (m, n).
        sigma: The torques' noise [N m] where it is known, shape (n,).

    Returns:
        The parameters of this step with their covariance.
    """
    rows = rest_rows(model, states)
    base = base_of_rows(rows.reshape(-1, model.columns))
    return Step(base, estimate(sum_rows(rows, torque, base.columns), sigma=sigma))


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
    # Each parameter of the first step is a combination of the whole base.
    M = step.base.combination[:, base.columns]
    weight = np.linalg.inv(step.found.covariance)
    return estimate(sums, Earlier(M.T @ weight @ M, M.T @ weight @ step.found.theta), sigma)
