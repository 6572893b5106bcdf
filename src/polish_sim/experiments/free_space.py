"""The robot in free space: a cell without a part, poses it visits to stand still and read its sensor, and the
experiment ``arc``, the tool point on a circle at constant feed (paper 1, fig. 12).

Log and common figures of an arm whose runs the cell's loop does not record, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.analysis.metrics import PAPER_ARC, measure_arc
from polish_sim.arrays import Array, norms, turned
from polish_sim.calibration import PayloadReadings
from polish_sim.calibration.payload import move, move_time
from polish_sim.cell import SILENT, Cell, CellRun, Observer, Stroke, build_scene, no_part, tool_on_flange
from polish_sim.cell.stroke import feed_pace
from polish_sim.config import Checked, PayloadConfig, RobotConfig, Scenario
from polish_sim.control import build_controller
from polish_sim.errors import CalibrationError, ProtectiveStop
from polish_sim.experiments.assembly import kept_place
from polish_sim.experiments.beliefs import believe_tool, believed_arm
from polish_sim.experiments.part_setup import random_streams
from polish_sim.experiments.placement import check_whole_path, find_reach
from polish_sim.experiments.registry import CheckedPath
from polish_sim.experiments.result import RunResult, common_figures
from polish_sim.log import COLUMNS, LOG_ROW, RunLog, Trace, from_rows, with_column
from polish_sim.motion import forward
from polish_sim.motion.trajectory import PathTable, build_path_table, time_path
from polish_sim.planning.toolpath import PROCESS, ToolPath, arc_length
from polish_sim.spatial import matrices, wxyz


class ToolMotion(NamedTuple):
    """What the tool did and what it was to do, base frame; n instants."""

    tips: Array  #: Tool points [m], shape (n, 3)
    frames: Array  #: R_base_tool, shape (n, 3, 3)
    speed: Array  #: [m/s], shape (n,)
    wanted: Array  #: Targets [m], shape (n, 3)
    wanted_frames: Array  #: Shape (n, 3, 3)

    def columns(self) -> dict[str, Array]:
        """Columns of the log."""
        return {
            "tcp_position_m": self.tips,
            "tcp_quaternion_wxyz": wxyz(self.frames),
            "target_position_m": self.wanted,
            "target_quaternion_wxyz": wxyz(self.wanted_frames),
            "tcp_speed_m_s": self.speed,
        }

    def trace(self, time: Array, phase: NDArray[Any], place: Array, across: Array | None = None) -> Trace:
        """The exact trace, with no contact; ``place``: arc length [m], (n,); ``across``: part of the error
        across the target's axis [m], (n, 3), all of it if not given."""
        off = self.wanted - self.tips
        nothing = np.zeros(len(time))
        still = np.zeros_like(off)
        turned = Rotation.from_matrix(self.wanted_frames) * Rotation.from_matrix(self.frames).inv()
        far, aside = (norms(error) for error in (off, off if across is None else across))
        return Trace(
            time, phase.astype(np.int8), nothing, far, aside, turned.magnitude(), self.tips, self.speed,
            place, still, nothing, nothing, off, still,
        )  # fmt: skip


def free_log(
    scenario: Checked, played: Sequence[Any], columns_of: Callable[[Any, int, int, bool], dict[str, Array]]
) -> RunLog:
    """One log of what was ``played``, one after the other, each at its own time from 0.

    ``columns_of`` gives columns of the log by name, (n,) or (n, k), those of ``log.LATER`` last, of one of
    them, its number, steps a row, and whether the arm is a real one; what is not there is zero.
    """
    parts = [
        columns_of(play, number, scenario.simulation.log_every, scenario.robot.elastic)
        for number, play in enumerate(played)
    ]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    rows = np.zeros(len(columns["time_s"]), LOG_ROW)
    for name in COLUMNS:
        if name in columns:
            rows[name] = columns.pop(name)
    log = from_rows(rows)
    for name, values in columns.items():
        log = with_column(log, name, values)
    return log


