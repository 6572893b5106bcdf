"""Stiffness of elastic joints from encoders on both sides of their gears and the motors' torques.

    torque = J a + fv w + s(w) (fc + load |T|) + (1 + e') (T + D d(twist)/dt),   T = K(twist) + Th h
    twist = motor - link + e(motor) - offset

K has three slopes, its knees, the periods of the gear's error e and the twist over which hysteresis h builds
up are the catalogue's. Torques are fitted against twists, not the other way: the encoders' steps are small
beside the twist, the torques' noise is not beside the torque. Both sides are low-passed alike, which
acceleration asks for.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

from polish_sim.arrays import Array, Bools
from polish_sim.cell.gears import slip
from polish_sim.config import RealArmConfig
from polish_sim.identification.estimate import INTERVAL_95, TURNING, inverse_of, spread_of_sums
from polish_sim.identification.log_file import LoggedGears, RobotLog
from polish_sim.identification.physical import ParameterRow
from polish_sim.kernel_cache import njit

LOW_PASS_HZ = 30.0  #: For the speeds that show where motors turn back, and where torques' noise is unknown
#: Low-pass of the twists: the encoders' steps, added up, would lengthen the way of the hysteresis
TWIST_HZ = 140.0
SAMPLED_HZ = 100.0  #: Rate of the samples that are fitted
BLOCK_S = 0.2  #: How long residuals may be alike
FORGOTTEN = 7.0  #: Ways, in units of its rise, after which it does not matter how a hysteresis began
#: A slope is fitted where a first estimate of the torque goes beyond this share of its knee
SEEN = 0.7
KNOWN = 0.1  #: A slope whose standard deviation is a larger share of it is not known
SURE = 0.03  #: Standard deviation below which a share of friction by load counts as known
CONFOUNDED = 1e6  #: Condition number of the fit from which its parameters are not separable
_ENDS_S = 0.2  #: Left out at both ends of the log, where the low-pass has no past or future
_NAMES = (
    "Jr",
    "fvr",
    "fcr",
    "ldr",
    "ldn",
    "D",
    "Th",
    "offset",
    "es",
    "ec",
    "es2",
    "ec2",
    "Ka",
    "Kb",
    "Kc",
)
_UNITS = ("kg m^2", "N m s/rad", "N m", "-", "-", "N m s/rad", "N m", *["rad"] * 5, *["N m/rad"] * 3)
_TYPICAL = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 10.0, 1.0, *[1e-4] * 5, *[1e4] * 3])
_FIRST = 12  #: Where the slopes begin in these
_LOADS, _ERRORS = slice(3, 5), slice(8, _FIRST)  #: Where friction by load is, and the error of the gears


class GearFit(NamedTuple):
    """What was found of n gears, in the order rotor, friction, load's share, damping, hysteresis, error,
    slopes."""

    values: Array  #: Shape (n, 15); NaN where the motion does not show it
    std: Array  #: Shape (n, 15)
    truth: Array  #: Of the simulated arm, shape (n, 15); NaN where it is not a setting

    def rows(self) -> list[ParameterRow]:
        """The numbers for the table of parameters: rotor, friction, damping, hysteresis and slopes of every
        joint."""
        chosen = [k for k in range(len(_NAMES)) if not 7 <= k < _FIRST]
        return [
            ParameterRow(
                f"{_NAMES[k]}{j + 1}", float(self.values[j, k]), _UNITS[k], float(self.std[j, k]),
                "no" if math.isnan(self.values[j, k]) else "gear", float(self.truth[j, k]),
            )
            for k in chosen for j in range(len(self.values))
        ]  # fmt: skip

    def errors(self) -> Array:
        """Factors of the gears' errors, shape (n, 4) [rad], 0 where none is seen."""
        return np.nan_to_num(self.values[:, _ERRORS])

    def damping(self) -> Array:
        """Damping of the gears [N m s/rad], shape (n,), 0 where it may be none."""
        D = self.values[:, 5]
        std = self.std[:, 5]
        return np.where(INTERVAL_95 * std < D, D, 0.0)

    def torques(self, real: RealArmConfig, sides: LoggedGears, dt: float) -> Array:
        """What the gears' springs, hysteresis and damping pass on, (m, n) [N m]; NaN where no slope is
        known."""
        torques = np.full(sides.motor.shape, np.nan)
        for j in np.flatnonzero(np.isfinite(self.values[:, _FIRST])):
            x = self.values[j]
            error = _error_of(2.0 * real.gear_ratio * sides.motor[:, j]) @ np.nan_to_num(x[_ERRORS])
            twist = sides.motor[:, j] - sides.link[:, j] - x[7] + error
            knees = real.knee_1_nm[j], real.knee_2_nm[j]
            spring = _spring(twist, x[_FIRST:][np.isfinite(x[_FIRST:])], knees)
            slip = np.nan_to_num(x[6]) * _hysteresis(twist, real.lost_motion_rise_rad)
            torques[:, j] = spring + slip + np.nan_to_num(x[5]) * np.gradient(twist, dt)
        return torques

    def with_loads(self, loads: Array, std: Array) -> GearFit:
        """The same with shares of friction by load found otherwise, shape (n, 2) each."""
        values = self.values.copy()
        deviations = self.std.copy()
        values[:, _LOADS] = loads
        deviations[:, _LOADS] = std
        return self._replace(values=values, std=deviations)

    def true_loads(self) -> Array:
        """Those of the simulated arm, shape (n, 2)."""
        return self.truth[:, _LOADS]

    def loads_known(self) -> Array:
        """Shares of friction by load, shape (n, 2): of gears that bear too little to show theirs the others'
        mean."""
        loads = self.values[:, _LOADS]
        std = self.std[:, _LOADS]
        weights = np.where(std < SURE, 1.0 / std**2, 0.0)
        mean = (weights * loads).sum(axis=0) / (weights.sum(axis=0) + 1e-300)  # none where none shows them
        return np.where(std < SURE, loads, mean)

    def figures(self) -> dict[str, Any]:
        """Keys of metrics.json: slopes and friction by load."""
        K, std, true = (part[:, _FIRST:] for part in self)
        off = np.abs(K - true)
        found = np.isfinite(K)
        return {
            "friction_by_load": self.values[:, _LOADS].tolist(),
            "friction_by_load_std": self.std[:, _LOADS].tolist(),
            "gear_stiffness_nm_rad": K.tolist(),
            "gear_stiffness_std_nm_rad": std.tolist(),
            "gear_slopes_found": int(found.sum()),
            "gear_stiffness_error_max": np.nanmax(off / true) if found.any() else math.nan,
            "gear_interval_coverage": np.mean((off <= INTERVAL_95 * std)[found]) if found.any() else math.nan,
        }


