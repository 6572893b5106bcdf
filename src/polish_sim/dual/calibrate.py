"""``calibrate base``, ``arm``, ``tcp``: where the follower's base stands in the master's, both arms' tables,
where the tool's tip is on the flange and how the tool stands.

Kinematics and a tracker's noise only; bases, about a metre apart, and arms are drawn by the seed. A tip meets
a point with the stated noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from polish_sim.arrays import Array, Figures, rms_length
from polish_sim.calibration.arm import ArmEstimate, Tolerance, TrackedArm, fit_placement
from polish_sim.calibration.matched_points import frame_offset
from polish_sim.cell.real_arm import RestingArm
from polish_sim.dual.calibration.arm import PairTables, fit_pair, pair_figures, read_tracked
from polish_sim.dual.calibration.bases import (
    ROBOTS,
    Arcs,
    BaseCalibration,
    base_figures,
    fit_bases,
    read_base_measurements,
)
from polish_sim.dual.calibration.tool import (
    TOOL_DOWN,
    ToolFrameEstimate,
    ToolMeasurements,
    fit_tool_frame,
    plan_touch_orientations,
    read_tool_measurements,
    tool_figures,
)
from polish_sim.motion import forward, inverse_near
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.spatial import apply, from_pose, inverse, place_of, rotations_from_vectors, transform

#: The tracker's target on the flange [m]: outwards, for larger circles
TARGET = np.array([-0.03, 0.02, 0.05])
#: Joint angles of the arcs of axes 1 and 2 [deg]: the arm stays up
ARCS = ((-60.0, 60.0), (-120.0, 0.0))
LOW, HIGH = np.radians([[-80, -140, 20, -180, -90, -90], [80, -50, 120, 0, 90, 90]])
"""Joint angles of tracked poses, drawn evenly between [rad]."""
CHECKS = 400  # poses in which calibrated arms are compared with the true ones
Q_NEAR = np.array([0.3, -1.6, 1.7, -1.6, -1.5, 0.0])  #: Touches are made in this configuration [rad]
AWAY = 1.0  #: Where a frame's error at a distance is given [m]


M = TypeVar("M")
F = TypeVar("F")


@dataclass(frozen=True)
class Calibrated(Generic[M, F]):
    """A calibration and what it rests on."""

    measured: M
    found: F
    figures: Figures  #: The keys of metrics.json
    true: F | None = None  #: What the measurements were simulated from, where it is of the same kind


Bases = Mapping[str, Array]
"""Where robots really stand before the tracker: T_tracker_base, robot by robot, each (4, 4)."""
Flanges = Callable[[str, Array], Array]
"""Where the flange of a robot really is in its base, (n, 4, 4), with its encoders at (n, 6) [rad]."""


@dataclass(frozen=True)
class BaseTrial:
    """A simulated calibration of two bases."""

    noise: float = 3e-5  #: Of one coordinate of a measured point, rms [m]
    points: int = 200  #: Of an arc
    seed: int = 0
    flanges: Flanges | None = None  #: Of arms with gears; None: of arms as their table says


BasesFound = Calibrated[Arcs, BaseCalibration]


def calibrate_base_from(file: Path) -> BasesFound:
    """Calibrate from measurements of real robots, without a truth to compare with; CalibrationError if
    undetermined."""
    measured = read_base_measurements(file)
    found = fit_bases(measured)
    return BasesFound(measured, found, base_figures(found) | _stated(found))


def run_base_calibration(trial: BaseTrial) -> BasesFound:
    """Plant two bases, measure them, and find one in the other; the figures are against the truth.

    Raises CalibrationError if the measurements do not determine the bases.
    """
    rng = np.random.default_rng([trial.seed, 12])
    truth = planted_bases(rng)
    measured = simulate_arcs(truth, trial.points, trial.noise, rng, trial.flanges)
    found = fit_bases(measured, trial.noise if trial.noise > 1e-9 and trial.flanges is None else None)
    figures = base_figures(found) | _stated(found) | _errors(found, truth)
    bound = math.sqrt(trial.points) * figures["relative_origin_std_m"]
    figures |= {"relative_origin_bound_m": bound, "bound_share": figures["relative_origin_error_m"] / bound}
    return BasesFound(measured, found, figures | {"seed": trial.seed})


def planted_bases(rng: np.random.Generator) -> Bases:
    """Two robots that face each other about 1.1 m apart, seen from the side, nothing quite level."""
    small = np.array([0.05, 0.05, 0.02, 0.01, 0.01, 0.1])
    places = np.array([[2.5, -0.8, -0.4, 0.0, 0.0, 2.0], [-1.1, 0.0, 0.0, 0.0, 0.0, 3.0]])
    T_tracker_master, T_master_follower = (from_pose(p + small * rng.uniform(-1.0, 1.0, 6)) for p in places)
    return dict(zip(ROBOTS, (T_tracker_master, T_tracker_master @ T_master_follower), strict=True))


def simulate_arcs(
    truth: Bases, count: int, noise: float, rng: np.random.Generator, flanges: Flanges | None
) -> Arcs:
    """Axis 1, then axis 2 of each robot turns, at unrecorded joint angles; without ``flanges``: nominal
    arms."""

    def arc(robot: str, joint: int) -> Array:
        q = np.zeros((count, 6))
        first, last = np.radians(ARCS[joint])
        q[:, joint] = np.sort(np.r_[first, last, rng.uniform(first, last, max(count - 2, 0))])[:count]
        own = place_of(forward(q) if flanges is None else flanges(robot, q), TARGET)
        return apply(truth[robot], own) + noise * rng.standard_normal((count, 3))

    return {robot: (arc(robot, 0), arc(robot, 1)) for robot in truth}


def _stated(found: BaseCalibration) -> Figures:
    """Stated deviations of the worse base, of its z axis and of a point a metre away along its axes, rms."""
    squares = []
    for base in found.frames.values():
        C, z = base.covariance, base.T[:3, 2]
        origin, turn = np.trace(C[:3, :3]), np.trace(C[3:, 3:])
        # Points on both sides of the origin: what its displacement and the rotation have in common cancels.
        squares.append([origin, turn - z @ C[3:, 3:] @ z, origin + 2.0 / 3.0 * AWAY**2 * turn])
    names = ("relative_origin_std_m", "origin_std_m", "axis_std_rad", "point_std_1m_m")
    stated = np.trace(found.covariance[:3, :3]), *np.max(squares, axis=0)
    return dict(zip(names, np.sqrt(stated), strict=True))


def _errors(found: BaseCalibration, truth: Bases) -> Figures:
    """Calibration minus truth: of each base as the tracker sees it, of one in the other, and a metre away."""
    T = found.T_master_follower
    wanted = inverse(truth[ROBOTS[0]]) @ truth[ROBOTS[1]]
    figures = _frame_error("relative_", T, wanted)
    # Of a metre away in any direction: rms over the three axes of the follower's base.
    off = np.sum((T - wanted) ** 2, axis=0)
    figures["point_error_1m_m"] = math.sqrt(off[3] + AWAY**2 * off[:3].mean())
    each = [_frame_error("", found.frames[robot].T, T_true) for robot, T_true in truth.items()]
    figures |= {name: max(e[name] for e in each) for name in each[0]}
    return figures | {"true_transform": wanted}


def _frame_error(prefix: str, T: Array, wanted: Array) -> dict[str, float]:
    off, angle = frame_offset(T, wanted)
    tilt = float(np.linalg.norm(np.cross(T[:3, 2], wanted[:3, 2])))
    return {
        f"{prefix}origin_error_m": off,
        f"{prefix}axis_error_rad": tilt,
        f"{prefix}rotation_error_rad": angle,
    }


RestingArms = Mapping[str, RestingArm]
"""Both arms behind their gears, robot by robot."""


@dataclass(frozen=True)
class ArmTrial:
    """Two arms with errors in their tables, measured by a tracker."""

    tolerance: Tolerance = Tolerance()  #: Standard deviations of the planted errors
    noise: float = 3e-5  #: Of one coordinate of the tracker [m]
    poses: int = 60  #: Of each arm
    seed: int = 0
    gears: RestingArms | None = None  #: None: rigid


ArmsFound = Calibrated[Mapping[str, TrackedArm], PairTables]


def calibrate_arm_from(file: Path) -> ArmsFound:
    """Calibrate from poses of real arms, without a truth to compare with; CalibrationError if
    undetermined."""
    tracked = read_tracked(file)
    found = fit_pair(tracked, None, Tolerance())
    return ArmsFound(tracked, found, pair_figures(tracked, found, Tolerance()))


def run_arm_calibration(trial: ArmTrial) -> ArmsFound:
    """Plant two arms with wrong tables, measure both, find them, and predict the relative tool point in other
    poses.

    The tool point is the target itself: what is left is the arms' and bases' error, not that of a tool
    calibration. The figures are errors of the follower's tool point relative to the master's, in poses not
    measured: relative_error_nominal_m is the rms with bases and targets calibrated and the tables taken as
    nominal, relative_error_m that with all of it calibrated jointly.
    """
    rng = np.random.default_rng([trial.seed, 13])
    T_tracker = planted_bases(rng)
    true = PairTables(
        {robot: built_arm(wrong_table(trial.tolerance, rng), T_tracker[robot]) for robot in ROBOTS}
    )
    tracked = simulate_tracked(true, trial.poses, trial.noise, rng, trial.gears)
    q = {robot: rng.uniform(LOW, HIGH, (CHECKS, 6)) for robot in ROBOTS}
    resting = {robot: trial.gears[robot].links(q[robot], rng) for robot in ROBOTS} if trial.gears else q
    checks = {
        robot: tracked_arm(
            q[robot], true.arms[robot].target_at(links), trial.gears[robot] if trial.gears else None
        )
        for robot, links in resting.items()
    }
    found = fit_pair(tracked, None if trial.gears else max(trial.noise, 1e-9), trial.tolerance)
    nominal = PairTables({robot: fit_placement(one) for robot, one in tracked.items()})
    figures = pair_figures(tracked, found, trial.tolerance) | {
        "relative_error_nominal_m": _relative_error(nominal, checks),
        "relative_error_m": _relative_error(found, checks),
        "seed": trial.seed,
    }
    return ArmsFound(tracked, found, figures, true)


def built_arm(table: Array, T_tracker_base: Array) -> ArmEstimate:
    """An arm as it really is, the tracker's target on its flange."""
    return ArmEstimate(table, T_tracker_base, TARGET)


