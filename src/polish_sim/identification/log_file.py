"""Joint positions and torques over time, simulated or of a robot's log that an identification can take."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_lsq_spline

from polish_sim.arrays import Array, Indices
from polish_sim.errors import InputError
from polish_sim.exchange.log_sources import open_source
from polish_sim.exchange.robot_log import HOW_TO_MAP, RobotRecording, columns_of
from polish_sim.identification.fourier import fit_fourier
from polish_sim.identification.regressor import States

KNOTS_S = 0.05  #: Between two knots of a spline [s]
HARMONICS_FITTED = 20  #: Of the measured positions: four times what is commanded, for what the servos add


class LoggedGears(NamedTuple):
    """Both sides of elastic joints as their encoders read them, shape (m, n)."""

    motor: Array  #: [rad]
    link: Array  #: [rad]

    def rows(self, which: Indices | slice) -> LoggedGears:
        """Some of the samples."""
        return LoggedGears(self.motor[which], self.link[which])


class RobotLog(NamedTuple):
    """Equally long columns, one row a sample."""

    time: Array  #: [s], shape (m,)
    q: Array  #: Measured positions [rad], shape (m, n)
    torque: Array  #: Torques of the joints, gravity included [N m], shape (m, n)
    gears: LoggedGears | None = None  #: Where both sides of the gears are read


def periodic_states(log: RobotLog, period: float) -> States:
    """States of a log of a periodic motion: a Fourier series fitted to its positions, and that series'
    derivatives."""
    return fit_fourier(log.time, log.q, 1.0 / period, HARMONICS_FITTED)(log.time)


def with_noise(log: RobotLog, encoder: float, sigma: Array, rng: np.random.Generator) -> RobotLog:
    """The log as read by encoders with a step [rad] and torque sensors with white noise sigma (n,) [N m]."""
    torque = log.torque + rng.normal(size=log.torque.shape) * sigma
    return log._replace(q=read_by(log.q, encoder), torque=torque)


def read_by(angle: Array, step: float) -> Array:
    """Angles as encoders of a step read them [rad]; 0: exactly."""
    return np.asarray(np.round(angle / step) * step) if step > 0.0 else angle


def spline_states(log: RobotLog, knots: float | None = None) -> States:
    """States of any motion: derivatives of splines of degree five fitted to its positions.

    ``knots``: time between knots [s], by default ten samples and at least `KNOTS_S`; motion faster than about
    three of them is smoothed away.
    """
    knots = knots or max(KNOTS_S, 10.0 * float(np.median(np.diff(log.time))))
    span = log.time[-1] - log.time[0]
    inner = np.linspace(log.time[0], log.time[-1], max(int(span / knots), 2) + 1)[1:-1]
    t = np.concatenate([np.repeat(log.time[0], 6), inner, np.repeat(log.time[-1], 6)])
    spline = make_lsq_spline(log.time, log.q, t, k=5)
    return States(*(np.asarray(spline(log.time, nu=order)) for order in range(3)))


#: Between two samples, at most: splines with a knot every 0.05 s need more of them than knots
_SLOWEST_S = 0.02
#: Share of samples at exactly the largest torque from which a drive is taken as saturated
_FLAT = 0.01
#: Samples at the largest torque by those at the next smaller: saturation, not coarse steps
_PILED = 3.0
_LEAST_SAMPLES = 500


def check_joints(file: Path, run: str, kinds: Sequence[int], joints: Sequence[str]) -> None:
    """Refuse a log with our columns of the first of a model's ``joints`` only (InputError), and name those to
    take."""
    columns = {name.lower() for name in open_source(file, run).names}
    logged = [columns.issuperset(pair) for pair in zip(*columns_of(kinds).wanted.values(), strict=True)]
    first = sum(logged)
    if 0 < first < len(joints) and all(logged[:first]):
        raise InputError(
            f"'{file}' has columns of the first {first} of the model's {len(joints)} joints, none of "
            f"{', '.join(joints[first:])}. If these stand still, add --joints {','.join(joints[:first])}."
        )


def log_of(
    file: Path, recording: RobotRecording, period: float | None = None, constants: Sequence[float] = ()
) -> RobotLog:
    """What a robot recorded, refused if it would spoil an identification.

    Args:
        file: Named in errors.
        recording: Joints, and torques or currents.
        period: After which the motion repeats [s], if it does: then gaps do no harm.
        constants: Torques of a current [N m/A], shape (n,), if the make is known.

    Raises:
        InputError: There are no torques, few samples or slow ones, the period does not fit, a drive stood at
            its limit.
    """
    time, torque = recording.time, recording.torques(constants)
    if not len(torque):
        raise InputError(f"'{file}' has neither torque_nm nor, with --arm, current_a. {HOW_TO_MAP}")
    if len(time) < _LEAST_SAMPLES:
        raise InputError(
            f"'{file}' holds {len(time)} samples; an identification takes at least {_LEAST_SAMPLES}, "
            "better 10 s at 250 Hz or more."
        )
    usual = float(np.median(np.diff(time)))
    if period is not None:
        _check_period(file, time, period, usual)
    elif usual > 1.001 * _SLOWEST_S:
        raise InputError(
            f"'{file}': samples are {usual:.3g} s apart. Are these milliseconds? Give seconds, "
            f"{1.0 / _SLOWEST_S:.0f} samples a second or more."
        )
    _check_saturation(file, torque)
    return RobotLog(time, recording.values["q_rad"], torque)


def _check_period(file: Path, time: Array, period: float, usual: float) -> None:
    """A whole period in the log, and more samples in it than the series has coefficients."""
    span = float(time[-1])
    least = (2 * HARMONICS_FITTED + 1) * usual
    if period > span + 3.0 * usual:
        raise InputError(
            f"--period {period:g}: '{file}' holds {span:.4g} s, less than one period (s). Log a whole one, "
            "or leave --period out."
        )
    if period < least:
        raise InputError(
            f"--period {period:g}: samples of '{file}' are {usual:.3g} s apart, too few in a period. Give "
            f"the time (s, {least:.3g} or more here) after which the whole motion repeats, and time_s in "
            "seconds."
        )


def _check_saturation(file: Path, torques: Array) -> None:
    for joint, torque in enumerate(np.abs(torques).T, 1):
        what = f"'{file}': the torque of joint {joint}"
        if np.ptp(torque) == 0.0:
            raise InputError(f"{what} is {torque[0]:g} in every sample: log the torques the joints took.")
        levels, counts = np.unique(torque, return_counts=True)
        piled = counts[-1] > _PILED * counts[-2]
        if piled and counts[-1] > _FLAT * len(torque):
            raise InputError(
                f"{what} stands at {levels[-1]:.4g} in {100 * counts[-1] / len(torque):.0f}% of "
                "the samples: the drive is saturated there and the model does not hold. Move more slowly."
            )
