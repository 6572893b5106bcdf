"""How the pad moved on the part, and how hard it pressed, in short straight steps (log, trace -> PadMotion; layer 8a).

The force's impulse over each step is the sum over every physics step, so nothing of it depends on the log's rate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from polish_sim.cell.contact import RealPart
from polish_sim.log import RunLog
from polish_sim.spatial import unit
from polish_sim.trace import Trace

Array = NDArray[np.float64]

STEP = 0.02  # way of the pad in one step, in pad radii
LONGEST_S, SHORTEST_S = 0.05, 0.001  # of a step


class PadMotion(NamedTuple):
    """Steps of the pad in contact, in the work frame of the real part."""

    ends_s: Array
    """When each step ends [s], shape (k,)."""
    centers: Array
    """Centre of the pad's face in the middle of the step [m], shape (k, 3)."""
    axes: Array
    """Unit pad axis, from the part to the tool, shape (k, 3)."""
    velocities: Array
    """Velocity of the centre [m/s], shape (k, 3)."""
    turning: Array
    """Angular velocity of pad and spindle [rad/s], shape (k, 3)."""
    times: Array
    """How long each step takes [s], shape (k,)."""
    impulses: Array
    """Exact contact force along the pad's axis, integrated over the step [N s], shape (k,)."""


def pad_motion(
    log: RunLog, trace: Trace, part: RealPart, pad_radius: float, part_turns: Array | None = None
) -> PadMotion:
    """Cut a run into steps.

    Args:
        log: Its rows; only the tool's orientation is taken from them.
        trace: Its exact quantities at every physics step.
        part: The real part, for its pose at the start.
        pad_radius: [m]
        part_turns: How a part that is carried stands in the base at the log's rows, shape (n, 3, 3); None: as at the
            start.

    Returns:
        The steps in contact, in order.
    """
    time, force = trace.time_s, np.maximum(trace.normal_force_n, 0.0)
    touching = np.flatnonzero(force > 0.0)
    if len(time) < 2 or not len(touching):
        some, none = np.empty((0, 3)), np.empty(0)
        return PadMotion(none, some, some, some, some, none, none)
    # The force of an instant acts until the next one.
    clock = np.append(time, 2.0 * time[-1] - time[-2])
    impulse = np.concatenate([[0.0], np.cumsum(force * np.diff(clock))])
    speeds = trace.tcp_speed_m_s if part_turns is None else _speeds_on_part(trace)
    marks = _marks(clock[touching[0]], clock[touching[-1] + 1], speeds[touching], pad_radius)
    gained, times = np.diff(np.interp(marks, clock, impulse)), np.diff(marks)
    R_base_part = part.rotation[None] if part_turns is None else part_turns
    faces, turns = _pad_poses(log, trace, part.position, R_base_part, marks)
    centers, velocities = 0.5 * (faces[1:] + faces[:-1]), np.diff(faces, axis=0) / times[:, None]
    outward = -turns.as_matrix()[:, :, 2]
    axes = unit(outward[1:] + outward[:-1])
    spin = np.interp(0.5 * (marks[1:] + marks[:-1]), time, trace.spindle_rad_s)
    turning = (turns[1:] * turns[:-1].inv()).as_rotvec() / times[:, None] - spin[:, None] * axes
    columns = (marks[1:], centers, axes, velocities, turning, times, gained)
    return PadMotion(*(np.ascontiguousarray(column[gained > 0.0]) for column in columns))


def _speeds_on_part(trace: Trace) -> Array:
    """Of the tool point over a part that is carried [m/s], shape (n,)."""
    return np.asarray(np.linalg.norm(np.gradient(trace.tool_on_part_m, trace.time_s, axis=0), axis=1))


def _marks(first: float, last: float, speeds: Array, pad_radius: float) -> Array:
    """Ends of steps [s] in which a pad at almost its highest speed moves no further than a share of its radius."""
    step = min(STEP * pad_radius / max(float(np.percentile(speeds, 99.0)), 1e-9), LONGEST_S)
    return np.linspace(first, last, math.ceil((last - first) / max(step, SHORTEST_S)) + 1)


def _pad_poses(log: RunLog, trace: Trace, origin: Array, R_base_part: Array, marks: Array) -> tuple[Array, Rotation]:
    """Centre of the pad's face (k, 3) [m] and the tool's turn in the real work frame, at moments (k,) [s]."""
    rows = np.asarray(log["time_s"], dtype=np.float64)
    logged = Rotation.from_quat(np.asarray(log["tcp_quaternion_wxyz"], dtype=np.float64), scalar_first=True)
    R_work_base = _turned(rows, Rotation.from_matrix(R_base_part), marks).inv()
    R_work_tool = R_work_base * _turned(rows, logged, marks)
    tips = trace.tcp_position_m - trace.part_shift_m
    tips = np.stack([np.interp(marks, trace.time_s, tips[:, k]) for k in range(3)], axis=1)
    travel = np.interp(marks, trace.time_s, trace.pad_travel_m)
    faces = R_work_base.apply(tips - origin) - travel[:, None] * R_work_tool.as_matrix()[:, :, 2]
    return faces, R_work_tool


def _turned(rows: Array, turns: Rotation, moments: Array) -> Rotation:
    """Turns given at some moments [s], (n,), or one for all time, at others, (k,)."""
    if len(turns) == 1:
        return turns
    return Slerp(rows, turns)(np.clip(moments, rows[0], rows[-1]))