CLOCK_FEED = 0.1  #: Length of the path that stands for a second [m], standing still included
ROW_S = 0.01  # between rows of the path [s]
START_S = 0.5  # until the path's clock has come up to speed [s]
#: Acceleration limits of the robot with which it keeps up [m/s^2, rad/s^2]
USUAL_LINEAR, USUAL_ANGULAR = 1.2, 3.0
AT_REST_RAD_S = 2e-3  #: No joint may be faster while the sensor is read


def free_cell(
    scenario: Scenario, table: PathTable, feed: float, q_start: Array, rng: np.random.Generator
) -> Cell:
    """A cell without a part whose tool moves along a table at a feed [m/s]."""
    start, pace = build_path_table(table.positions[:1], matrices(table.quaternions[:1])), feed_pace(feed)
    stroke = Stroke(
        travel=time_path(start, pace),
        lead_in=start,
        process=table,
        motion=time_path(table, pace),
        force=np.zeros(len(table.positions)),
        approach_speed=feed,
        feed=feed,
        hold=0.0,
        feed_time=scenario.process.max_feed_s or math.inf,
    )
    return Cell(
        scenario, build_scene(scenario), no_part(), [stroke], q_start,
        build_controller(scenario.controller), rng,
        known=believed_arm(scenario, q_start),
    )  # fmt: skip


class Visit(NamedTuple):
    """The way through some poses and when the robot stands still in each."""

    table: PathTable
    windows: Array  #: First and last place of the path at which readings are averaged [m], shape (n, 2)


def plan_visit(q: Array, payload: PayloadConfig, robot: RobotConfig) -> Visit:
    """A way through poses ``q`` (n, 6) [rad] in time, standing still in each as the ``payload`` is to be
    calibrated; a robot with low acceleration limits gets longer for its ways."""
    settle, average = payload.settle_s, payload.average_s
    linear, angular = robot.linear_acceleration_m_s2, robot.angular_acceleration_rad_s2
    patience = math.sqrt(max(1.0, USUAL_LINEAR / linear, USUAL_ANGULAR / angular))
    rows, windows, now = [q[:1]], [], START_S
    times: list[Array] = [np.zeros(1)]
    for k, pose in enumerate(q):
        if k:
            duration = patience * move_time(q[k - 1], pose)
            share = np.linspace(0.0, 1.0, max(2, math.ceil(duration / ROW_S)))[1:]
            rows.append(move(q[k - 1], pose, share))
            times.append(now + duration * share)
            now += duration
        still = np.arange(1, max(2, math.ceil((settle + average) / ROW_S)) + 1) * ROW_S
        rows.append(np.tile(pose, (len(still), 1)))
        times.append(np.asarray(now + still))
        windows.append([now + settle, now + settle + average])
        now = times[-1][-1]
    T_base_tool = forward(np.concatenate(rows)) @ tool_on_flange()
    place = CLOCK_FEED * np.concatenate(times)
    table = build_path_table(
        T_base_tool[:, :3, 3], T_base_tool[:, :3, :3], place, spacing=0.5 * CLOCK_FEED * ROW_S
    )
    return Visit(table, CLOCK_FEED * np.array(windows))


def visiting_cell(scenario: Scenario, visit: Visit, q_start: Array, rng: np.random.Generator) -> Cell:
    """A cell in free space, spindle off, whose host compensates nothing: it reads the sensor as it is.

    There is nothing to press on, and no limit on a force that is the weight of a tool not known yet.
    """
    free = replace(
        scenario,
        process=replace(scenario.process, max_feed_s=0.0),
        pad=replace(scenario.pad, damping_s_m=0.0),
        spindle=replace(scenario.spindle, speed_rpm=0.0),
        safety=replace(scenario.safety, force_limit_n=1e4, torque_limit_nm=1e3),
    )
    cell = free_cell(free, visit.table, CLOCK_FEED, q_start, rng)
    cell.compensate(0.0, np.zeros(3))
    return cell


