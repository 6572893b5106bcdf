"""Runs whose figures are known beforehand: made from formulas, not from the simulator."""

import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.metrics import PAPER_ARC
from polish_sim.log import LOG_ROW, PROCESS_PHASE, RemovalMap, RunLog, Trace, from_rows
from polish_sim.planning.toolpath import APPROACH, LEAD_OUT, PROCESS, ToolPath

Array = NDArray[np.float64]
DT = 1e-3


def trace_of(phase: NDArray[np.int8], **columns: Array) -> Trace:
    """A trace with the given columns, all others zero."""
    n = len(phase)
    vectors = ("tcp_position_m", "part_shift_m", "target_error_m", "tool_on_part_m")
    zero = {name: np.zeros((n, 3) if name in vectors else n) for name in Trace._fields}
    return Trace(**(zero | {"time_s": np.arange(n) * DT, "phase": phase} | columns))


def force_trace(contact_force: float = 20.0, tau: float = 0.1) -> Trace:
    """Approach, then a first-order rise to the set force (from contact), then a retract at zero force."""
    time = np.arange(0.0, 7.0, DT)
    phase = np.where(time < 2.0, 0, np.where(time < 6.0, 2, 3)).astype(np.int8)
    force = np.where(phase == PROCESS_PHASE, contact_force * (1.0 - np.exp(-(time - 2.0) / tau)), 0.0)
    return trace_of(phase, normal_force_n=force)


def arc_trace(radial_error_m: float = 5e-5, feed_m_s: float = 0.01, ripple_m_s: float = 0.0) -> Trace:
    """Once round the paper's circle with a constant radial error and a slow ripple of the speed."""
    length = 2 * np.pi * PAPER_ARC.radius
    time = np.arange(0.0, length / feed_m_s, DT)
    angle = feed_m_s * time / PAPER_ARC.radius
    normal = np.asarray(PAPER_ARC.normal)
    u = np.array([0.0, 0.0, 1.0])
    v = np.cross(normal, u)
    radius = PAPER_ARC.radius + radial_error_m
    points = np.asarray(PAPER_ARC.center) + radius * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)
    speed = feed_m_s + ripple_m_s * np.sin(2 * np.pi * 0.5 * time)
    phase, s = np.full(len(time), 2, np.int8), feed_m_s * time
    return trace_of(phase, tcp_position_m=points, tcp_speed_m_s=speed, path_s_m=s)


def bumpy_path(bumps: int = 6, length: float = 1.2, sharpness: float = 1 / 0.06) -> ToolPath:
    """A straight path whose curvature rises to `sharpness` [1/m] in evenly spaced places."""
    s = np.linspace(0.0, length, 2401)
    centres = (np.arange(bumps) + 0.5) * length / bumps
    curvature = 1.0 + sum(sharpness * np.exp(-0.5 * ((s - c) / 0.008) ** 2) for c in centres)
    segment = np.full(len(s), PROCESS, np.int8)
    segment[:20], segment[-20:] = APPROACH, LEAD_OUT
    positions, axes = np.outer(s, [1.0, 0.0, 0.0]), np.tile([0.0, 0.0, 1.0], (len(s), 1))
    return ToolPath(positions, axes, s, np.zeros(len(s), np.int64), segment, curvature + 0.0 * s)


def surface_trace(path: ToolPath, dip_n: float = 5.0) -> Trace:
    """Fed along a path at 10 mm/s with 20 N, less a dip of 10 mm half-width at each strong bend."""
    s, bend = 0.01 * np.arange(0.0, path.length_m / 0.01, DT), path.curvature
    peaks = (bend[1:-1] > bend[:-2]) & (bend[1:-1] > bend[2:]) & (bend[1:-1] > 10.0)
    centres = path.s[1:-1][peaks]
    dips = sum((np.exp(-0.5 * ((s - c) / 0.005) ** 2) for c in centres), np.zeros_like(s))
    process = (s >= path.s[20]) & (s <= path.s[-21])
    phase = np.where(process, 2, np.where(s < path.s[20], 0, 3)).astype(np.int8)
    force = np.where(process, 20.0 - dip_n * dips, 0.0)
    return trace_of(phase, normal_force_n=force, path_s_m=s, tcp_speed_m_s=np.full_like(s, 0.01))


def log_of(trace: Trace, every: int = 4) -> RunLog:
    """The log a run with this trace would have written: its rows, the quantities it does not know at zero."""
    rows = np.zeros(len(trace.time_s[::every]), LOG_ROW)
    for name in ("time_s", "normal_force_n", "tcp_speed_m_s", "path_s_m", "phase"):
        rows[name] = getattr(trace, name)[::every]
    for name in ("normal_force_min_n", "normal_force_max_n"):
        rows[name] = trace.normal_force_n[::every]
    for name in ("tcp_position_m", "target_position_m"):
        rows[name] = trace.tcp_position_m[::every]
    for name in ("tcp_quaternion_wxyz", "target_quaternion_wxyz"):
        rows[name] = 1.0, 0.0, 0.0, 0.0
    return from_rows(rows)


def removal_map(exposure: Array, preston_1_pa: float = 0.0) -> RemovalMap:
    """A level strip of squares 10 mm wide with these exposures [N/m] along it; a node stands for 100 mm^2."""
    n = len(exposure)
    x = 0.01 * np.repeat(np.arange(n), 2)
    vertices = np.column_stack([x, np.tile([0.0, 0.01], n), np.zeros(2 * n)])
    first = 2 * np.arange(n - 1)[:, None]
    triangles = np.concatenate([first + [0, 2, 3], first + [0, 3, 1]])
    up, areas = np.array([0.0, 0.0, 1.0]), np.full(2 * n, 1e-4)
    on_nodes = vertices, np.tile(up, (2 * n, 1)), triangles, areas, np.repeat(exposure, 2)
    return RemovalMap(*on_nodes, up, preston_1_pa, elsewhere_nm=0.0, unplaced_share=0.0, field_ratio=1.0)
