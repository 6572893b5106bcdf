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
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

from polish_sim.arrays import Array, Bools, Indices, running_sums, two_waves
from polish_sim.cell.gears import slip
from polish_sim.cell.real_arm import gear_stiffness, lost_torque
from polish_sim.config import RealArmConfig
from polish_sim.identification.estimate import INTERVAL_95, TURNING, inverse_of, spread_of_sums
from polish_sim.identification.log_file import LoggedGears, RobotLog
from polish_sim.identification.physical import ParameterRow
from polish_sim.kernel_cache import njit

LOW_PASS_HZ = 30.0  #: For the speeds that show where motors turn back, and where torques' noise is unknown
#: Low-pass of the twists: the encoders' steps, added up, would lengthen the way of the hysteresis
TWIST_HZ = 140.0
SAMPLED_HZ = 100.0  #: Rate of the samples that are fitted
BLOCK_S = 0.2  #: How long residuals may be alike, and from period to period
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
                f"{_NAMES[k]}{j + 1}", self.values[j, k], _UNITS[k], self.std[j, k],
                "no" if math.isnan(self.values[j, k]) else "gear", self.truth[j, k],
            )
            for k in chosen for j in range(len(self.values))
        ]  # fmt: skip

    def errors(self) -> Array:
        """Factors of the gears' errors, shape (n, 4) [rad], 0 where none is seen."""
        return np.nan_to_num(self.values[:, _ERRORS])

    def damping(self) -> Array:
        """Damping of the gears [N m s/rad], shape (n,), 0 where it may be none."""
        D = self.values[:, 5]
        return np.where(INTERVAL_95 * self.std[:, 5] < D, D, 0.0)

    def torques(self, real: RealArmConfig, sides: LoggedGears, dt: float) -> Array:
        """What the gears' springs, hysteresis and damping pass on, (m, n) [N m]; NaN where no slope is
        known."""
        torques = np.full(sides.motor.shape, np.nan)
        for j in np.flatnonzero(np.isfinite(self.values[:, _FIRST])):
            x = self.values[j]
            x = np.append(np.nan_to_num(x[:_FIRST]), x[_FIRST:][np.isfinite(x[_FIRST:])])
            error = two_waves(2.0 * real.gear_ratio * sides.motor[:, j])
            knees = real.knee_1_nm[j], real.knee_2_nm[j]
            turned = sides.motor[:, j] - sides.link[:, j]
            rest, damped = _passed_on(x, turned, error, knees, real.lost_motion_rise_rad, dt)
            torques[:, j] = rest + damped
        return torques

    def with_loads(self, loads: Array, std: Array) -> GearFit:
        """The same with shares of friction by load found otherwise, shape (n, 2) each."""
        values, deviations = self.values.copy(), self.std.copy()
        values[:, _LOADS], deviations[:, _LOADS] = loads, std
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
            "friction_by_load": self.values[:, _LOADS],
            "friction_by_load_std": self.std[:, _LOADS],
            "gear_stiffness_nm_rad": K,
            "gear_stiffness_std_nm_rad": std,
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
    values, std = np.full((2, log.q.shape[1], len(_NAMES)), np.nan)
    for j in range(len(values)):
        x, deviation = _fit_gear(log, real, period, j)
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
    friction = warm * np.array([real.viscous_nm_s_rad, real.coulomb_nm])
    driven = [
        real.rotor_kg_m2,
        *friction,
        np.tile(load, (n, 1)),
        real.damping_nm_s_rad,
        lost_torque(real),
        np.full((n, 5), np.nan),
    ]
    return np.column_stack([*driven, *gear_stiffness(real)])


