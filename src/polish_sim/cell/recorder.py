"""What is kept of a run: packed rows for the log, and the exact quantities of every step for the figures."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.carrier import FIRST_JOINT
from polish_sim.control.signals import Measurement, Target
from polish_sim.kernel_cache import njit
from polish_sim.log import Trace, row_layout, row_width
from polish_sim.spatial import quaternion_from_rotation, rotation_angle

Array = NDArray[np.float64]

ROW_WIDTH = row_width()
TRACE_WIDTH = 22
MASTER_Q = ROW_WIDTH  # behind the log's columns: joints of a second robot that carries the part

_AT = {name: start for name, (start, _width) in row_layout().items()}
# Constants, because a compiled kernel cannot read a dictionary.
_TIME, _Q, _QD, _TORQUE = _AT["time_s"], _AT["q_rad"], _AT["qd_rad_s"], _AT["torque_nm"]
_POSITION, _QUATERNION = _AT["tcp_position_m"], _AT["tcp_quaternion_wxyz"]
_TARGET_POSITION, _TARGET_QUATERNION = _AT["target_position_m"], _AT["target_quaternion_wxyz"]
_SPEED, _COMMAND = _AT["tcp_speed_m_s"], _AT["command_twist"]
_MEASURED, _RAW, _TRUE = _AT["wrench_measured_tool"], _AT["wrench_raw_sensor"], _AT["wrench_true_tool"]
_FORCE, _FORCE_MIN, _FORCE_MAX = _AT["normal_force_n"], _AT["normal_force_min_n"], _AT["normal_force_max_n"]
_TRAVEL, _PATH, _PASS, _PHASE = _AT["pad_travel_m"], _AT["path_s_m"], _AT["pass_index"], _AT["phase"]


class Recorder(NamedTuple):
    """Buffers of one chunk of steps."""

    rows: Array
    """Packed log rows and the joints of a second robot behind each, shape (k, ROW_WIDTH + 6)."""
    trace: Array
    """Exact quantities, shape (steps, TRACE_WIDTH)."""
    every: int
    """Steps per row."""
    span: Array
    """Least and largest force since the last row [N], shape (2,)."""
    filled: NDArray[np.int64]
    """Rows and trace rows filled in this chunk, shape (2,)."""


def build_recorder(steps: int, every: int) -> Recorder:
    """Buffers for chunks of at most ``steps`` steps, a row recorded every ``every`` steps."""
    return Recorder(
        np.zeros((steps // every + 2, ROW_WIDTH + 6)),
        np.zeros((steps, TRACE_WIDTH)),
        every,
        np.array([np.inf, -np.inf]),
        np.zeros(2, np.int64),
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def _put(row: Array, start: int, values: Array, count: int) -> None:
    """Copy by hand: a slice assignment would compile a shape check with its message, seconds of it."""
    for i in range(count):
        row[start + i] = values[i]


@njit(cache=True, error_model="numpy", forceinline=True)
def record_state(
    recorder: Recorder, count: int, t: float, phase: float, q: Array, qd: Array, m: Measurement, target: Target,
    true_wrench: Array, command: Array, travel: float, turn: int, part_rest: Array, part_position: Array,
    spin: float, tool_on_part: Array, tool_position: Array, tool_rotation: Array,
) -> None:  # fmt: skip
    """Record this instant, before the engine moves on; the sensor's raw reading follows in ``record_reading``.

    Args:
        recorder: Buffers.
        count: Steps taken since the start.
        t: Time [s].
        phase: Phase as in ``log.PHASES``.
        q: Joint positions [rad], shape (>= 6,).
        qd: Joint speeds [rad/s], shape (>= 6,).
        m: Measurement; what the errors are measured by.
        target: Target.
        true_wrench: Exact wrench of the tool on the part, tool axes, tool point, shape (6,).
        command: Twist acting in the robot, shape (6,).
        travel: Pad travel [m].
        turn: Turn of the path.
        part_rest: Origin of the part's frame at rest [m], shape (3,).
        part_position: Origin of the part's frame now [m], shape (3,).
        spin: Speed of the spindle [rad/s].
        tool_on_part: Tool point on a part that is carried [m], shape (3,).
        tool_position: Tool point as it is [m], shape (3,).
        tool_rotation: Tool frame as it is, shape (3, 3).
    """
    force = true_wrench[2]
    recorder.span[0] = min(recorder.span[0], force)
    recorder.span[1] = max(recorder.span[1], force)
    speed = math.sqrt(m.twist[0] ** 2 + m.twist[1] ** 2 + m.twist[2] ** 2)
    trace = recorder.trace[recorder.filled[1]]
    _trace_step(trace, t, phase, force, speed, m, target, travel)
    for i in range(3):
        trace[12 + i] = part_position[i] - part_rest[i]
        trace[6 + i] = tool_position[i]
    trace[15] = spin
    _put(trace, 19, tool_on_part, 3)
    recorder.filled[1] += 1
    if count % recorder.every:
        return
    row = recorder.rows[recorder.filled[0]]
    row[_TIME] = t
    _put(row, _Q, q, 6)
    _put(row, _QD, qd, 6)
    _put(row, _POSITION, tool_position, 3)
    quaternion_from_rotation(tool_rotation, row[_QUATERNION : _QUATERNION + 4])
    _put(row, _TARGET_POSITION, target.position, 3)
    quaternion_from_rotation(target.rotation, row[_TARGET_QUATERNION : _TARGET_QUATERNION + 4])
    row[_SPEED] = speed
    _put(row, _COMMAND, command, 6)
    _put(row, _MEASURED, m.wrench, 6)
    _put(row, _TRUE, true_wrench, 6)
    row[_FORCE], row[_FORCE_MIN], row[_FORCE_MAX] = force, recorder.span[0], recorder.span[1]
    row[_TRAVEL], row[_PATH], row[_PASS], row[_PHASE] = travel, target.path[0], turn, phase
    if q.shape[0] > FIRST_JOINT:
        _put(row, MASTER_Q, q[FIRST_JOINT:], 6)
    recorder.span[0], recorder.span[1] = math.inf, -math.inf
    recorder.filled[0] += 1


@njit(cache=True, error_model="numpy", forceinline=True)
def _trace_step(
    trace: Array, t: float, phase: float, force: float, speed: float, m: Measurement, target: Target, travel: float
) -> None:
    ex, ey, ez = (
        target.position[0] - m.position[0],
        target.position[1] - m.position[1],
        target.position[2] - m.position[2],
    )
    along = ex * target.rotation[0, 2] + ey * target.rotation[1, 2] + ez * target.rotation[2, 2]
    total = ex * ex + ey * ey + ez * ez
    trace[0], trace[1], trace[2] = t, phase, force
    trace[3] = math.sqrt(total)
    trace[4] = math.sqrt(max(total - along * along, 0.0))
    trace[5] = rotation_angle(m.rotation, target.rotation)
    trace[9] = speed
    trace[10], trace[11] = target.path[0], travel
    trace[16], trace[17], trace[18] = ex, ey, ez


@njit(cache=True, error_model="numpy", forceinline=True)
def record_reading(recorder: Recorder, count: int, raw: Array, joint_torque: Array) -> None:
    """Add what the engine computes last to the row of this instant: exact sensor wrench and joint torques."""
    if count % recorder.every == 0:
        row = recorder.rows[recorder.filled[0] - 1]
        _put(row, _RAW, raw, 6)
        _put(row, _TORQUE, joint_torque, 6)


def trace_from(block: Array) -> Trace:
    """Name the columns of a trace block, shape (n, TRACE_WIDTH)."""
    return Trace(
        block[:, 0],
        block[:, 1].astype(np.int8),
        block[:, 2],
        block[:, 3],
        block[:, 4],
        block[:, 5],
        block[:, 6:9],
        block[:, 9],
        block[:, 10],
        block[:, 12:15],
        block[:, 11],
        block[:, 15],
        block[:, 16:19],
        block[:, 19:22],
    )
