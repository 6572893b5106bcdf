"""Joint angles and derivatives along one segment of a chain, by its progress, and along a motion in time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import ReachError, place_in_mm
from polish_sim.kernel_cache import njit
from polish_sim.kernels import (
    Matrix3,
    Record,
    Vector3,
    add_to,
    cross,
    kernel,
    matvec,
    minus,
    plus,
    scaled,
    set_to,
    turn_about,
)
from polish_sim.motion.joint_rates import ArmState, place_arm, solve_rates
from polish_sim.motion.kinematics import JOINT_LIMITS, solve_on_branch
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, chain_in_base
from polish_sim.motion.rules.schedule import Samples

REACHED, UNREACHABLE, SINGULAR, BEYOND = 0, 1, 2, 3  #: Of a place; BEYOND: a joint is out of its range


class JointRates(NamedTuple):
    """Joint angles and their derivatives at n places."""

    q: Array  #: [rad], shape (n, 6)
    first: Array  #: By progress or time, shape (n, 6)
    second: Array
    third: Array


class Segment(Record):
    """One segment in the base frame; the fields of a `Chain` without the axes, in their order."""

    tip: Vector3  #: Start [m]
    rotation: Matrix3  #: R_base_tool at the start
    length: float
    direction: Vector3  #: Unit, or zero
    angle: float
    turn_axis: Vector3  #: Unit, or zero
    roll: float


@njit(_nrt=False, inline="always")
def _tool_pose(segment: Segment, u: float, T: Array) -> None:
    """Write T_base_tool, shape (4, 4), at progress u: exp(u angle n) R exp(u roll z)."""
    R, n = segment.rotation, segment.turn_axis
    c, s = math.cos(u * segment.roll), math.sin(u * segment.roll)
    ct, st = math.cos(u * segment.angle), math.sin(u * segment.angle)
    x, y = R[:, 0], R[:, 1]
    set_to(T[:, 0], turn_about(n, ct, st, 1.0 - ct, plus(scaled(c, x), scaled(s, y))))
    set_to(T[:, 1], turn_about(n, ct, st, 1.0 - ct, minus(scaled(c, y), scaled(s, x))))
    set_to(T[:, 2], turn_about(n, ct, st, 1.0 - ct, R[:, 2]))
    set_to(T[:, 3], plus(segment.tip, scaled(u * segment.length, segment.direction)))
    set_to(T[3], (0.0, 0.0, 0.0))
    T[3, 3] = 1.0


@njit(_nrt=False, inline="always")
def _segment_twists(segment: Segment, T_base_tool: Array, twists: Array) -> None:
    """Write first to third derivative of the tool's pose by u, as twists (3, 6): only the roll's axis
    turns."""
    n, a, roll, o = segment.turn_axis, segment.angle, segment.roll, T_base_tool[:, 2]
    along = scaled(a, cross(n, o))
    set_to(twists[0], scaled(segment.length, segment.direction))
    set_to(twists[1], (0.0, 0.0, 0.0))
    set_to(twists[2], (0.0, 0.0, 0.0))
    set_to(twists[0, 3:], plus(scaled(a, n), scaled(roll, o)))
    set_to(twists[1, 3:], scaled(roll, along))
    set_to(twists[2, 3:], scaled(roll * a, cross(n, along)))


@kernel
def within_range(q: Array) -> bool:
    """Whether all joints are within their range."""
    inside = True
    for j in range(6):
        inside = inside and JOINT_LIMITS[j, 0] <= q[j] <= JOINT_LIMITS[j, 1]
    return inside


@njit(_nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def reach_pose(state: ArmState, arm: Arm) -> int:
    """Bring the tool to the state's pose on the branch its joint angles are on, and place the arm.

    Returns REACHED, UNREACHABLE or SINGULAR.
    """
    flange, T_base_tool, T = state.scratch, state.T, arm.T_tool_flange
    for j in range(4):
        set_to(flange[:, j], matvec(T_base_tool, T[:, j]))
    add_to(flange[:, 3], T_base_tool[:, 3])
    if not solve_on_branch(arm.lengths, flange, state.q, state.q):
        return UNREACHABLE
    return REACHED if place_arm(state, arm.rows, arm.T_flange_tool) else SINGULAR


@njit(_nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def rates_at(state: ArmState, segment: Segment, u: float, arm: Arm) -> int:
    """Write q and its three derivatives by progress at u of a segment (base frame) into ``state``.

    Its joint angles say which branch. Returns as `reach_pose`.
    """
    _tool_pose(segment, u, state.T)
    status = reach_pose(state, arm)
    if status == REACHED:
        _segment_twists(segment, state.T, state.twists)
        solve_rates(state)
    return int(status)


@kernel
def _keep_rates(state: ArmState, out: JointRates, row: int) -> None:
    """Write the joint angles and their derivatives into a row."""
    for j in range(6):
        out.q[row, j] = state.q[j]
        out.first[row, j] = state.rates[0, j]
        out.second[row, j] = state.rates[1, j]
        out.third[row, j] = state.rates[2, j]


@njit
def _fill_rates(segments: Any, nodes: Array, arm: Arm, state: ArmState, out: JointRates) -> tuple[int, int]:
    """Rates at every node of every segment in order; (status, row) of the first that fails, or (REACHED,
    -1). ``segments``: records of `Segment`, shape (n,)."""
    for k in range(len(segments)):
        for i in range(nodes.shape[0]):
            row = k * nodes.shape[0] + i
            status = rates_at(state, segments[k], nodes[i], arm)
            if status == REACHED and not within_range(state.q):
                status = BEYOND
            if status != REACHED:
                return status, row
            _keep_rates(state, out, row)
    return REACHED, -1


def chain_rates(chain: Chain, nodes: Array, arm: Arm) -> JointRates:
    """Joint angles and derivatives by progress at the same ``nodes`` (m,) of each of n segments, shape (n, m,
    6).

    The chain is in the work frame; see `chebyshev_nodes`. Divide by length^k for derivatives by arc length.

    Raises:
        ReachError: A place cannot be reached, is singular, or has a joint beyond its range.
    """
    segments, in_base = np.zeros(len(chain.lengths), Segment.dtype), chain_in_base(chain, arm)
    for name, values in zip(Segment.dtype.names, (in_base.tips, *in_base[2:]), strict=True):
        segments[name] = values[: len(segments)]
    count = len(segments) * len(nodes)
    out = JointRates(*(np.full((count, 6), np.nan) for _ in range(4)))
    nodes = np.asarray(nodes, dtype=float)
    status, row = _fill_rates(segments, nodes, arm, ArmState(q=arm.q_start), out)
    if status != REACHED:
        k, i = divmod(row, len(nodes))
        raise unreachable(status, k, chain.tips[k] + nodes[i] * chain.lengths[k] * chain.directions[k])
    return JointRates(*(column.reshape(-1, len(nodes), 6) for column in out))


def chebyshev_nodes(count: int) -> Array:
    """Extremes of a Chebyshev polynomial on [0, 1], both ends included, rising, shape (count,)."""
    return 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count))


def joint_motion(tips: Array, rotations: Array, linear: Array, angular: Array, arm: Arm) -> JointRates:
    """Joint motion (n, 6) of a tool motion given with its derivatives in time, exact at every sample.

    Tool points (n, 3) [m] and R_work_tool (n, 3, 3) are dense enough to stay on one branch of the arm.
    ``linear`` holds velocity, acceleration and jerk of the tool point, ``angular`` the spatial angular
    velocity and its first two derivatives, (3, n, 3) each, SI, work frame.

    Raises:
        ReachError: A sample cannot be reached, or is singular.
    """
    R = arm.T_base_work[:3, :3]
    poses = np.zeros((len(tips), 4, 4))
    poses[:, :3, :3] = R @ rotations
    poses[:, :3, 3] = tips @ R.T + arm.T_base_work[:3, 3]
    poses[:, 3, 3] = 1.0
    twists = np.ascontiguousarray(np.concatenate([linear @ R.T, angular @ R.T], axis=2).swapaxes(0, 1))
    out = JointRates(*(np.full((len(tips), 6), np.nan) for _ in range(4)))
    status, row = _fill_motion(poses, twists, arm, ArmState(q=arm.q_start), out)
    if status != REACHED:
        raise unreachable(status, row, tips[row])
    return out


def sampled_joints(tool: Samples, arm: Arm) -> JointRates:
    """Joint motion (n, 6) of a sampled tool motion; see `joint_motion`."""
    linear, angular = tool.tips[:, 1:].swapaxes(0, 1), tool.spins.swapaxes(0, 1)
    return joint_motion(tool.tips[:, 0], tool.rotations, linear, angular, arm)


@njit
def _fill_motion(poses: Array, twists: Array, arm: Arm, state: ArmState, out: JointRates) -> tuple[int, int]:
    """Joint rates of every sample; (status, row) of the first that fails, or (REACHED, -1)."""
    for row in range(poses.shape[0]):
        for i in range(4):
            for j in range(4):
                state.T[i, j] = poses[row, i, j]
        status = reach_pose(state, arm)
        if status != REACHED:
            return status, row
        for i in range(twists.shape[1]):
            for j in range(6):
                state.twists[i, j] = twists[row, i, j]
        solve_rates(state)
        _keep_rates(state, out, row)
    return REACHED, -1


def unreachable(status: int, segment: int, tip_work: Array) -> ReachError:
    """Build the error for a place that no joint angles, or no joint speeds, belong to."""
    place = f"segment {segment + 1}, at {place_in_mm(tip_work)} in the path's frame"
    if status == UNREACHABLE:
        return ReachError(f"the arm cannot reach {place}. Move the part or turn the tool.")
    if status == BEYOND:
        return ReachError(
            f"a joint leaves its range in {place}. Begin with the joint turned back, or turn the tool."
        )
    return ReachError(
        f"the arm is singular in {place}: joints would have to jump. Move the part or turn the tool."
    )
