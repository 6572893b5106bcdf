"""Dynamics of an arm with elastic joints: rigid links behind gears whose two sides have encoders of their
own.

    tau = Ia a + fv w + fc s(w) + f0 + (1 + e'(motor) + load) T
    load = ld where T drives, -ln where it is driven
    T = Y(link) pi + the sprung head's share + dY/dtable pi (table - nominal one)

Motor side and link side are measured, so neither the springs nor their hysteresis have to be known. Only e',
the slope of the gears' error, tells the size of T from the friction that grows with it: links and load could
else be scaled together. What the arm is built off its table bends the weight's lever arms; it is fitted
along, with the table's tolerance as prior knowledge. The parameters are those of `TorqueModel` with all its
terms, the two shares of load and the bends behind them; Gauss-Newton on torques and columns that are
low-passed alike.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools
from polish_sim.config import RealArmConfig
from polish_sim.identification.estimate import (
    INTERVAL_95,
    TURNING,
    BaseParameters,
    Estimate,
    base_of_rows,
    condition_number,
    inverse_of,
)
from polish_sim.identification.gear_fit import GearFit
from polish_sim.identification.log_file import Gears, RobotLog
from polish_sim.identification.regressor import FULL, States, TorqueModel, random_states, rigid_regressor
from polish_sim.motion.kinematics import jacobian, link_frames
from polish_sim.motion.serial_chain import ChainGeometry

#: Of torques and columns that are fitted: above, encoder steps are all there is to see
LOW_PASS_HZ = 30.0
BAND_HZ = 250.0  #: Of the states columns are made of
#: Of the states torques are predicted from: less loses the gears' ripple, more adds steps
PREDICTED_HZ = 130.0
BLOCK_S = 0.2  #: How long residuals may be alike
#: Size of these shares before anything is measured: decides only where gears show no error
LIKELY = 0.3
LOADS = 2  #: Parameters of friction by load, a joint
_ORDER = 8
_ROUNDS = 5
_SAMPLES = 200


class SprungHead(NamedTuple):
    """The polishing head on its spring: known of the tool, and no part of a rigid link above its
    resonance."""

    mass: float  #: [kg]
    stiffness: float  #: [N/m]
    damping: float  #: [N s/m]
    center: Array  #: On the flange, along whose z it slides [m], shape (3,)

    def torques(self, link: States, dt: float, band: float) -> Array:
        """Torques of its motion on the spring (m, 6) [N m], the arm's motion periodic."""
        axis, J = link_frames(link.q)[:, 6, :3, 2], jacobian(link.q, self.center)[:, :3]
        place = link_frames(link.q)[:, 6, :3, 3] + self.center[2] * axis
        along = np.fft.rfft(np.sum(axis * filtered(place, dt, band, 2), axis=1))
        w = 2.0 * math.pi * np.fft.rfftfreq(len(axis), dt)
        gain = w**2 / (self.stiffness / self.mass - w**2 + 1j * w * self.damping / self.mass)
        force = self.mass * np.fft.irfft(gain * along, len(axis))
        return force[:, None] * np.einsum("mi,mij->mj", axis, J)


def filtered(signal: Array, dt: float, band: float, order: int = 0) -> Array:
    """A periodic signal (m, ...) or its derivative of an order, low-passed at ``band`` [Hz] without delay."""
    f = np.fft.rfftfreq(len(signal), dt)
    gain = (2j * np.pi * f) ** order / np.sqrt(1.0 + (f / band) ** (2 * _ORDER))
    spectrum = np.fft.rfft(signal, axis=0) * gain.reshape(-1, *[1] * (signal.ndim - 1))
    return np.fft.irfft(spectrum, len(signal), axis=0)


