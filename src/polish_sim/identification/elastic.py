"""Dynamics of an arm with elastic joints: rigid links behind gears whose two sides have encoders of their
own.

    tau = Ia a + fv w + fc s(w) + f0 + (1 + e'(motor)) T + load (T - D d(twist)/dt)
    load = ld where the motor drives, -ln where it is driven
    T = Y(link) pi + the sprung head's share + dY/dtable pi (table - nominal one)

Motor side and link side are measured, so neither the springs nor their hysteresis have to be known. Only e',
the slope of the gears' error, separates the size of T from the friction that grows with it: without it links
and load could be scaled together. What the arm is built off its table bends the weight's lever arms; it is
fitted along, with the table's tolerance as prior knowledge. The parameters are those of `TorqueModel` with
all its terms, the two shares of load and the bends behind them; Gauss-Newton on torques and columns that are
filtered alike: what is left of the torques becomes white. Encoder steps outweigh the torques' noise from
some 80 Hz on.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from polish_sim.arrays import Array, Bools, dots
from polish_sim.config import RealArmConfig
from polish_sim.identification.estimate import (
    BaseParameters,
    Estimate,
    against_truth,
    base_of,
    condition_number,
    inverse_of,
    spread_of_sums,
)
from polish_sim.identification.gear_fit import BLOCK_S, LOW_PASS_HZ, GearFit, off_turns, slope_of
from polish_sim.identification.log_file import LoggedGears, RobotLog
from polish_sim.identification.regressor import FULL, States, TorqueModel, rigid_regressor
from polish_sim.motion.kinematics import jacobian, link_frames
from polish_sim.motion.serial_chain import ChainGeometry

#: Of the fit: the gears' ripple at full speed is at 96 Hz; much above, encoder steps make all of |T| larger
BAND_HZ = 140.0
#: Width over which the noise's spectrum is smoothed: a small one would follow what the fit has taken
SMOOTH_HZ = 20.0
#: Low-pass of the states torques are predicted from: less loses the gears' ripple, more adds encoder steps
PREDICTED_HZ = 130.0
#: Size of these shares before anything is measured: decides only where gears show no error
LIKELY = 0.1
LOADS = 2  #: Parameters of friction by load, a joint
_ORDER = 8
_ROUNDS = 5


class SprungHead(NamedTuple):
    """The polishing head on its spring: known of the tool, and no part of a rigid link above its
    resonance."""

    mass: float  #: [kg]
    stiffness: float  #: [N/m]
    damping: float  #: [N s/m]
    center: Array  #: On the flange, along whose z it slides [m], shape (3,)

    def torques(self, link: States, dt: float, band: float) -> Array:
        """Torques of its motion on the spring (m, 6) [N m], the arm's motion periodic."""
        T = link_frames(link.q)[:, 6]
        axis, J = T[:, :3, 2], jacobian(link.q, self.center)[:, :3]
        place = T[:, :3, 3] + self.center[2] * axis
        along = np.fft.rfft(dots(axis, filtered(place, dt, band, 2)))
        w = 2.0 * math.pi * np.fft.rfftfreq(len(axis), dt)
        gain = w**2 / (self.stiffness / self.mass - w**2 + 1j * w * self.damping / self.mass)
        force = self.mass * np.fft.irfft(gain * along, len(axis))
        return force[:, None] * np.einsum("mi,mij->mj", axis, J)


def filtered(signal: Array, dt: float, band: float, order: int = 0) -> Array:
    """A periodic signal (m, ...) or its derivative of an order, low-passed at ``band`` [Hz] without delay."""
    f = np.fft.rfftfreq(len(signal), dt)
    gain = (2j * np.pi * f) ** order * _passed(f, band)
    spectrum = np.fft.rfft(signal, axis=0) * gain.reshape(-1, *[1] * (signal.ndim - 1))
    return np.fft.irfft(spectrum, len(signal), axis=0)


def _passed(f: Any, band: float) -> Any:
    return 1.0 / np.sqrt(1.0 + (f / band) ** (2 * _ORDER))