def _fit_gear(log: RobotLog, real: RealArmConfig, period: float, j: int) -> tuple[Array, Array]:
    """Numbers of one gear and their standard deviations, as many as slopes are reached, shape (13,) to (15,)
    each."""
    assert log.gears is not None
    dt, rise = float(np.mean(np.diff(log.time))), real.lost_motion_rise_rad
    knees = real.knee_1_nm[j], real.knee_2_nm[j]
    smooth = partial(sosfiltfilt, butter(2, 2.0 * LOW_PASS_HZ * dt, output="sos"))
    angle = log.gears.motor[:, j]
    turned = sosfiltfilt(butter(8, 2.0 * TWIST_HZ * dt, output="sos"), angle - log.gears.link[:, j])
    speed = np.gradient(smooth(angle), dt)
    acceleration, measured = np.gradient(speed, dt), smooth(log.torque[:, j])
    waves = 2.0 * real.gear_ratio
    error, error_slope = two_waves(waves * angle), waves * slope_of(waves * angle)
    # What counts: the motor does not reverse within the low-pass's reach.
    ends = round(_ENDS_S / dt)
    counts = off_turns(speed, dt)
    counts[:ends] = counts[-ends:] = False
    counts &= np.cumsum(np.abs(np.diff(turned, prepend=turned[0]))) > FORGOTTEN * rise
    every = max(1, round(1.0 / (SAMPLED_HZ * dt)))
    rows = np.flatnonzero(counts[::every]) * every

    def left(x: Array) -> Array:
        """Torque less that of the numbers, low-passed [N m], of the samples that are fitted."""
        torque, damped = _passed_on(x, turned, error, knees, rise, dt)
        load = np.where(torque * speed > 0.0, x[3], x[4]) * np.abs(torque)
        passed = (1.0 + error_slope @ x[_ERRORS]) * (torque + damped)
        given = x[0] * acceleration + x[1] * speed + smooth(np.sign(speed) * (x[2] + load) + passed)
        return (measured - given)[rows]

    # It starts from a linear fit, with as many equal slopes as its torques reach.
    parts = (acceleration, speed, smooth(np.sign(speed)), smooth(turned), np.ones_like(measured))
    columns = np.column_stack(parts)[rows]
    inertia, viscous, dry, K, rest = np.linalg.lstsq(columns, measured[rows], rcond=None)[0]
    K = max(K, 1e3)
    largest = np.abs(K * columns[:, 3] + rest).max()
    slopes = 1 + sum(largest > SEEN * knee for knee in knees)
    start = np.array([inertia, viscous, dry, 0.0, 0.0, 0.0, 0.0, -rest / K, *[0.0] * 4, *[K] * slopes])
    least = np.where(np.arange(len(start)) < _FIRST, -np.inf, 1.0)
    scale = _TYPICAL[: len(start)]
    found = least_squares(left, start, bounds=(least, np.inf), x_scale=scale, max_nfev=20)
    blocks = (log.time[rows] % period / BLOCK_S).astype(np.int64)
    return found.x, _deviations(found.jac, found.fun, blocks)


def _deviations(slopes: Array, left: Array, blocks: Indices) -> Array:
    """Standard deviations of a fit whose residuals may be alike within a block."""
    size = np.linalg.norm(slopes, axis=0)
    deviations, seen = np.full(len(size), np.inf), size > 0.0
    if np.linalg.cond(slopes[:, seen] / size[seen]) <= CONFOUNDED:
        slopes = slopes[:, seen]
        C = inverse_of(slopes.T @ slopes)
        deviations[seen] = np.sqrt(np.diag(C @ spread_of_sums(slopes * left[:, None], blocks) @ C))
    return deviations


def off_turns(speed: Array, dt: float) -> Bools:
    """Where a motor of a speed (m,) [rad/s] does not turn back within the reach of the low-pass."""
    reach = round(0.5 / LOW_PASS_HZ / dt)
    return np.convolve(np.abs(speed) < TURNING, np.ones(2 * reach + 1), "same") < 0.5


def slope_of(phase: Array) -> Array:
    """Slopes of `two_waves` by phases (...), shape (..., 4)."""
    sin, cos, sin2, cos2 = np.moveaxis(two_waves(phase), -1, 0)
    return np.stack([cos, -sin, 2.0 * cos2, -2.0 * sin2], axis=-1)


def _passed_on(
    x: Array, turned: Array, error: Array, knees: tuple[float, float], rise: float, dt: float
) -> tuple[Array, Array]:
    """What a gear's spring and hysteresis pass on, and what its damping does, (m,) [N m] each, by its numbers
    ``x``; ``turned``: motor less link [rad]."""
    twist = turned - x[7] + error @ x[_ERRORS]
    torque = _spring(twist, x[_FIRST:], knees) + x[6] * _hysteresis(twist, rise)
    return torque, x[5] * np.gradient(twist, dt)


def _spring(twist: Array, slopes: Array, knees: tuple[float, float]) -> Array:
    """Torque of a spring [N m] whose slopes change at two torques; what slopes are not given are the last
    one's."""
    torques = np.array([0.0, *knees, 1e6])  # the last one is out of reach
    twists = running_sums(np.diff(torques) / slopes[np.minimum(range(3), len(slopes) - 1)])
    return np.copysign(np.interp(np.abs(twist), twists, torques), twist)


@njit
def _hysteresis(twist: Array, rise: float) -> Array:
    """Share of the largest torque of a hysteresis along a twist [rad] that starts without, see `slip`."""
    shares = np.zeros(len(twist))
    for k in range(1, len(twist)):
        shares[k] = slip(shares[k - 1], twist[k] - twist[k - 1], 1.0, rise)
    return shares