def wrong_table(tolerance: Tolerance, rng: np.random.Generator, table: Array = NOMINAL) -> Array:
    """A table off another by normal errors of these standard deviations, shape (4, 6)."""
    spread = np.array([[tolerance.angle], [tolerance.length], [tolerance.length], [tolerance.angle]])
    return table + spread * rng.standard_normal((4, 6))


def simulate_tracked(
    true: PairTables, poses: int, noise: float, rng: np.random.Generator, gears: RestingArms | None
) -> dict[str, TrackedArm]:
    """Each arm holds its target still in poses all over its workspace before the tracker; with gears it comes
    there from both sides, and the mean of the two readings is taken."""
    tracked = {}
    for robot, arm in true.arms.items():
        q = rng.uniform(LOW, HIGH, (poses, 6))
        gear = gears[robot] if gears else None
        seen = arm.tracked(gear.arrive(q, rng) if gear else q[None], noise, rng)
        tracked[robot] = tracked_arm(q, seen, gear)
    return tracked


def tracked_arm(q: Array, seen: Array, gear: RestingArm | None) -> TrackedArm:
    """Poses of an arm, which carries its weight on gears, or of a rigid one."""
    return TrackedArm(q, seen, gear.weight(q), gear.real) if gear else TrackedArm(q, seen)


