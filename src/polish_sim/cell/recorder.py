"""What is kept of a run: packed rows for the log, and the exact quantities of every step for the figures."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.kernel import CellKernel
from polish_sim.cell.stroke import depth_below
from polish_sim.control.signals import Target
from polish_sim.kernels import Bundle, Record, Vector2, Vector3, dot, kernel, minus, set_to
from polish_sim.log import Trace, row_layout, row_width
from polish_sim.spatial import quaternion_from_rotation, rotation_angle

ROW_WIDTH = row_width()
_AT = {name: start for name, (start, _width) in row_layout().items()}
# Constants, because a compiled kernel cannot read a dictionary.
_TIME, _Q, _QD, _TORQUE = _AT["time_s"], _AT["q_rad"], _AT["qd_rad_s"], _AT["torque_nm"]
_POSITION, _QUATERNION = _AT["tcp_position_m"], _AT["tcp_quaternion_wxyz"]
_TARGET_POSITION, _TARGET_QUATERNION = _AT["target_position_m"], _AT["target_quaternion_wxyz"]
_DEPTH, _SPEED, _COMMAND = _AT["host_depth_m"], _AT["tcp_speed_m_s"], _AT["command_twist"]
_MEASURED, _RAW, _TRUE = _AT["wrench_measured_tool"], _AT["wrench_raw_sensor"], _AT["wrench_true_tool"]
_FORCE, _FORCE_MIN, _FORCE_MAX = _AT["normal_force_n"], _AT["normal_force_min_n"], _AT["normal_force_max_n"]
_TRAVEL, _PATH, _PASS, _PHASE = _AT["pad_travel_m"], _AT["path_s_m"], _AT["pass_index"], _AT["phase"]


class TraceStep(Record):
    """Exact quantities of one step, see `Trace`."""

    time_s: float
    phase: int
    normal_force_n: float
    position_error_m: float
    tangential_error_m: float
    orientation_error_rad: float
    tcp_position_m: Vector3
    tcp_speed_m_s: float
    path_s_m: float
    part_shift_m: Vector3
    pad_travel_m: float
    spindle_rad_s: float
    target_error_m: Vector3
    tool_on_part_m: Vector3


class Filled(Record):
    """How far the buffers of a chunk are filled."""

    rows: int
    steps: int
    first: int  #: Step of the trace at which the chunk begins
    force_range: Vector2  #: Least and largest force since the last row [N]


class Recorder(Bundle):
    """Buffers of one chunk of steps."""

    rows: Array  #: Packed log rows and what a branch adds behind each, shape (k, ROW_WIDTH + extra)
    trace: NDArray[np.void]  #: ``TraceStep`` of every step, shape (steps,)
    every: int  #: Steps per row
    filled: Filled


def build_recorder(steps: int, every: int, extra: int = 0) -> Recorder:
    """Buffers for chunks of at most ``steps`` steps, a row every ``every`` steps, ``extra`` columns behind
    the log's own.
    """
    rows, trace = np.zeros((steps // every + 2, ROW_WIDTH + extra)), np.zeros(steps, TraceStep.dtype)
    return Recorder(rows, trace, every, Filled(force_range=(np.inf, -np.inf)))


@kernel
def put(row: Array, start: int, values: Array, count: int) -> None:
    """Copy by hand: a slice assignment would compile a shape check with its message, seconds of it."""
    for i in range(count):
        row[start + i] = values[i]


@kernel
def record_state(
    recorder: Recorder, cell: CellKernel, seen: Array, R_seen: Array, speed: float, t: float, phase: int
) -> None:
    """Record the instant ``t`` [s], before the engine moves on; the sensor's raw reading follows in
    ``record_reading``.

    Errors are those of the tool at ``seen`` (3,) [m], ``R_seen`` (3, 3), with its ``speed`` [m/s]; ``phase``
    as in ``log.PHASES``.
    """
    e, state = cell.engine, cell.state
    filled = recorder.filled
    m = state.measurement
    target = state.target
    force = state.wrench[2]
    filled.force_range[0] = min(filled.force_range[0], force)
    filled.force_range[1] = max(filled.force_range[1], force)
    position, travel = e.site_xpos[e.tool_site], e.qpos[6]
    step = recorder.trace[filled.first + filled.steps]
    step.time_s, step.phase, step.normal_force_n = t, phase, force
    step.tcp_speed_m_s, step.path_s_m, step.pad_travel_m = speed, target.s, travel
    step.spindle_rad_s = state.spindle.speed
    set_to(step.part_shift_m, minus(cell.part.position, state.motion.rest))
    set_to(step.tcp_position_m, position)
    set_to(step.tool_on_part_m, state.tool_on_part)
    _trace_errors(step, seen, R_seen, target)
    filled.steps += 1
    if state.status.steps % recorder.every:
        return
    row = recorder.rows[filled.rows]
    row[_TIME] = t
    put(row, _Q, e.qpos, 6)
    put(row, _QD, e.qvel, 6)
    put(row, _POSITION, position, 3)
    quaternion_from_rotation(e.site_xmat[e.tool_site], row[_QUATERNION : _QUATERNION + 4])
    put(row, _TARGET_POSITION, target.position, 3)
    quaternion_from_rotation(target.rotation, row[_TARGET_QUATERNION : _TARGET_QUATERNION + 4])
    row[_DEPTH] = depth_below(target, m.position)
    row[_SPEED] = speed
    put(row, _COMMAND, state.speedl.twist, 6)
    put(row, _MEASURED, m.wrench, 6)
    put(row, _TRUE, state.wrench, 6)
    row[_FORCE], row[_FORCE_MIN], row[_FORCE_MAX] = force, filled.force_range[0], filled.force_range[1]
    row[_TRAVEL], row[_PATH], row[_PHASE] = travel, target.s, phase
    row[_PASS] = cell.stroke.process.pass_index[state.sequence.row]
    filled.force_range[0], filled.force_range[1] = math.inf, -math.inf
    filled.rows += 1


@kernel
def _trace_errors(step: TraceStep, position: Array, rotation: Array, target: Target) -> None:
    """Errors of the tool's pose, base frame: ``position`` (3,) [m], ``rotation`` (3, 3)."""
    off = minus(target.position, position)
    along, total = dot(off, target.rotation[:, 2]), dot(off, off)
    step.position_error_m = math.sqrt(total)
    step.tangential_error_m = math.sqrt(max(total - along * along, 0.0))
    step.orientation_error_rad = rotation_angle(rotation, target.rotation)
    set_to(step.target_error_m, off)


@kernel
def record_reading(recorder: Recorder, count: int, raw: Array, joint_torque: Array) -> None:
    """Add what the engine computes last to the row of this instant: exact sensor wrench and joint torques."""
    if count % recorder.every == 0:
        row = recorder.rows[recorder.filled.rows - 1]
        put(row, _RAW, raw, 6)
        put(row, _TORQUE, joint_torque, 6)


def trace_from(steps: NDArray[np.void]) -> Trace:
    """The columns of recorded steps, shape (n,) of ``TraceStep``."""
    trace = Trace(*(steps[name] for name in Trace._fields))
    return trace._replace(phase=trace.phase.astype(np.int8))
