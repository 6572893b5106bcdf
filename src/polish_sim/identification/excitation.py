"""Exciting motions for identification: periodic Fourier series under limits, found by gradient descent.

    q = q0 + sum_k a_k / (k w) sin(k w t) - b_k / (k w) cos(k w t)          (paper 3)

a_k and b_k are amplitudes of the speed [rad/s]. The series is linear in its coefficients: `fourier_basis`.

Limits enter as squared excess; the motion found is then shrunk until it respects every limit at
every sample of a fine grid. Gradients are exact: the regressor's own derivatives, chained with the series'
basis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import minimize

from polish_sim.arrays import Array
from polish_sim.errors import IdentificationError
from polish_sim.identification.estimate import STANDSTILL, BaseParameters, informative, inverse_of
from polish_sim.identification.regressor import States, TorqueModel

HARMONICS = 5
FREQUENCY = 0.1  #: Of the first harmonic [Hz]: a period of 10 s


def fourier_basis(t: Array, frequency: float = FREQUENCY, harmonics: int = HARMONICS) -> States:
    """Values and derivatives of one unit of each coefficient (1, a_1.., b_1..) at times t [s], (m, 1 + 2 k)
    each."""
    w = 2.0 * np.pi * frequency * np.arange(1, harmonics + 1)
    phase = np.outer(t, w)
    c, s = np.cos(phase), np.sin(phase)
    one = np.ones((len(t), 1))
    return States(
        np.hstack([one, s / w, -c / w]), np.hstack([0.0 * one, c, s]), np.hstack([0.0 * one, -w * s, w * c])
    )


@dataclass(frozen=True)
class FourierMotion:
    """A periodic motion of n joints."""

    coefficients: Array  #: q0, a_1.., b_1.. of each joint, shape (n, 1 + 2 k).
    frequency: float = FREQUENCY

    @property
    def period(self) -> float:
        """[s]."""
        return 1.0 / self.frequency

    def __call__(self, t: Array) -> States:
        """States at times t [s], shape (m,)."""
        basis = fourier_basis(t, self.frequency, self.coefficients.shape[1] // 2)
        return States(*(part @ self.coefficients.T for part in basis))

    def scaled(self, factor: float) -> FourierMotion:
        """The same motion with all amplitudes times a factor, about the same centre."""
        coefficients = self.coefficients.copy()
        coefficients[:, 1:] *= factor
        return FourierMotion(coefficients, self.frequency)


def fit_fourier(t: Array, q: Array, frequency: float, harmonics: int) -> FourierMotion:
    """Fit a series to measured positions (m, n) at times (m,), whose derivatives are then those of the fit.

    ``frequency``: of the first harmonic [Hz]; more ``harmonics`` than were commanded, because the servos add
    their own.
    """
    basis = fourier_basis(t, frequency, harmonics).q
    solution = np.linalg.solve(basis.T @ basis, basis.T @ q)
    return FourierMotion(np.ascontiguousarray(solution.T), frequency)


def started_and_stopped(motion: FourierMotion, t: Array, ramp: float, end: float) -> States:
    """The motion entered from rest and left to rest along its own path, its clock started and stopped
    smoothly.

    The clock runs at full speed from ``ramp``, the motion's time zero, to ``end - ramp``; at ``end`` [s] it
    stands.
    """
    clock, rate, rise = (each[:, None] for each in ramped(t, ramp, end))
    states = motion(clock[:, 0] - 0.5 * ramp)
    return States(states.q, states.qd * rate, states.qdd * rate**2 + states.qd * rise)


def ramped(t: Array, ramp: float, end: float) -> States:
    """What a clock says at times (m,) [s] that comes smoothly to full speed within ``ramp``, and to rest
    within another at ``end`` [s], its speed [-] and the change of that [1/s], shape (m,) each."""
    rise = CubicHermiteSpline([0.0, ramp, 2.0 * ramp], [0.0, 1.0, 1.0], np.zeros(3))
    begun, ending = np.maximum(t, 0.0), np.maximum(t - (end - ramp), 0.0)
    orders = rise.antiderivative(), rise, rise.derivative()
    return States(*(order(begun) - order(ending) for order in orders))


class Clearance(NamedTuple):
    """How far the robot is from itself and its surroundings."""

    #: Distance of each pair of bodies that could touch [m], negative inside, shape (m, pairs)
    distance: Array
    slope: Array  #: Its derivatives by the joints [m/rad], shape (m, pairs, n)


#: From poses (m, n) [rad] to clearances; the cell's one asks MuJoCo
ClearanceCheck = Callable[[Array], Clearance]


def beyond_one(ratio: Array) -> Array:
    """By how much shares of a limit go beyond it, signed; 0 inside."""
    return np.sign(ratio) * np.maximum(np.abs(ratio) - 1.0, 0.0)


@dataclass(frozen=True)
class MotionLimits:
    """Limits of position, speed, acceleration and torque of n joints, and of clearance."""

    position: Array  #: Lowest and highest [rad], shape (n, 2)
    speed: Array  #: [rad/s], shape (n,)
    acceleration: Array  #: [rad/s^2], shape (n,)
    torque: Array  #: [N m], shape (n,)
    clearance: float = 0.02  #: [m]

    @property
    def center(self) -> Array:
        """Middles of the ranges of position [rad], shape (n,)."""
        return self.position.mean(axis=1)

    @property
    def half(self) -> Array:
        """Halves of these ranges [rad], shape (n,)."""
        return 0.5 * np.ptp(self.position, axis=1)

    def excess(self, states: States) -> States:
        """By how much positions, speeds and accelerations go beyond, in shares of the limits, signed; 0
        inside."""
        ratios = (
            (states.q - self.center) / self.half,
            states.qd / self.speed,
            states.qdd / self.acceleration,
        )
        return States(*map(beyond_one, ratios))

    def holds(self, states: States, torque: Array) -> bool:
        """Whether a motion respects position, speed, acceleration and torque at every sample."""
        return not any(np.any(part) for part in self.excess(states)) and bool(
            np.all(np.abs(torque) <= self.torque)
        )


def i_optimal(H: Array, G: Array) -> tuple[float, Array]:
    """Logarithm of the mean variance predicted on the task, log trace(H^-1 G), the objective of the search,
    and its gradient by H, (r, r), symmetric.

    H is the information of a motion, G the task's own matrix, both (r, r).
    """
    C = inverse_of(H)
    CG = C @ G
    mean = np.trace(CG)
    return np.log(mean), -(CG @ C) / mean


GRID = 100  #: Samples of a period while searching
FINE = 1000  #: Samples of a period when limits are checked
_SHARE = 0.9  #: Of a random motion's limits of speed and acceleration
_MARGIN = 0.98
_PENALTY = 30.0
_SHRINK = 0.98
_LEAST = 0.3
_RESTARTS = 4
_ROOM = 0.02  #: Within this of the least clearance poses are pushed away [m]


@dataclass(frozen=True)
class ExcitationTask:
    """What is identified, under which limits, for which use."""

    model: TorqueModel
    base: BaseParameters
    parameters: Array  #: All parameters as believed, for the torques' limits, shape (p,)
    sigma: Array  #: Expected torque noise [N m], shape (n,)
    limits: MotionLimits
    #: The task's own matrix G: mean of Y^T W Y over the motions that will be predicted, shape (r, r)
    use: Array
    clearance: ClearanceCheck


def use_matrix(model: TorqueModel, base: BaseParameters, states: States, sigma: Array) -> Array:
    """G of a task: its mean information at a noise ``sigma`` (n,) or (m, n) of the torques, so that trace(C
    G) is the predicted torques' summed variance in sigma^2; shape (r, r)."""
    flat = (model.regressor(states)[:, :, base.columns] / sigma[..., None]).reshape(-1, base.rank)
    return flat.T @ flat / len(states.q)