def _relative_error(found: PairTables, checks: Mapping[str, TrackedArm]) -> float:
    master, follower = (found.arms[robot].left(checks[robot]) for robot in ROBOTS)
    return rms_length(follower - master)


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
    read: Reading | None = None  #: What the host reads of an arm off its table; None: of one as that says
    q_near: Array = field(default_factory=Q_NEAR.copy)  #: Says in which configuration, shape (6,) [rad]


TcpCalibration = Calibrated[ToolMeasurements, ToolFrameEstimate]


def calibrate_tcp_from(file: Path) -> TcpCalibration:
    """Calibrate from touches of a real robot, without a truth to compare with; CalibrationError if
    undetermined."""
    measured = read_tool_measurements(file)
    found = fit_tool_frame(measured)
    return TcpCalibration(measured, found, tool_figures(measured, found))


def run_tcp_calibration(trial: TcpTrial) -> TcpCalibration:
    """Take or plant a tool, touch a point with it in planned poses, move along its axes, and find it, against
    the truth.

    Raises CalibrationError if the trial cannot determine a tool, ReachError if the arm cannot reach a pose.
    """
    rng = np.random.default_rng([trial.seed, 11])
    T_flange_tool = planted_tool(rng) if trial.T_flange_tool is None else trial.T_flange_tool
    measured = simulate_touches(trial, T_flange_tool, rng)
    # Exact touches leave rounding: below a nanometre a stated noise says nothing. Gears err by more than the
    # noise.
    found = fit_tool_frame(measured, trial.noise if trial.noise > 1e-9 and trial.read is None else None)
    figures = tool_figures(measured, found, trial.noise)
    off, turn = frame_offset(found.T_flange_tool, T_flange_tool)
    figures |= {"position_error_m": off, "rotation_error_rad": turn}
    figures |= {"true_position_m": T_flange_tool[:3, 3], "seed": trial.seed}
    bound = math.sqrt(trial.poses) * figures["position_std_m"]
    figures |= {"position_bound_m": bound, "bound_share": figures["position_error_m"] / bound}
    return TcpCalibration(measured, found, figures)