def fit_gears(log: RobotLog, real: RealArmConfig, period: float) -> GearFit:
    """Find the gears of a log with both sides' encoders; of ``real`` what a catalogue says is used, the rest
    is truth.

    Slopes beyond the logged torques, and parameters that the log does not determine, are NaN.
    """
    assert log.gears is not None
    n = log.q.shape[1]
    values = np.full((n, len(_NAMES)), np.nan)
    std = np.full((n, len(_NAMES)), np.nan)
    for j in range(n):
        gear = _Gear(log, real, period, j)
        x, deviation = gear.fit()
        slope = np.arange(len(x)) >= _FIRST
        known = np.isfinite(deviation) & (~slope | (deviation <= KNOWN * np.abs(x)))
        values[j, : len(x)][known] = x[known]
        std[j, : len(x)][known] = deviation[known]
    return GearFit(values, std, _truth(real, float(np.mean(log.time))))


def _truth(real: RealArmConfig, t: float) -> Array:
    """The settings, friction as warm as it is at a time [s]."""
    warm = 1.0 + real.cold_friction * math.exp(-t / real.warming_s)
    n = len(real.coulomb_nm)
    load = warm * np.array([real.coulomb_driving, real.coulomb_driven])
    slopes = np.array([real.stiffness_1_nm_rad, real.stiffness_2_nm_rad, real.stiffness_3_nm_rad])
    friction = warm * np.array([real.viscous_nm_s_rad, real.coulomb_nm])
    lost = 0.5 * np.array(real.lost_motion_rad) * slopes[0]
    unknown = np.full((n, 5), np.nan)
    driven = [real.rotor_kg_m2, *friction, np.tile(load, (n, 1)), real.damping_nm_s_rad, lost, unknown]
    return np.column_stack([*driven, *slopes])


