"""Motions in files: joint positions and torques over time, simulated or of a robot's log, to identify from;
and the motion an identified model will be used for, of a run's log, a teaching motion, or a path at its
feed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from zipfile import ZipFile

import numpy as np
from scipy.interpolate import make_lsq_spline

from polish_sim.arrays import Array, Indices, chord_lengths, joined, running_sums
from polish_sim.config import ProcessConfig
from polish_sim.errors import InputError
from polish_sim.exchange.formats import read_way_points
from polish_sim.exchange.log_sources import open_source
from polish_sim.exchange.robot_log import (
    HOW_TO_MAP,
    ColumnMap,
    RobotRecording,
    columns_of,
    read_robot_recording,
)
from polish_sim.experiments.placement import default_placements
from polish_sim.identification.excitation import fit_fourier
from polish_sim.identification.regressor import States
from polish_sim.log import UNREADABLE
from polish_sim.planning.toolpath import interpolate
from polish_sim.smoothing.place import distinct_rows, follow_path

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
    return (np.round(angle / step) * step) if step > 0.0 else angle


def spline_states(log: RobotLog, knots: float | None = None) -> States:
    """States of any motion: derivatives of splines of degree five fitted to its positions.

    ``knots``: time between knots [s], by default ten samples and at least `KNOTS_S`; motion faster than about
    three of them is smoothed away.
    """
    knots = knots or max(KNOTS_S, 10.0 * np.median(np.diff(log.time)))
    first, last = log.time[[0, -1]]
    even = np.linspace(first, last, max(int((last - first) / knots), 2) + 1)
    spline = make_lsq_spline(log.time, log.q, np.pad(even, 5, mode="edge"), k=5)
    return States(*(spline(log.time, nu=order) for order in range(3)))


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
    usual = np.median(np.diff(time))
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
    span = time[-1]
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


JOINTS = 6
LOGS = ("log.npz", "trajectory.npz")  #: Files of run folders that hold ``time_s`` and ``q_rad``
_SAMPLE_S = 0.02
_SAMPLES = 20_000
_KNOTS = 10.0  #: Samples between two knots of the spline that speeds and accelerations come from
_MOST = 2000
_POSES = 2  #: Of a move, at least
_LEAST = 50  #: Samples of the shortest motion
_TURN_S = 0.02  #: The least time between two poses of a path: where the tool only turns


def use_states(source: Path) -> States:
    """States of the motion an identified model is for, at most some two thousand of them.

    ``source``: a run folder, a log or trajectory (npz), a CSV of joint positions over time, or any path or
    plan. Raises InputError if it is none of these, ReachError, naming the place, if the arm cannot follow the
    path.
    """
    time, q, case = _joints_over_time(source)
    moves = [(time[case == k], q[case == k]) for k in np.unique(case)]
    moves = [move for move in moves if len(move[0]) >= _POSES]  # not one that a run broke off at its first
    if not moves or any(np.any(np.diff(of_move) <= 0.0) for of_move, _q in moves):
        raise InputError(f"'{source}' holds no motion: wanted two poses or more, time_s increasing.")
    states = States(*joined([_states_of(*move) for move in moves]))
    return states.rows(np.unique(np.linspace(0, len(states.q) - 1, _MOST).astype(np.int64)))


def _states_of(time: Array, q: Array) -> States:
    count = int(np.clip((time[-1] - time[0]) / _SAMPLE_S, _LEAST, _SAMPLES))
    even = np.linspace(time[0], time[-1], count)
    between = interpolate(even, time, q)
    return spline_states(RobotLog(even, between, np.zeros_like(between)), _KNOTS * (even[1] - even[0]))


def _joints_over_time(source: Path) -> tuple[Array, Array, Array]:
    """Times (m,), positions (m, 6), and which move each row is of (m,)."""
    for name in LOGS:
        if (source / name).is_file():
            return _from_npz(source / name)
    if source.suffix == ".npz":
        return _from_npz(source)
    if source.is_file() and source.suffix == ".csv" and b"q1_rad" in source.read_bytes().lower():
        columns = ColumnMap({}, {}, {"q_rad": columns_of((0,) * JOINTS).wanted["q_rad"]})
        log = read_robot_recording(source, ("q_rad",), columns, of_gap=None)
        return log.time, log.values["q_rad"], np.zeros(len(log.time))
    return _along_path(source)


def _from_npz(file: Path) -> tuple[Array, Array, Array]:
    try:
        with ZipFile(file), np.load(file, allow_pickle=False) as columns:
            time = columns["time_s"].astype(np.float64)
            q = columns["q_rad"].astype(np.float64)
            # A teaching run is several moves, the clock of each begins at 0.
            case = columns["case"].astype(np.float64) if "case" in columns else np.zeros(time.shape)
    except UNREADABLE as error:
        raise InputError(f"'{file}' holds no joint motion (time_s, q_rad): {error}.") from None
    if q.ndim != 2 or q.shape != (len(time), JOINTS):
        raise InputError(f"'{file}': q_rad is {q.shape}, time_s {time.shape}; wanted (n, {JOINTS}) and (n,).")
    if case.shape != time.shape:
        raise InputError(f"'{file}': case is {case.shape}, time_s {time.shape}; wanted as many of both.")
    return time, q, case


def _along_path(source: Path) -> tuple[Array, Array, Array]:
    """The arm along a path laid before it, at the path's feed or the default one."""
    points = read_way_points(source)
    rows = distinct_rows(points)
    positions = points.path.positions_work[rows]
    placements = default_placements(positions, np.array([0.0, 0.0, 1.0]), positions[:, 2].min())
    _reach, way, q = follow_path(points, rows, placements, "or give a log", "Give a log instead.")
    feed = points.path.feeds(ProcessConfig().feed_m_s)[rows]
    steps = chord_lengths(way.positions) / feed[way.ends[1:]]
    return running_sums(np.maximum(steps, _TURN_S)), q, np.zeros(len(q))
