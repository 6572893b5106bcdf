"""The motion an identified model will be used for: a run's log, a teaching motion, or a path at its feed."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

import numpy as np

from polish_sim.arrays import Array, joined, norms, running_sums
from polish_sim.config import ProcessConfig
from polish_sim.errors import InputError
from polish_sim.exchange.formats import read_way_points
from polish_sim.exchange.robot_log import ColumnMap, columns_of, read_robot_recording
from polish_sim.experiments.placement import default_placements
from polish_sim.identification.log_file import RobotLog, spline_states
from polish_sim.identification.regressor import States
from polish_sim.log import UNREADABLE
from polish_sim.planning.toolpath import interpolate
from polish_sim.smoothing.place import distinct_rows, follow_path

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
    moves = [_states_of(time, q) for time, q in _moves(source)]
    states = States(*joined(moves))
    count = len(states.q)
    return states.rows(np.unique(np.linspace(0, count - 1, _MOST).astype(np.int64)))


def _moves(source: Path) -> list[tuple[Array, Array]]:
    """Moves one after the other, each with times of its own; those a run broke off at their first pose left
    out."""
    time, q, case = _joints_over_time(source)
    moves = [(time[case == k], q[case == k]) for k in np.unique(case)]
    moves = [move for move in moves if len(move[0]) >= _POSES]
    if not moves or any(np.any(np.diff(of_move) <= 0.0) for of_move, _q in moves):
        raise InputError(f"'{source}' holds no motion: wanted two poses or more, time_s increasing.")
    return moves


def _states_of(time: Array, q: Array) -> States:
    count = int(np.clip((time[-1] - time[0]) / _SAMPLE_S, _LEAST, _SAMPLES))
    even = np.linspace(time[0], time[-1], count)
    between = interpolate(even, time, q)
    knots = _KNOTS * float(even[1] - even[0])
    return spline_states(RobotLog(even, between, np.zeros_like(between)), knots)


def _joints_over_time(source: Path) -> tuple[Array, Array, Array]:
    """Times (m,), positions (m, 6), and which move each row is of (m,)."""
    for name in LOGS:
        if (source / name).is_file():
            return _from_npz(source / name)
    if source.suffix == ".npz":
        return _from_npz(source)
    if source.is_file() and source.suffix == ".csv" and _names_joints(source):
        columns = ColumnMap({}, {}, {"q_rad": columns_of((0,) * JOINTS).wanted["q_rad"]})
        log = read_robot_recording(source, ("q_rad",), columns, of_gap=None)
        return log.time, log.values["q_rad"], np.zeros(len(log.time))
    time, q = _along_path(source)
    return time, q, np.zeros(len(time))


def _names_joints(file: Path) -> bool:
    return "q1_rad" in file.read_text(encoding="utf-8", errors="replace").lower()


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


def _along_path(source: Path) -> tuple[Array, Array]:
    """The arm along a path laid before it, at the path's feed or the default one."""
    points = read_way_points(source)
    rows = distinct_rows(points)
    positions = points.path.positions_work[rows]
    placements = default_placements(positions, np.array([0.0, 0.0, 1.0]), float(positions[:, 2].min()))
    _reach, way, q = follow_path(points, rows, placements, "or give a log", "Give a log instead.")
    feed = points.path.feeds(ProcessConfig().feed_m_s)[rows]
    steps = norms(np.diff(way.positions, axis=0)) / feed[way.ends[1:]]
    return running_sums(np.maximum(steps, _TURN_S)), q
