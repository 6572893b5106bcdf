"""Logs of a robot: joint positions and torques over time, simulated or from a CSV that is checked.

Columns ``time_s``, and for joint 1 ``q1_rad``, ``torque1_nm`` (of a slide ``q1_m``, ``force1_n``) and so on;
others are left out.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_lsq_spline

from polish_sim.arms import arm_table
from polish_sim.arrays import Array, Indices
from polish_sim.errors import InputError
from polish_sim.exchange.robot_log import HOW_TO_MAP, RobotRecording
from polish_sim.identification.fourier import fit_fourier
from polish_sim.identification.regressor import States
from polish_sim.motion.serial_chain import HINGE
from polish_sim.tables import Columns, Place, refuse_first

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


TURN = 2.0 * np.pi
_GAP = 3.0  #: Steps longer than this many usual ones are gaps
#: Between two samples, at most: splines with a knot every 0.05 s need more of them than knots
_SLOWEST_S = 0.02
#: Share of samples at exactly the largest torque from which a drive is taken as saturated
_FLAT = 0.01
#: Samples at the largest torque by those at the next smaller: saturation, not coarse steps
_PILED = 3.0
_LEAST_SAMPLES = 500
_ARM = (HINGE,) * 6


def log_columns(kinds: Sequence[int]) -> tuple[list[str], list[str]]:
    """Names of the columns of positions and of torques for joints of these kinds (HINGE or SLIDE)."""
    q = [f"q{j}_{'rad' if kind == HINGE else 'm'}" for j, kind in enumerate(kinds, 1)]
    torque = [f"torque{j}_nm" if kind == HINGE else f"force{j}_n" for j, kind in enumerate(kinds, 1)]
    return q, torque


def read_robot_log(
    file: Path, kinds: Sequence[int] = _ARM, period: float | None = None, joints: Sequence[str] = ()
) -> RobotLog:
    """Read a log and refuse what would spoil an identification.

    Args:
        file: The CSV.
        kinds: HINGE or SLIDE, joint by joint, shape (n,).
        period: After which the motion repeats [s], if it does: then gaps do no harm.
        joints: Names of the joints in a user's model, shape (n,), to name those of a log that has fewer.

    Raises:
        InputError: A column or a value is missing, time does not increase or is in other units, there are
            gaps, the period does not fit, angles look like degrees, a torque is saturated; names the place.
    """
    q_names, torque_names = log_columns(kinds)
    columns = Columns.read(file, "sample", "joint positions and torques over time")
    names = ["time_s", *q_names, *torque_names]
    _check_joints(file, columns.texts, kinds, joints)
    columns.need(names)
    values = columns.numbers(names)
    log = RobotLog(values[:, 0], values[:, 1 : 1 + len(kinds)], values[:, 1 + len(kinds) :])
    _check_count(file, log.time)
    refuse_first(
        np.diff(log.time, prepend=-np.inf) <= 0.0, file, columns.place,
        lambda row: f"time_s does not increase ({log.time[row]:g} after {log.time[row - 1]:g}). Sort the "
        "samples and leave double ones out.",
    )  # fmt: skip
    if period is None:
        _check_steps(file, log.time, columns.place)
    else:
        _check_period(file, log.time, period)
    _check_units(file, log, q_names)
    _check_saturation(file, log, torque_names)
    return log


def log_of_arm(file: Path, arm: str, recording: RobotRecording) -> RobotLog:
    """The joints and torques, or currents, that a make of arm recorded; ``file`` is named in errors.

    Raises:
        InputError: It has neither torques nor currents, too few samples, or drives that stood at their limit.
    """
    torque = recording.torques(arm_table(arm).torque_constants)
    if not len(torque):
        raise InputError(f"'{file}' has neither torque_nm nor current_a. {HOW_TO_MAP}")
    _check_count(file, recording.time)
    log = RobotLog(recording.time, recording.values["q_rad"], torque)
    _check_saturation(file, log, log_columns(_ARM)[1])
    return log


def _check_count(file: Path, time: Array) -> None:
    if len(time) < _LEAST_SAMPLES:
        raise InputError(
            f"'{file}' holds {len(time)} samples; an identification takes at least {_LEAST_SAMPLES}, "
            "better 10 s at 250 Hz or more."
        )


def _check_joints(file: Path, columns: Collection[str], kinds: Sequence[int], joints: Sequence[str]) -> None:
    """Refuse a model with joints after the log's last one, and name the joints to take."""
    pairs = zip(*log_columns(kinds), strict=True)
    logged = [q in columns and torque in columns for q, torque in pairs]
    first = sum(logged)
    if 0 < first < len(joints) and all(logged[:first]):
        raise InputError(
            f"'{file}' has columns of the first {first} of the model's {len(joints)} joints, none of "
            f"{', '.join(joints[first:])}. If these stand still, add --joints {','.join(joints[:first])}."
        )


def _check_steps(file: Path, time: Array, place: Place) -> None:
    """Samples close enough, and none missing, for splines."""
    step = np.diff(time)
    usual = np.median(step)
    if usual > 1.001 * _SLOWEST_S:
        raise InputError(
            f"'{file}': samples are {usual:.3g} s apart. Are these milliseconds? Give seconds, "
            f"{1.0 / _SLOWEST_S:.0f} samples a second or more."
        )
    gaps = np.append(False, step > _GAP * usual)
    refuse_first(
        gaps, file, place,
        lambda row: f"a gap of {step[row - 1]:.3g} s, {gaps.sum()} in all; samples are {usual:.3g} s apart. "
        "Accelerations are unknown across a gap: log without, or give --period if the motion repeats.",
    )  # fmt: skip


def _check_period(file: Path, time: Array, period: float) -> None:
    """A whole period in the log, and more samples in it than the series has coefficients."""
    usual = float(np.median(np.diff(time)))
    span = float(time[-1] - time[0])
    least = (2 * HARMONICS_FITTED + 1) * usual
    if period > span + _GAP * usual:
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


def _check_units(file: Path, log: RobotLog, names: Sequence[str]) -> None:
    far = np.abs(log.q).max(axis=0) * [name.endswith("_rad") for name in names]
    if np.any(far > 1.05 * TURN):
        joint = int(np.argmax(far))
        raise InputError(
            f"'{file}': {names[joint]} reaches {far[joint]:.4g}, more than a turn. Are these degrees? Give "
            "radians; of a joint that has turned further subtract whole turns."
        )


def _check_saturation(file: Path, log: RobotLog, names: Sequence[str]) -> None:
    for name, torque in zip(names, np.abs(log.torque).T, strict=True):
        if np.ptp(torque) == 0.0:
            raise InputError(
                f"'{file}': {name} is {torque[0]:g} in every sample: log the torques the joints took."
            )
        levels, counts = np.unique(torque, return_counts=True)
        piled = counts[-1] > _PILED * counts[-2]
        if piled and counts[-1] > _FLAT * len(torque):
            raise InputError(
                f"'{file}': {name} stands at {levels[-1]:.4g} in {100 * counts[-1] / len(torque):.0f}% of "
                "the samples: the drive is saturated there and the model does not hold. Move more slowly."
            )
