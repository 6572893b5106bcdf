"""What is kept of a run: packed rows for the log, and the exact quantities of every step for the figures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.kernel import CellKernel
from polish_sim.cell.stroke import depth_below
from polish_sim.control.signals import Target
from polish_sim.kernels import Bundle, Record, Vector2, Vector3, dot, kernel, minus, set_to
from polish_sim.log import LOG_ROW, Trace
from polish_sim.spatial import quaternion_from_rotation, rotation_angle


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

    rows: NDArray[np.void]  #: ``LOG_ROW`` and what a branch adds to each, shape (k,)
    trace: NDArray[np.void]  #: ``TraceStep`` of every step, shape (steps,)
    every: int  #: Steps per row
    filled: Filled


def build_recorder(steps: int, every: int, row: Any = LOG_ROW) -> Recorder:
    """Buffers for chunks of at most ``steps`` steps, a ``row`` every ``every`` steps."""
    rows, trace = np.zeros(steps // every + 2, row), np.zeros(steps, TraceStep.dtype)
    return Recorder(rows, trace, every, Filled(force_range=(np.inf, -np.inf)))


@kernel
def put(out: Array, values: Array) -> None:
    """Copy six numbers by hand: a slice assignment would compile a shape check with its message, seconds of
    it."""
    for i in range(6):
        out[i] = values[i]


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
    row.time_s, row.phase, row.pass_index = t, phase, cell.stroke.process.pass_index[state.sequence.row]
    put(row.q_rad, e.qpos)
    put(row.qd_rad_s, e.qvel)
    set_to(row.tcp_position_m, position)
    quaternion_from_rotation(e.site_xmat[e.tool_site], row.tcp_quaternion_wxyz)
    set_to(row.target_position_m, target.position)
    quaternion_from_rotation(target.rotation, row.target_quaternion_wxyz)
    row.host_depth_m = depth_below(target, m.position)
    row.tcp_speed_m_s, row.pad_travel_m, row.path_s_m = speed, travel, target.s
    put(row.command_twist, state.speedl.twist)
    put(row.wrench_measured_tool, m.wrench)
    put(row.wrench_true_tool, state.wrench)
    row.normal_force_n = force
    row.normal_force_min_n, row.normal_force_max_n = filled.force_range[0], filled.force_range[1]
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
        put(row.wrench_raw_sensor, raw)
        put(row.torque_nm, joint_torque)


def trace_from(steps: NDArray[np.void]) -> Trace:
    """The columns of recorded steps, shape (n,) of ``TraceStep``."""
    trace = Trace(*(steps[name] for name in Trace._fields))
    return trace._replace(phase=trace.phase.astype(np.int8))