def one_period(log: RobotLog, period: float) -> RobotLog:
    """The mean of the whole periods of a log with gears."""
    assert log.gears is not None
    rows = round(period / np.mean(np.diff(log.time)))

    def mean(values: Array) -> Array:
        return values[: len(values) // rows * rows].reshape(-1, rows, values.shape[1]).mean(axis=0)

    return RobotLog(
        log.time[:rows], mean(log.q), mean(log.torque), LoggedGears(*(mean(side) for side in log.gears))
    )


def elastic_base(model: TorqueModel) -> BaseParameters:
    """Base parameters with both sides of the gears measured: rotors do not join the links."""
    assert model.terms == FULL
    links = 10 * model.joints
    terms = len(FULL) * model.joints
    rigid = base_of(replace(model, terms=()))
    combination = np.zeros((rigid.rank + terms, links + terms))
    combination[: rigid.rank, :links] = rigid.combination
    combination[rigid.rank :, links:] = np.eye(terms)
    return BaseParameters(np.append(rigid.columns, np.arange(links, links + terms)), combination)


class KnownArm(NamedTuple):
    """What is known of an elastic arm before it moves."""

    model: TorqueModel  #: With all its terms
    real: RealArmConfig  #: Only its gear ratio is used
    head: SprungHead
    bent: tuple[ChainGeometry, ...]  #: The chain with each number of its table off by its tolerance


class Found(NamedTuple):
    """Numbers torques are made of."""

    full: Array  #: Parameters of the model; dependent ones may be zero, shape (p,)
    loads: Array  #: Shares of friction by load, driving and driven, shape (n, 2)
    bends: Array  #: What the table is off, in tolerances, shape (24,)


class ElasticMotion:
    """One period of a motion, and the arm's torques in it as a function of parameters."""

    def __init__(
        self,
        arm: KnownArm,
        drawn: Array,
        gears: GearFit,
        log: RobotLog,
        band: float,
        sprung: bool = False,
    ) -> None:
        """``sprung``: what gears pass on faster than `LOW_PASS_HZ` is read from their twist, where springs
        are known.

        That needs no second derivative of encoder steps, but is no function of the links' parameters.
        """
        assert log.gears is not None
        self.dt = float(np.mean(np.diff(log.time)))
        motor, link = (States(*(filtered(side, self.dt, band, k) for k in range(3))) for side in log.gears)
        self.model = arm.model
        self.motor = motor
        self.head = arm.head.torques(link, self.dt, band)
        self.Y = rigid_regressor(arm.model.chain.geometry, *link)
        links = drawn[: self.Y.shape[2]]
        bent = [(rigid_regressor(geometry, *link) - self.Y) @ links for geometry in arm.bent]
        self.bends: Array = np.stack(bent, axis=-1)
        self.quick = None
        if sprung:
            springs = gears.torques(arm.real, LoggedGears(motor.q, link.q), self.dt)
            self.quick = springs - filtered(springs, self.dt, LOW_PASS_HZ)
        waves = 2.0 * arm.real.gear_ratio
        self.slope = waves * np.einsum("mjk,jk->mj", slope_of(waves * motor.q), gears.errors())
        turned = States(*(a - b for a, b in zip(motor, link, strict=True)))
        #: Damping of the gears, which friction by load does not grow with, shape (m, n) [N m]
        self.damped = gears.damping() * (turned.qd + self.slope * motor.qd)

    def torques(self, found: Found) -> Array:
        """Torques of the motors (m, n) [N m]."""
        T, shares = self.passed(found)
        own = found.full[self.Y.shape[2] :].reshape(len(FULL), -1)
        return (
            shares * T
            - (shares - 1.0 - self.slope) * self.damped
            + np.einsum("kmj,kj->mj", self.terms(), own)
        )

    def passed(self, found: Found) -> tuple[Array, Array]:
        """What the gears pass on [N m], and how many times that the motors feel, (m, n) each."""
        T = self.Y @ found.full[: self.Y.shape[2]] + self.head + self.bends @ found.bends
        if self.quick is not None:
            T = np.where(np.isnan(self.quick), T, filtered(T, self.dt, LOW_PASS_HZ) + self.quick)
        return T, 1.0 + self.slope + np.where(self.driving(T), found.loads[:, 0], -found.loads[:, 1])

    def driving(self, T: Array) -> Bools:
        """Where the motors drive, not the load."""
        return (T - self.damped) * self.motor.qd > 0.0

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
        off = self.estimate.theta - base.combination @ full, (self.numbers.loads - loads).T.ravel()
        std = self.estimate.std, self.loads_std.T.ravel()
        return against_truth(np.concatenate(off), np.concatenate(std), self.bound)


def fit_elastic(
    motion: ElasticMotion, base: BaseParameters, torque: Array, sigma: Array, periods: int
) -> ElasticFit:
    """Fit torques (m, n) [N m], the mean of ``periods`` periods whose noise is expected to be ``sigma``
    (n,)."""
    fit = _Fit(motion, base, torque)
    x, r, n = np.zeros(fit.size), base.rank, motion.model.joints
    for number in range(_ROUNDS):
        known = slice(0, fit.size if number else r)  # friction by load needs a first torque
        if number:
            fit.whiten(x)
        a, left = fit.linearised(x)
        a = a[:, known]
        prior = fit.prior[known]
        x[known] += inverse_of(a.T @ a + np.diag(prior)) @ (a.T @ left - prior * x[known])
    a, left = fit.linearised(x)
    C = inverse_of(a.T @ a + np.diag(fit.prior))
    covariance = C @ (spread_of_sums(a * left[:, None], fit.blocks) + np.diag(fit.prior)) @ C
    of_period = periods * fit.information(x, sigma) + np.diag(fit.prior)
    spread = np.array([np.var(torque[moving, j]) for j, moving in enumerate(fit.moving.T)])
    estimate = Estimate(
        x[:r], covariance[:r, :r], math.sqrt(periods) * fit.noise, 1.0 - fit.noise**2 / spread,
        condition_number(fit.information(x, np.ones(n))[:r, :r]), np.ones(n),
    )  # fmt: skip
    shown = slice(0, r + LOADS * n)
    std = np.sqrt(np.diag(covariance))[shown]
    return ElasticFit(
        estimate, fit.found(x), std[r:].reshape(LOADS, n).T, np.diag(inverse_of(of_period))[shown]
    )


class _Fit:
    """Samples and columns of one fit, and the gains by frequency that make what is left white."""

    def __init__(self, motion: ElasticMotion, base: BaseParameters, torque: Array) -> None:
        self.motion = motion
        self.base = base
        self.dt = motion.dt
        n = motion.model.joints
        self.bends = base.rank + LOADS * n
        self.size = self.bends + motion.bends.shape[2]
        self.prior = (np.arange(self.size) >= self.bends).astype(float)
        self.prior[base.rank : self.bends] = 1.0 / LIKELY**2
        self.rigid = base.columns[base.columns < 10 * n]
        self.torque = torque
        self.noise = np.ones(n)
        speeds = filtered(motion.motor.qd, self.dt, LOW_PASS_HZ)
        self.moving = np.array([off_turns(speed, self.dt) for speed in speeds.T]).T
        joint, row = np.nonzero(self.moving.T)
        self.blocks = joint * len(torque) + (row * self.dt / BLOCK_S).astype(np.int64)
        self.frequency = np.fft.rfftfreq(len(torque), self.dt)
        self.gains = np.repeat(_passed(self.frequency, LOW_PASS_HZ)[:, None], n, axis=1)

    def whiten(self, x: Array) -> None:
        """Find the gains from what ``x`` leaves of the torques."""
        left = np.where(self.moving, self.torque - self.motion.torques(self.found(x)), 0.0)
        power = np.abs(np.fft.rfft(left, axis=0)) ** 2 / self.moving.sum(axis=0)
        self.noise = np.sqrt(power[self.frequency < LOW_PASS_HZ].mean(axis=0))
        smooth = gaussian_filter1d(power, SMOOTH_HZ * len(left) * self.dt, axis=0)
        self.gains = _passed(self.frequency, BAND_HZ)[:, None] / np.sqrt(smooth)

    def found(self, x: Array) -> Found:
        full = np.zeros(self.motion.model.columns)
        full[self.base.columns] = x[: self.base.rank]
        return Found(full, x[self.base.rank : self.bends].reshape(LOADS, -1).T, x[self.bends :])

    def columns(self, x: Array, j: int) -> Array:
        """Slopes of a joint's torque by all parameters, shape (m, size)."""
        motion = self.motion
        n = self.motion.model.joints
        T, shares = motion.passed(self.found(x))
        slopes = np.zeros((len(T), self.size))
        slopes[:, self.bends :] = shares[:, j, None] * motion.bends[:, j]
        first = len(self.rigid)
        slopes[:, :first] = shares[:, j, None] * motion.Y[:, j, self.rigid]
        slopes[:, first + j : self.base.rank : n] = motion.terms()[:, :, j].T
        driving = motion.driving(T)[:, j]
        T = T - motion.damped
        slopes[:, self.base.rank + j], slopes[:, self.base.rank + n + j] = (
            np.where(driving, T[:, j], 0.0), np.where(driving, 0.0, -T[:, j]),
        )  # fmt: skip
        return slopes

    def linearised(self, x: Array) -> tuple[Array, Array]:
        """Columns of the samples of all joints, one after the other, and what the parameters leave of their
        torques, whitened."""
        left = self.torque - self.motion.torques(self.found(x))
        rows = []
        for j, moving in enumerate(self.moving.T):
            both = np.column_stack([self.columns(x, j), left[:, j]])
            spectrum = np.fft.rfft(both, axis=0) * self.gains[:, j, None]
            rows.append(np.fft.irfft(spectrum, len(both), axis=0)[moving])
        of_all = np.concatenate(rows)
        return of_all[:, :-1], of_all[:, -1]

    def information(self, x: Array, sigma: Array) -> Array:
        """Fisher information of one period's samples that count, white noise, nothing filtered."""
        H = np.zeros((self.size, self.size))
        for j, moving in enumerate(self.moving.T):
            a = self.columns(x, j)[moving] / sigma[j]
            H += a.T @ a
        return H