class _Gear:
    """One joint's samples, and its torque as a function of the numbers to be found."""

    def __init__(self, log: RobotLog, real: RealArmConfig, period: float, j: int) -> None:
        assert log.gears is not None
        self._dt = float(np.mean(np.diff(log.time)))
        self._sos = butter(2, 2.0 * LOW_PASS_HZ * self._dt, output="sos")
        self._rise = real.lost_motion_rise_rad
        self._knees = (real.knee_1_nm[j], real.knee_2_nm[j])
        angle = log.gears.motor[:, j]
        sharp = butter(8, 2.0 * TWIST_HZ * self._dt, output="sos")
        self._turned = sosfiltfilt(sharp, angle - log.gears.link[:, j])
        self._speed = np.gradient(self._low(angle), self._dt)
        self._acceleration = np.gradient(self._speed, self._dt)
        self._torque = self._low(log.torque[:, j])
        waves = 2.0 * real.gear_ratio
        self._error = _error_of(waves * angle)
        self._slope = waves * slope_of(waves * angle)
        self._every = max(1, round(1.0 / (SAMPLED_HZ * self._dt)))
        self._counts = self._moving()
        self._phase = self._sampled(log.time % period)

    def _sampled(self, values: Array) -> Array:
        """The samples that are fitted and count."""
        return values[:: self._every][self._counts]

    def _low(self, signal: Array) -> Array:
        return sosfiltfilt(self._sos, signal)

    def _moving(self) -> Bools:
        """Which of the samples that are fitted count: the motor does not reverse within the low-pass's
        reach."""
        ends = round(_ENDS_S / self._dt)
        near = off_turns(self._speed, self._dt)
        near[:ends] = near[-ends:] = False
        near &= np.cumsum(np.abs(np.diff(self._turned, prepend=self._turned[0]))) > FORGOTTEN * self._rise
        return near[:: self._every]

    def fit(self) -> tuple[Array, Array]:
        """Numbers found and their standard deviations, as many as slopes are reached, shape (13,) to
        (15,)."""
        start = self._start()
        least = np.where(np.arange(len(start)) < _FIRST, -np.inf, 1.0)
        found = least_squares(
            self._left,
            start,
            bounds=(least, np.inf),
            x_scale=_TYPICAL[: len(start)],
            max_nfev=20,
        )
        return found.x, self._deviations(found.jac, found.fun)

    def _deviations(self, slopes: Array, left: Array) -> Array:
        """Standard deviations of a fit whose residuals may be alike for ``BLOCK_S`` and from period to
        period."""
        deviations = np.full(slopes.shape[1], np.inf)
        size = np.linalg.norm(slopes, axis=0)
        seen = size > 0.0
        if np.linalg.cond(slopes[:, seen] / size[seen]) > CONFOUNDED:
            return deviations
        slopes = slopes[:, seen]
        C = inverse_of(slopes.T @ slopes)
        blocks = (self._phase / BLOCK_S).astype(np.int64)
        deviations[seen] = np.sqrt(np.diag(C @ spread_of_sums(slopes * left[:, None], blocks) @ C))
        return deviations

    def _start(self) -> Array:
        """Numbers of a linear fit, with as many equal slopes as its torques reach."""
        parts = (self._acceleration, self._speed, self._low(np.sign(self._speed)), self._low(self._turned))
        columns = self._sampled(np.column_stack([*parts, np.ones_like(self._torque)]))
        torque = self._sampled(self._torque)
        inertia, viscous, dry, K, rest = np.linalg.lstsq(columns, torque, rcond=None)[0]
        K = max(K, 1e3)
        largest = np.abs(K * columns[:, 3] + rest).max()
        slopes = 1 + sum(largest > SEEN * knee for knee in self._knees)
        return np.array([inertia, viscous, dry, 0.0, 0.0, 0.0, 0.0, -rest / K, *[0.0] * 4, *[K] * slopes])

    def _left(self, x: Array) -> Array:
        """Torque less that of the numbers, low-passed [N m], of the samples that are fitted."""
        twist = self._turned - x[7] + self._error @ x[8:_FIRST]
        torque = _spring(twist, x[_FIRST:], self._knees) + x[6] * _hysteresis(twist, self._rise)
        load = np.where(torque * self._speed > 0.0, x[3], x[4]) * np.abs(torque)
        passed = (1.0 + self._slope @ x[8:_FIRST]) * (torque + x[5] * np.gradient(twist, self._dt))
        smooth = x[0] * self._acceleration + x[1] * self._speed
        given = smooth + self._low(np.sign(self._speed) * (x[2] + load) + passed)
        return self._sampled(self._torque - given)


def off_turns(speed: Array, dt: float) -> Bools:
    """Where a motor of a speed (m,) [rad/s] does not turn back within the reach of the low-pass."""
    reach = round(0.5 / LOW_PASS_HZ / dt)
    return np.convolve(np.abs(speed) < TURNING, np.ones(2 * reach + 1), "same") < 0.5


def _error_of(phase: Array) -> Array:
    """Columns of the gear's error at its phases (m,), shape (m, 4)."""
    return np.stack([np.sin(phase), np.cos(phase), np.sin(2.0 * phase), np.cos(2.0 * phase)], axis=-1)


def slope_of(phase: Array) -> Array:
    """Slopes of these columns by phases of any shape (..., 4)."""
    sin, cos, sin2, cos2 = np.moveaxis(_error_of(phase), -1, 0)
    return np.stack([cos, -sin, 2.0 * cos2, -2.0 * sin2], axis=-1)


def _spring(twist: Array, slopes: Array, knees: tuple[float, float]) -> Array:
    """Torque of a spring [N m] whose slopes change at two torques; what slopes are not given are the last
    one's."""
    first, second, third = (slopes[min(k, len(slopes) - 1)] for k in range(3))
    bend = knees[0] / first
    size = np.abs(twist)
    width = (knees[1] - knees[0]) / second
    between = np.clip(size - bend, 0.0, width)
    above = np.maximum(size - bend - width, 0.0)
    return np.copysign(first * np.minimum(size, bend) + second * between + third * above, twist)


@njit
def _hysteresis(twist: Array, rise: float) -> Array:
    """Share of the largest torque of a hysteresis along a twist [rad] that starts without, see `slip`."""
    shares = np.zeros(len(twist))
    for k in range(1, len(twist)):
        shares[k] = slip(shares[k - 1], twist[k] - twist[k - 1], 1.0, rise)
    return shares