def random_motion(limits: MotionLimits, rng: np.random.Generator) -> FourierMotion:
    """A random series that keeps the limits of position, speed and acceleration."""
    n = len(limits.speed)
    coefficients = rng.normal(size=(n, 1 + 2 * HARMONICS))
    coefficients[:, 0] = 0.0
    states = FourierMotion(coefficients)(np.arange(FINE) / (FINE * FREQUENCY))
    # The offset is drawn within what the amplitude leaves.
    reach, speed, acceleration = (np.abs(part).max(0) for part in states)
    room = np.maximum(speed / limits.speed, acceleration / limits.acceleration) / _SHARE
    room = np.maximum(room, reach / (0.8 * limits.half))
    coefficients[:, 1:] /= room[:, None]
    coefficients[:, 0] = limits.center + rng.uniform(-1.0, 1.0, n) * (0.95 * limits.half - reach / room)
    return FourierMotion(coefficients)


def allowed_motions(task: ExcitationTask, rng: np.random.Generator) -> Iterator[FourierMotion]:
    """Random motions that respect every limit, one after the other."""
    while True:
        if motion := shrunk(random_motion(task.limits, rng), task):
            yield motion


def shrunk(motion: FourierMotion, task: ExcitationTask) -> FourierMotion | None:
    """The motion with amplitudes as large as every limit allows; None if it must shrink below a few
    tenths."""
    factor = 1.0
    for samples in (GRID, FINE):
        t = np.arange(samples) / samples * motion.period
        while not _allowed(motion.scaled(factor)(t), task):
            factor *= _SHRINK
            if factor < _LEAST:
                return None
    return motion.scaled(factor)


def _allowed(states: States, task: ExcitationTask) -> bool:
    return task.limits.holds(states, task.model.torque(states, task.parameters)) and bool(
        np.all(task.clearance(states.q).distance >= task.limits.clearance)
    )


