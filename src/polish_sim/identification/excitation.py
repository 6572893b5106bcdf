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
    def harmonics(self) -> int:
        """Number of harmonics k."""
        return (self.coefficients.shape[1] - 1) // 2

    @property
    def period(self) -> float:
        """[s]."""
        return 1.0 / self.frequency

    def __call__(self, t: Array) -> States:
        """States at times t [s], shape (m,)."""
        return States(
            *(part @ self.coefficients.T for part in fourier_basis(t, self.frequency, self.harmonics))
        )

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
    up = np.clip(t / ramp, 0.0, 1.0)
    down = np.clip((end - t) / ramp, 0.0, 1.0)
    # The clock's speed rises as 3 x^2 - 2 x^3; its integral over the ramp is half the ramp.
    clock = np.where(
        t < ramp, ramp * (up**3 - 0.5 * up**4) - 0.5 * ramp,
        np.where(t > end - ramp, end - 1.5 * ramp - ramp * (down**3 - 0.5 * down**4), t - ramp),
    )  # fmt: skip
    speed = (3.0 * up**2 - 2.0 * up**3) * (3.0 * down**2 - 2.0 * down**3)
    change = (
        np.where(t < ramp, 6.0 * (up - up**2), np.where(t > end - ramp, -6.0 * (down - down**2), 0.0)) / ramp
    )
    states = motion(clock)
    rate = speed[:, None]
    rise = change[:, None]
    return States(states.q, states.qd * rate, states.qdd * rate**2 + states.qd * rise)


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
        off = states.q - self.center
        ratios = (off / self.half, states.qd / self.speed, states.qdd / self.acceleration)
        return States(*map(beyond_one, ratios))

    def holds(self, states: States, torque: Array) -> bool:
        """Whether a motion respects position, speed, acceleration and torque at every sample."""
        return not any(np.any(part) for part in self.excess(states)) and bool(
            np.all(np.abs(torque) <= self.torque)
        )


class Judged(NamedTuple):
    """Value of the objective and its gradient by the information matrix (r, r), symmetric."""

    value: float
    slope: Array


def i_optimal(H: Array, G: Array) -> Judged:
    """Logarithm of the mean variance predicted on the task, log trace(H^-1 G), the objective of the search.

    H is the information of a motion, G the task's own matrix, both (r, r).
    """
    C = inverse_of(H)
    CG = C @ G
    mean = np.trace(CG)
    return Judged(float(np.log(mean)), -(CG @ C) / mean)


GRID = 100  #: Samples of a period while searching
FINE = 1000  #: Samples of a period when limits are checked
_SHARE = 0.9  #: Of a random motion's limits of speed and acceleration
_MARGIN = 0.98
_PENALTY = 30.0
_SHRINK = 0.98
_LEAST = 0.3
_RESTARTS = 4


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
    """G of a task: its mean information, so that trace(C G) is the predicted torques' summed variance in
    sigma^2."""
    Y = model.regressor(states)[:, :, base.columns] / sigma[:, None]
    return _mean_of_sample(Y)


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
        motion = shrunk(random_motion(task.limits, rng), task)
        if motion is not None:
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
    search = ExcitationCost(task)
    best: FourierMotion | None = None
    least = np.inf
    for start in islice(allowed_motions(task, rng), starts):
        x = search.run(start.coefficients.ravel(), iterations)
        motion = shrunk(FourierMotion(x.reshape(start.coefficients.shape)), task)
        if motion is not None:
            value = i_optimal(mean_information(task, motion), task.use).value
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
    Y = task.model.regressor(states)[:, :, task.base.columns] * (informative(states) / task.sigma)[:, :, None]
    return _mean_of_sample(Y)


def _mean_of_sample(Y: Array) -> Array:
    """Mean of Y^T Y over samples (m, n, r), shape (r, r)."""
    flat = Y.reshape(-1, Y.shape[2])
    return flat.T @ flat / len(Y)


class ExcitationCost:
    """Cost and gradient by the coefficients, with the basis kept between calls."""

    def __init__(self, task: ExcitationTask) -> None:
        self.task = task
        self.basis = fourier_basis(np.arange(GRID) / (GRID * FREQUENCY))

    def cost(self, x: Array) -> tuple[float, Array]:
        """Objective plus penalties and its gradient, shape (n (1 + 2 k),)."""
        task = self.task
        coefficients = x.reshape(task.model.joints, -1)
        states = States(*(part @ coefficients.T for part in self.basis))
        slopes = task.model.regressor_slopes(states)
        value, by_state = self._judge(states, slopes)
        for price, slope in (
            self._motion_price(states),
            self._torque_price(states, slopes),
            self._near_price(states),
        ):
            value += price
            by_state = by_state + slope
        parts = np.split(by_state, 3, axis=1)
        gradient = sum(part.T @ basis for part, basis in zip(parts, self.basis, strict=True))
        return value, np.asarray(gradient).ravel()

    def run(self, x: Array, iterations: int) -> Array:
        """Descend; where a kink of the clearance stopped the search it begins anew from there."""
        cost = np.inf
        for _restart in range(_RESTARTS):
            found = minimize(
                self.cost,
                x,
                jac=True,
                method="L-BFGS-B",
                options={"maxiter": iterations, "maxcor": 20, "ftol": 1e-6},
            )
            x = found.x
            gain = cost - found.fun
            cost = float(found.fun)
            iterations -= int(found.nit)
            if iterations <= 0 or gain < 1e-2:
                break
        return x

    def _judge(self, states: States, slopes: Array) -> tuple[float, Array]:
        task = self.task
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
        judged = i_optimal(H, task.use)
        pull = Y @ judged.slope
        by_state = np.einsum(
            "mdjr,mjr->md", slopes[..., columns], 2.0 * weight[:, :, None] * pull, optimize=True
        )
        of_speed = slice(task.model.joints, 2 * task.model.joints)
        by_state[:, of_speed] += np.sum(pull * Y, axis=2) * weight_slope * 2.0 * states.qd / STANDSTILL**2
        return judged.value, by_state

    def _motion_price(self, states: States) -> tuple[float, Array]:
        limits = self.task.limits
        tight = replace(limits, speed=_MARGIN * limits.speed, acceleration=_MARGIN * limits.acceleration)
        over = tight.excess(states)
        unit = States(tight.half, tight.speed, tight.acceleration)
        price = _PENALTY * sum(float(np.sum(part**2)) for part in over)
        return price, 2.0 * _PENALTY * np.hstack([part / size for part, size in zip(over, unit, strict=True)])

    def _torque_price(self, states: States, slopes: Array) -> tuple[float, Array]:
        task = self.task
        ratio = task.model.torque(states, task.parameters) / (_MARGIN * task.limits.torque)
        over = beyond_one(ratio)
        by_state = slopes @ task.parameters / (_MARGIN * task.limits.torque)
        return _PENALTY * float(np.sum(over**2)), 2.0 * _PENALTY * np.einsum("mdj,mj->md", by_state, over)

    def _near_price(self, states: States) -> tuple[float, Array]:
        task = self.task
        slope = np.zeros((GRID, 3 * task.model.joints))
        near = task.clearance(states.q)
        short = np.maximum(1.0 - (near.distance - task.limits.clearance) / _ROOM, 0.0)
        slope[:, : task.model.joints] = -2.0 * _PENALTY / _ROOM * np.einsum("mp,mpn->mn", short, near.slope)
        return _PENALTY * float(np.sum(short**2)), slope


_ROOM = 0.02  #: Within this of the least clearance poses are pushed away [m]