def one_period(log: RobotLog, period: float) -> RobotLog:
    """The mean of the whole periods of a log with gears."""
    assert log.gears is not None
    rows = round(period / float(np.mean(np.diff(log.time))))

    def mean(values: Array) -> Array:
        return np.asarray(
            values[: len(values) // rows * rows].reshape(-1, rows, values.shape[1]).mean(axis=0)
        )

    return RobotLog(
        log.time[:rows], mean(log.q), mean(log.torque), Gears(*(mean(side) for side in log.gears))
    )


def elastic_base(model: TorqueModel) -> BaseParameters:
    """Base parameters with both sides of the gears measured: rotors do not join the links."""
    assert model.terms == FULL
    links, terms = 10 * model.joints, len(FULL) * model.joints
    states = random_states(model.joints, _SAMPLES, np.random.default_rng(0))
    rigid = base_of_rows(model.regressor(states)[:, :, :links].reshape(-1, links))
    combination = np.zeros((rigid.rank + terms, links + terms))
    combination[: rigid.rank, :links], combination[rigid.rank :, links:] = rigid.combination, np.eye(terms)
    return BaseParameters(np.append(rigid.columns, np.arange(links, links + terms)), combination)


class KnownArm(NamedTuple):
    """What is known of an elastic arm before it moves."""

    model: TorqueModel  #: With all its terms
    real: RealArmConfig  #: Of which the ratio is used
    head: SprungHead
    bent: tuple[ChainGeometry, ...]  #: The chain with each number of its table off by its tolerance
    drawn: Array  #: Parameters by drawing, shape (p,)


class Found(NamedTuple):
    """Numbers torques are made of."""

    full: Array  #: Parameters of the model; dependent ones may be zero, shape (p,)
    loads: Array  #: Shares of friction by load, driving and driven, shape (n, 2)
    bends: Array  #: What the table is off, in tolerances, shape (24,)


class ElasticMotion:
    """One period of a motion, and the arm's torques in it as a function of parameters."""

    def __init__(
        self, arm: KnownArm, gears: GearFit, log: RobotLog, band: float, sprung: bool = False
    ) -> None:
        """``sprung``: what gears pass on faster than `LOW_PASS_HZ` is read from their twist, where springs
        are known.

        That needs no second derivative of encoder steps, but is no function of the links' parameters.
        """
        assert log.gears is not None
        model, errors = arm.model, gears.errors()
        self.dt = float(np.mean(np.diff(log.time)))
        motor, link = (States(*(filtered(side, self.dt, band, k) for k in range(3))) for side in log.gears)
        self.model, self.motor = model, motor
        self.head = arm.head.torques(link, self.dt, band)
        self.Y = rigid_regressor(model.chain.geometry, *link)
        drawn = arm.drawn[: self.Y.shape[2]]
        bent = [(rigid_regressor(geometry, *link) - self.Y) @ drawn for geometry in arm.bent]
        self.bends: Array = np.stack(bent, axis=-1)
        self.quick = None
        if sprung:
            springs = gears.torques(arm.real, Gears(motor.q, link.q), self.dt)
            self.quick = springs - filtered(springs, self.dt, LOW_PASS_HZ)
        waves = 2.0 * arm.real.gear_ratio
        s, c, e = np.sin(waves * motor.q), np.cos(waves * motor.q), errors.T
        self.slope = waves * (e[0] * c - e[1] * s + 2.0 * (e[2] * (c**2 - s**2) - e[3] * 2.0 * s * c))

    def torques(self, found: Found) -> Array:
        """Torques of the motors (m, n) [N m]."""
        T, shares = self.passed(found)
        own = found.full[self.Y.shape[2] :].reshape(len(FULL), -1)
        return shares * T + np.einsum("kmj,kj->mj", self.terms(), own)

    def passed(self, found: Found) -> tuple[Array, Array]:
        """What the gears pass on [N m], and how many times that the motors feel, (m, n) each."""
        T = self.Y @ found.full[: self.Y.shape[2]] + self.head + self.bends @ found.bends
        if self.quick is not None:
            T = np.where(np.isnan(self.quick), T, filtered(T, self.dt, LOW_PASS_HZ) + self.quick)
        return T, 1.0 + self.slope + np.where(self.driving(T), found.loads[:, 0], -found.loads[:, 1])

    def driving(self, T: Array) -> Bools:
        """Where the motors drive, not the load."""
        return T * self.motor.qd > 0.0

    def terms(self) -> Array:
        """Columns of the terms in the order of `FULL`, shape (4, m, n)."""
        w = self.motor.qd
        return np.stack([np.sign(w), w, self.motor.qdd, np.ones_like(w)])


class ElasticFit(NamedTuple):
    """What was found."""

    estimate: Estimate  #: Of `elastic_base`
    numbers: Found
    loads_std: Array  #: Shape (n, 2)
    #: Cramér-Rao bound of base parameters and loads at the torques' noise: variances, shape (r + 2 n,)
    bound: Array

    def against(self, base: BaseParameters, full: Array, loads: Array) -> dict[str, float]:
        """Figures of base parameters and loads against the true ones, (p,) and (n, 2)."""
        theta, std = self.estimate.theta, self.estimate.std
        off = np.concatenate([theta - base.combination @ full, (self.numbers.loads - loads).T.ravel()])
        held = np.abs(off) <= INTERVAL_95 * np.concatenate([std, self.loads_std.T.ravel()])
        over = float(np.sqrt(np.mean(off**2 / self.bound)))
        return {"error_over_crb": over, "interval_coverage": float(np.mean(held))}


def fit_elastic(
    motion: ElasticMotion, base: BaseParameters, torque: Array, sigma: Array, periods: int
) -> ElasticFit:
    """Fit torques (m, n) [N m], the mean of ``periods`` periods whose noise is expected to be ``sigma``
    (n,)."""
    fit = _Fit(motion, base, torque)
    x, r, n = np.zeros(fit.size), base.rank, motion.model.joints
    for number in range(_ROUNDS):
        known = slice(0, fit.size if number else r)  # friction by load needs a first torque
        pieces = [(a[:, known], left) for a, left in fit.linearised(x)]
        H, g = _normal(pieces, fit.noise)
        prior = fit.prior[known]
        step = inverse_of(H + np.diag(prior)) @ (g - prior * x[known])
        x[known] += step
        fit.noise = np.array([np.std(left - a @ step) for a, left in pieces])
    pieces = fit.linearised(x)
    H = _normal(pieces, fit.noise)[0] + np.diag(fit.prior)
    covariance = _clustered(pieces, fit, inverse_of(H))
    of_period = periods * fit.information(x, sigma) + np.diag(fit.prior)
    spread = np.array([np.var(fit.torque[moving, j]) for j, moving in enumerate(fit.moving.T)])
    plain = np.asarray(sum(a[:, :r].T @ a[:, :r] for a, _left in pieces))
    scale = 1.0 / np.sqrt(np.diag(H)[:r])
    # White noise of the mean is passed in this share by the low-pass.
    passed = math.sqrt(2.0 * LOW_PASS_HZ * motion.dt / periods)
    estimate = Estimate(
        x[:r], covariance[:r, :r], fit.noise / passed, 1.0 - fit.noise**2 / spread, condition_number(plain),
        condition_number(H[:r, :r] * np.outer(scale, scale)), np.ones(n),
    )  # fmt: skip
    shown = slice(0, r + LOADS * n)
    std = np.sqrt(np.diag(covariance))[shown]
    return ElasticFit(
        estimate, fit.found(x), std[r:].reshape(LOADS, n).T, np.diag(inverse_of(of_period))[shown]
    )


def _normal(pieces: list[tuple[Array, Array]], noise: Array) -> tuple[Array, Array]:
    H = sum((a / s).T @ (a / s) for (a, _left), s in zip(pieces, noise, strict=True))
    return np.asarray(H), np.asarray(
        sum(a.T @ left / s**2 for (a, left), s in zip(pieces, noise, strict=True))
    )


def _clustered(pieces: list[tuple[Array, Array]], fit: _Fit, C: Array) -> Array:
    """Covariance of a fit whose residuals may be alike within a block of one joint (sandwich); ``C``: were
    they not."""
    scores = []
    for (a, left), s, block in zip(pieces, fit.noise, fit.blocks, strict=True):
        used, which = np.unique(block, return_inverse=True)
        sums = np.zeros((len(used), a.shape[1]))
        np.add.at(sums, which, a * left[:, None] / s**2)
        scores.append(sums)
    all_of_them = np.concatenate(scores)
    few = len(all_of_them) / max(len(all_of_them) - len(C), 1)
    return C @ (few * all_of_them.T @ all_of_them + np.diag(fit.prior)) @ C


class _Fit:
    """Low-passed samples and columns of one fit."""

    def __init__(self, motion: ElasticMotion, base: BaseParameters, torque: Array) -> None:
        self.motion, self.base, self.dt = motion, base, motion.dt
        n = motion.model.joints
        self.bends = base.rank + LOADS * n
        self.size = self.bends + motion.bends.shape[2]
        self.prior = (np.arange(self.size) >= self.bends).astype(float)
        self.prior[base.rank : self.bends] = 1.0 / LIKELY**2
        self.rigid = base.columns[base.columns < 10 * n]
        self.rows = slice(None, None, max(1, round(1.0 / (2.5 * LOW_PASS_HZ * self.dt))))
        self.torque, self.noise = self.low(torque)[self.rows], np.ones(n)
        reach = round(0.5 / LOW_PASS_HZ / self.dt)
        slow = np.abs(self.low(motion.motor.qd)) < TURNING
        near = np.array([np.convolve(joint, np.ones(2 * reach + 1), "same") > 0.5 for joint in slow.T]).T
        self.moving = ~near[self.rows]
        block = (np.arange(len(torque)) * self.dt / BLOCK_S).astype(np.int64)[self.rows]
        self.blocks = [block[moving] for moving in self.moving.T]

    def low(self, signal: Array) -> Array:
        return filtered(signal, self.dt, LOW_PASS_HZ)

    def found(self, x: Array) -> Found:
        full = np.zeros(self.motion.model.columns)
        full[self.base.columns] = x[: self.base.rank]
        return Found(full, x[self.base.rank : self.bends].reshape(LOADS, -1).T, x[self.bends :])

    def columns(self, x: Array, j: int) -> Array:
        """Slopes of a joint's torque by all parameters, shape (m, size)."""
        motion, n = self.motion, self.motion.model.joints
        T, shares = motion.passed(self.found(x))
        slopes = np.zeros((len(T), self.size))
        slopes[:, self.bends :] = shares[:, j, None] * motion.bends[:, j]
        first = len(self.rigid)
        slopes[:, :first] = shares[:, j, None] * motion.Y[:, j, self.rigid]
        slopes[:, first + j : self.base.rank : n] = motion.terms()[:, :, j].T
        driving = motion.driving(T)[:, j]
        slopes[:, self.base.rank + j], slopes[:, self.base.rank + n + j] = (
            np.where(driving, T[:, j], 0.0), np.where(driving, 0.0, -T[:, j]),
        )  # fmt: skip
        return slopes

    def linearised(self, x: Array) -> list[tuple[Array, Array]]:
        """Of every joint the samples' columns and what the parameters leave of their torques."""
        left = self.torque - self.low(self.motion.torques(self.found(x)))[self.rows]
        return [
            (self.low(self.columns(x, j))[self.rows][moving], left[moving, j])
            for j, moving in enumerate(self.moving.T)
        ]

    def information(self, x: Array, sigma: Array) -> Array:
        """Fisher information of one period's samples that count, white noise, nothing low-passed."""
        every = self.rows.step
        H = np.zeros((self.size, self.size))
        for j, moving in enumerate(self.moving.T):
            a = self.columns(x, j)[np.repeat(moving, every)[: len(self.motion.Y)]] / sigma[j]
            H += a.T @ a
        return H