def design(
    task: ExcitationTask, rng: np.random.Generator, starts: int = 1, iterations: int = 300
) -> FourierMotion:
    """Find the motion of the least mean variance predicted on the task, under all limits; see `i_optimal`.

    ``starts``: random motions to begin from; ``iterations``: of the search from each. Raises
    IdentificationError if no start led to a motion within the limits.
    """
    cost = excitation_cost(task)
    best: FourierMotion | None = None
    least = np.inf
    for start in islice(allowed_motions(task, rng), starts):
        x = _descend(cost, start.coefficients.ravel(), iterations)
        if motion := shrunk(FourierMotion(x.reshape(start.coefficients.shape)), task):
            value, _ = i_optimal(mean_information(task, motion), task.use)
            if value < least:
                best, least = motion, value
    if best is None:
        raise IdentificationError(
            "no exciting motion keeps clear of the surroundings: widen the limits or start anew."
        )
    return best


def mean_information(task: ExcitationTask, motion: FourierMotion) -> Array:
    """Information of one sample of all torques, averaged over a period, shape (r, r)."""
    states = motion(np.arange(FINE) / FINE * motion.period)
    counted = np.where(informative(states), task.sigma, np.inf)
    return use_matrix(task.model, task.base, states, counted)


def excitation_cost(task: ExcitationTask) -> Callable[[Array], tuple[float, Array]]:
    """Objective plus penalties and its gradient, shape (n (1 + 2 k),), by the coefficients in a row."""
    basis = fourier_basis(np.arange(GRID) / (GRID * FREQUENCY))

    def cost(x: Array) -> tuple[float, Array]:
        coefficients = x.reshape(task.model.joints, -1)
        states = States(*(part @ coefficients.T for part in basis))
        slopes = task.model.regressor_slopes(states)
        value, by_state = _judged(task, states, slopes)
        limits = task.limits
        tight = replace(limits, speed=_MARGIN * limits.speed, acceleration=_MARGIN * limits.acceleration)
        over, sizes = tight.excess(states), (tight.half, tight.speed, tight.acceleration)
        most = _MARGIN * limits.torque
        heavy = beyond_one(task.model.torque(states, task.parameters) / most)
        near = task.clearance(states.q)
        short = np.maximum(1.0 - (near.distance - limits.clearance) / _ROOM, 0.0)
        value += _PENALTY * sum(np.sum(part**2) for part in over)
        value += _PENALTY * np.sum(heavy**2)
        value += _PENALTY * np.sum(short**2)
        pull = 2.0 * _PENALTY
        by_state += pull * np.hstack([part / size for part, size in zip(over, sizes, strict=True)])
        by_state += pull * np.einsum("mdj,mj->md", slopes @ task.parameters / most, heavy)
        nearer = np.einsum("mp,mpn->mn", short, near.slope)
        by_state[:, : task.model.joints] += -pull / _ROOM * nearer
        parts = zip(np.split(by_state, 3, axis=1), basis, strict=True)
        gradient = sum(part.T @ of_state for part, of_state in parts)
        return value, np.asarray(gradient).ravel()

    return cost


def _descend(cost: Callable[[Array], tuple[float, Array]], x: Array, iterations: int) -> Array:
    """Descend; where a kink of the clearance stopped the search it begins anew from there."""
    least = np.inf
    for _restart in range(_RESTARTS):
        found = minimize(
            cost,
            x,
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": iterations, "maxcor": 20, "ftol": 1e-6},
        )
        x = found.x
        gain = least - found.fun
        least = found.fun
        iterations -= int(found.nit)
        if iterations <= 0 or gain < 1e-2:
            break
    return x


def _judged(task: ExcitationTask, states: States, slopes: Array) -> tuple[float, Array]:
    """The objective and its gradient by the states, shape (m, 3 n)."""
    columns = task.base.columns
    # Near standstill rows fade out smoothly; the final weight is a step.
    u = (states.qd / STANDSTILL) ** 2
    certainty = 1.0 / (task.sigma**2 * GRID)
    weight = certainty * u**2 / (1.0 + u**2)
    weight_slope = certainty * 2.0 * u / (1.0 + u**2) ** 2
    Y = task.model.regressor(states)[:, :, columns]
    flat = Y * np.sqrt(weight)[:, :, None]
    H = np.tensordot(flat, flat, axes=((0, 1), (0, 1)))
    H[np.diag_indices_from(H)] *= 1.0 + 1e-12
    value, slope = i_optimal(H, task.use)
    pull = Y @ slope
    by_state = np.einsum("mdjr,mjr->md", slopes[..., columns], 2.0 * weight[:, :, None] * pull, optimize=True)
    of_speed = slice(task.model.joints, 2 * task.model.joints)
    by_state[:, of_speed] += np.sum(pull * Y, axis=2) * weight_slope * 2.0 * states.qd / STANDSTILL**2
    return value, by_state