def run_visit(cell: Cell, visit: Visit, observer: Observer) -> tuple[CellRun, PayloadReadings]:
    """Visit the poses and average the readings in each.

    Raises:
        ProtectiveStop: The robot stopped on its way.
        CalibrationError: It did not stand still where readings were taken.
        KeyboardInterrupt: The user broke off.
    """
    run = cell.run(observer)
    if run.interrupted:
        raise KeyboardInterrupt
    if run.stop_reason:
        raise ProtectiveStop(f"protective stop on the way through the poses: {run.stop_reason}.")
    place = run.log["path_s_m"]
    log = run.log
    # A host that computes with its own table believes to be where it has steered the tool to.
    frame = "target_quaternion_wxyz" if cell.real_arm.elastic else "tcp_quaternion_wxyz"
    times, frames, means = [], [], []
    for number, (first, last) in enumerate(visit.windows, 1):
        rows = (place >= first) & (place <= last)
        if not rows.any():
            raise CalibrationError(
                f"no row of the log is in the {(last - first) / CLOCK_FEED:.3g} s of readings in pose "
                f"{number}. Raise payload.average_s or simulation.log_rate_hz."
            )
        speed = np.abs(log["qd_rad_s"][rows]).max()
        if speed > AT_REST_RAD_S:
            raise CalibrationError(
                f"the arm did not stand still in pose {number}: a joint still moved at {speed:.2g} rad/s. "
                "Raise payload.settle_s."
            )
        times.append(log["time_s"][rows].mean())
        frames.append(log[frame][rows][-1])
        means.append(log["wrench_measured_tool"][rows].mean(axis=0))
    R_base_sensor = matrices(np.array(frames))
    return run, PayloadReadings(np.array(times), R_base_sensor, _at_sensor(cell, np.array(means)))


def _at_sensor(cell: Cell, tared: Array) -> Array:
    """What the sensor read, from the host's tared wrenches about the tool point, shape (n, 6)."""
    found = tared + cell.state.sensor.tare
    found[:, 3:] += np.cross(cell.carried.lever, found[:, :3])
    return found


TOOL_AXIS = np.array([0.0, 0.0, 1.0])  # the tool points straight down [-]


def arc_path() -> ToolPath:
    """The circle of paper 1, once round, in the base frame, starting at its horizontal extreme."""
    points, normal, center = 1257, PAPER_ARC.normal, PAPER_ARC.center
    across = np.array([-normal[1], normal[0], 0.0])
    angle = np.linspace(0.0, 2.0 * math.pi, points)
    positions = center + PAPER_ARC.radius * turned(across, np.cross(normal, across), angle)
    return ToolPath(
        positions,
        np.tile(TOOL_AXIS, (points, 1)),
        arc_length(positions),
        np.zeros(points, np.int64),
        np.full(points, PROCESS, np.int8),
        np.zeros(points),
    )


def prepare_arc(scenario: Checked, observer: Observer = SILENT) -> CheckedPath:
    """Check that the arm can do the circle, which is the same in every scenario.

    Raises:
        ReachError: If it cannot; names the first bad point.
    """
    return kept_place(scenario, _circle)


def _circle() -> CheckedPath:
    path = arc_path()
    reach = find_reach(path.positions_work, path.axes_work, [np.eye(4)], above_table=False)
    check_whole_path(reach, path.positions_work, path.axes_work)
    return CheckedPath(path, reach)


def run_arc(scenario: Checked, observer: Observer = SILENT) -> RunResult:
    """Follow the circle and measure speed and distance from it; part, plan, pad and spindle play no role.

    Raises:
        ReachError: If the arm cannot do the circle.
    """
    path, reach, _ = prepare_arc(scenario)
    table = build_path_table(path.positions_work, reach.rotations(path.axes_work))
    free = replace(scenario, spindle=replace(scenario.spindle, speed_rpm=0.0))
    observer.stage("simulate")
    rng = np.random.default_rng(scenario.seed)
    cell = free_cell(free, table, scenario.process.feed_m_s, reach.q_start, rng)
    believe_tool(cell, random_streams(scenario.seed).payload)
    run = cell.run(observer)
    done = run.trace.path_s_m[-1] / table.length
    figures = measure_arc(run.trace) | common_figures(cell, run, done, None)
    return RunResult(
        scenario, run.log, run.trace, figures, path, None,
        run.files,
    )  # fmt: skip
