"""``calibrate tcp``: where the tool's tip is on the flange and how the tool stands.

Kinematics only: the accuracy is that with which a tip meets a point, the stated noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.calibration.matched_points import frame_offset
from polish_sim.dual.calibrate_bases import Q_NEAR, Calibrated
from polish_sim.dual.calibration.tool import ToolFrameEstimate, ToolMeasurements, fit_tool_frame, tool_figures
from polish_sim.dual.calibration.tool_checks import TOOL_DOWN, ToolTouches, plan_touch_orientations
from polish_sim.motion import forward, inverse_near
from polish_sim.spatial import transform

Reading = Callable[[Array, Array], Array]
"""Flange poses (n, 4, 4) a host reads, from those the flange really has and the nominal arm's joints there
(n, 6)."""

POINT = np.array([-0.45, -0.15, 0.3])  #: It is touched, base frame [m]: tilted wrists still reach it
LENGTH, SIDEWAYS, LEAN = 0.18, 0.02, 0.15  #: Of a tool to find: length [m], off the axis [m], crooked [rad]


@dataclass(frozen=True)
class TcpTrial:
    """A simulated calibration of a tool frame."""

    noise: float = 5e-5  #: Of one coordinate of a touch, rms [m]
    poses: int = 10
    cone: float = np.pi / 4.0  #: How far the tool is tilted [rad]
    move: float = 0.1  #: Length of the moves along the tool's axes [m]
    seed: int = 0
    #: The tool as it really is, shape (4, 4); None: one is planted by the seed
    T_flange_tool: Array | None = None
    read: Reading | None = None  #: What the host reads of an arm with gears; None: of one as its table says


TcpCalibration = Calibrated[ToolMeasurements, ToolFrameEstimate]


def calibrate_tcp_from(measured: ToolMeasurements) -> TcpCalibration:
    """Calibrate from touches of a real robot, without a truth to compare with; CalibrationError if
    undetermined."""
    found = fit_tool_frame(measured)
    return TcpCalibration(measured, found, tool_figures(measured, found))


def run_tcp_calibration(trial: TcpTrial) -> TcpCalibration:
    """Take or plant a tool, touch a point with it in planned poses, move along its axes, and find it, against
    the truth.

    Raises CalibrationError if the trial cannot determine a tool, ReachError if the arm cannot reach a pose.
    """
    rng = np.random.default_rng([trial.seed, 11])
    T_flange_tool = planted_tool(rng) if trial.T_flange_tool is None else trial.T_flange_tool
    measured = simulate_touches(trial, T_flange_tool, rng, trial.read)
    # Exact touches leave rounding: below a nanometre a stated noise says nothing. Gears err by more than the
    # noise.
    found = fit_tool_frame(measured, trial.noise if trial.noise > 1e-9 and trial.read is None else None)
    figures = tool_figures(measured, found, trial.noise)
    off, turn = frame_offset(found.T_flange_tool, T_flange_tool)
    figures |= {"position_error_m": off, "rotation_error_rad": turn}
    figures |= {"true_position_m": T_flange_tool[:3, 3].tolist(), "seed": trial.seed}
    bound = math.sqrt(trial.poses) * figures["position_std_m"]
    figures |= {"position_bound_m": bound, "bound_share": figures["position_error_m"] / bound}
    return TcpCalibration(measured, found, figures)


def planted_tool(rng: np.random.Generator) -> Array:
    """A tool of some length, off the flange's axis and crooked, shape (4, 4)."""
    turn = Rotation.from_rotvec(LEAN * rng.uniform(-1.0, 1.0, 3)).as_matrix()
    return transform(turn, np.array([*SIDEWAYS * rng.uniform(-1.0, 1.0, 2), LENGTH]))


def simulate_touches(
    trial: TcpTrial,
    T_flange_tool: Array,
    rng: np.random.Generator,
    read: Reading | None = None,
    q_near: Array = Q_NEAR,
) -> ToolMeasurements:
    """Touches in the planned orientations, and the three points of the tool's axes, each as the joints say
    it.

    ``read`` and ``q_near`` as of `reached`.
    """
    R = plan_touch_orientations(trial.poses, trial.cone)
    tips = POINT + trial.noise * rng.standard_normal((len(R), 3))
    axes = TOOL_DOWN @ T_flange_tool[:3, :3]
    # The tool first backs away from the point, so that the move along its z axis ends there.
    start = POINT - trial.move * axes[:, 2]
    corners = start + trial.move * np.stack([np.zeros(3), axes[:, 0], axes[:, 2]])
    corners += trial.noise * rng.standard_normal((3, 3))
    touches = reached(transform(R, tips - R @ T_flange_tool[:3, 3]), read, q_near)
    R_moves = np.tile(TOOL_DOWN, (3, 1, 1))
    moved = reached(transform(R_moves, corners - R_moves @ T_flange_tool[:3, 3]), read, q_near)
    return ToolMeasurements(ToolTouches(touches), moved)


def reached(T_base_flange: Array, read: Reading | None = None, q_near: Array = Q_NEAR) -> Array:
    """Flange poses (n, 4, 4) as the host reads them, by default inverse then forward kinematics; or
    ReachError.

    ``read``: what the host reads of an arm off its table; None: the arm is as its table says. ``q_near`` (6,)
    [rad] says in which configuration.
    """
    q = np.stack([inverse_near(T, q_near) for T in T_base_flange])
    return np.ascontiguousarray(forward(q) if read is None else read(T_base_flange, q))