def planted_tool(rng: np.random.Generator) -> Array:
    """A tool of some length, off the flange's axis and crooked, shape (4, 4)."""
    turn = rotations_from_vectors(LEAN * rng.uniform(-1.0, 1.0, 3))
    return transform(turn, np.array([*SIDEWAYS * rng.uniform(-1.0, 1.0, 2), LENGTH]))


def simulate_touches(trial: TcpTrial, T_flange_tool: Array, rng: np.random.Generator) -> ToolMeasurements:
    """Touches in the planned orientations, and the three points of the tool's axes, each as the joints say
    it."""
    R = plan_touch_orientations(trial.poses, trial.cone)
    tips = POINT + trial.noise * rng.standard_normal((len(R), 3))
    axes = TOOL_DOWN @ T_flange_tool[:3, :3]
    # The tool first backs away from the point, so that the move along its z axis ends there.
    start = POINT - trial.move * axes[:, 2]
    corners = start + trial.move * np.stack([np.zeros(3), axes[:, 0], axes[:, 2]])
    corners += trial.noise * rng.standard_normal((3, 3))
    touches = reached(transform(R, tips - R @ T_flange_tool[:3, 3]), trial.read, trial.q_near)
    R_moves = np.tile(TOOL_DOWN, (3, 1, 1))
    moved = reached(transform(R_moves, corners - R_moves @ T_flange_tool[:3, 3]), trial.read, trial.q_near)
    return ToolMeasurements(touches, moved)


def reached(T_base_flange: Array, read: Reading | None, q_near: Array) -> Array:
    """Flange poses (n, 4, 4) as the host reads them, by default inverse then forward kinematics; or
    ReachError. ``read`` and ``q_near`` as of `TcpTrial`."""
    q = np.stack([inverse_near(T, q_near) for T in T_base_flange])
    return np.ascontiguousarray(forward(q) if read is None else read(T_base_flange, q))
