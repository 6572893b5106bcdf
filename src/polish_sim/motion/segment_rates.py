"""Joint angles and derivatives along a motion in time, and along the segments of a chain by their progress.

With x' the tool's twist (linear; angular) and J q' = x', each further derivative of q solves the same system:
J q'' = x'' - J' q', J q''' = x''' - 2 J' q'' - J'' q'. What is subtracted is the tool's own acceleration and
jerk when the joints have none, found by adding the links' motions up from the base.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import ReachError, place_in_mm
from polish_sim.kernel_cache import njit
from polish_sim.kernels import (
    Matrix4,
    Matrix6,
    Record,
    Triple,
    Vector6,
    add_to,
    cross,
    kernel,
    matvec,
    minus,
    plus,
    plus_matvec,
    scaled,
    second_by_turning,
    set_product,
    set_to,
    third_by_turning,
)
from polish_sim.motion.kinematics import advance_frame, beyond_range, solve_on_branch
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm
from polish_sim.motion.rules.schedule import Samples, Schedule, Smoothed

Links = Annotated[Array, (6, 3)]
Rates = Annotated[Array, (3, 6)]


class ArmState(Record):
    """Work space of one arm; all in the base frame. Link k turns with all joints up to k."""

    T: Matrix4  #: T_base_tool
    q: Vector6  #: Joint angles [rad]
    axes: Links  #: Unit joint axes
    links: Links
    """From joint k's axis to the next one's, the last to the tool point [m]; their sum, from the base's
    origin, is the tool point."""
    jacobian: Matrix6  #: Joint speeds to (linear; angular) velocity of the tool point
    inverse: Matrix6
    twists: Rates  #: Wanted (linear; angular) velocity of the tool and its next two derivatives
    rates: Rates  #: First to third derivative of the joint angles
    scratch: Annotated[Array, (6, 12)]


@njit(inline="always")
def place_arm(state: ArmState, rows: Array, T_flange_tool: Array) -> bool:
    """Fill all but rates and twists for the angles in ``state.q``; whether the Jacobian could be inverted.

    ``rows`` are the arm's table, of `joint_rows`.
    """
    _fill_links(state, rows, T_flange_tool)
    _fill_jacobian(state)
    return invert(state.jacobian, state.inverse, state.scratch)


@njit(inline="always")
def _fill_links(state: ArmState, rows: Array, T_flange_tool: Array) -> None:
    """Axes and link vectors by the chain of Denavit-Hartenberg frames."""
    T = state.scratch[:3, :4]
    for i in range(3):
        for j in range(3):
            T[i, j] = 1.0 if i == j else 0.0
    for k in range(6):
        for i in range(3):
            state.axes[k, i] = T[i, 2]
            T[i, 3] = 0.0
        advance_frame(T, rows[k], state.q[k])
        for i in range(3):
            state.links[k, i] = T[i, 3]
    add_to(state.links[5], matvec(T, T_flange_tool[:, 3]))


@njit(inline="always")
def _fill_jacobian(state: ArmState) -> None:
    """Columns z x (tool point - joint); z."""
    J, axes, links = state.jacobian, state.axes, state.links
    arm = 0.0, 0.0, 0.0
    for i in range(5, -1, -1):
        arm = plus(arm, links[i])
        set_to(J[:, i], cross(axes[i], arm))
        set_to(J[3:, i], axes[i])


@njit(_nrt=False, no_cpython_wrapper=True)
def solve_rates(state: ArmState) -> None:
    """Write the three derivatives of q that give the tool the motion in ``twists``."""
    _solve(state, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    _solve_second(state)
    _solve_third(state)


@njit(inline="always")
def _solve(state: ArmState, row: int, linear: Triple, angular: Triple) -> None:
    """rates[row] = inverse (twists[row] - (linear; angular))."""
    m = state.inverse
    twist = state.twists[row]
    x, y, z = minus(twist, linear)
    a, b, c = minus(twist[3:], angular)
    for i in range(6):
        state.rates[row, i] = (
            m[i, 0] * x + m[i, 1] * y + m[i, 2] * z + m[i, 3] * a + m[i, 4] * b + m[i, 5] * c
        )


@njit(inline="always")
def _solve_second(state: ArmState) -> None:
    """q'' after q': every link's turning w and its derivative e without q'', from the base outwards."""
    axes, links, q1 = state.axes, state.links, state.rates[0]
    w = e = linear = 0.0, 0.0, 0.0
    for k in range(6):
        e = plus(e, scaled(q1[k], cross(w, axes[k])))
        w = plus(w, scaled(q1[k], axes[k]))
        linear = plus(linear, second_by_turning(w, e, links[k]))
    _solve(state, 1, linear, e)


@njit(inline="always")
def _solve_third(state: ArmState) -> None:
    """q''' after q' and q'': turning w, its derivative e with q'', its second derivative f without q'''."""
    axes, links, q1, q2 = state.axes, state.links, state.rates[0], state.rates[1]
    w = e = f = linear = 0.0, 0.0, 0.0
    for k in range(6):
        z, a, b = axes[k], q1[k], q2[k]
        u = cross(w, z)
        f = plus(f, plus(scaled(2.0 * b, u), scaled(a, second_by_turning(w, e, z))))
        e = plus(plus(e, scaled(b, z)), scaled(a, u))
        w = plus(w, scaled(a, z))
        linear = plus(linear, third_by_turning(w, e, f, links[k]))
    _solve(state, 2, linear, f)


@njit(inline="always")
def invert(matrix: Array, inverse: Array, scratch: Array) -> bool:
    """Invert a 6x6 matrix by Gauss-Jordan elimination with row pivoting; ``scratch``: (6, 12).

    Returns whether all pivots were above 1e-12.
    """
    for i in range(6):
        for j in range(6):
            scratch[i, j] = matrix[i, j]
            scratch[i, j + 6] = 1.0 if i == j else 0.0
    for column in range(6):
        best = column
        for row in range(column + 1, 6):
            if abs(scratch[row, column]) > abs(scratch[best, column]):
                best = row
        if not abs(scratch[best, column]) > 1e-12:
            return False
        if best != column:
            for j in range(12):
                scratch[column, j], scratch[best, j] = scratch[best, j], scratch[column, j]
        pivot = 1.0 / scratch[column, column]
        for j in range(column, 12):
            scratch[column, j] *= pivot
        for row in range(6):
            share = scratch[row, column]
            if row != column and share != 0.0:
                for j in range(column, 12):
                    scratch[row, j] -= share * scratch[column, j]
    for i in range(6):
        for j in range(6):
            inverse[i, j] = scratch[i, j + 6]
    return True


REACHED, UNREACHABLE, SINGULAR, BEYOND = 0, 1, 2, 3  #: Of a place; BEYOND: a joint is out of its range


class JointRates(NamedTuple):
    """Joint angles and their derivatives at n places."""

    q: Array  #: [rad], shape (n, 6)
    first: Array  #: By progress or time, shape (n, 6)
    second: Array
    third: Array


@njit(_nrt=False, no_cpython_wrapper=True)
def reach_pose(state: ArmState, arm: Arm) -> int:
    """Bring the tool to the state's pose on the branch its joint angles are on, and place the arm.

    Returns REACHED, UNREACHABLE or SINGULAR.
    """
    set_product(state.scratch, state.T, arm.T_tool_flange)
    if not solve_on_branch(arm.lengths, state.scratch, state.q, state.q):
        return UNREACHABLE
    return REACHED if place_arm(state, arm.rows, arm.T_flange_tool) else SINGULAR


@kernel
def _keep_rates(state: ArmState, out: JointRates, row: int) -> None:
    """Write the joint angles and their derivatives into a row."""
    for j in range(6):
        out.q[row, j] = state.q[j]
        out.first[row, j] = state.rates[0, j]
        out.second[row, j] = state.rates[1, j]
        out.third[row, j] = state.rates[2, j]


def chain_rates(chain: Chain, nodes: Array, arm: Arm) -> JointRates:
    """Joint angles and derivatives by progress at the same ``nodes`` (m,) of each of n segments, shape (n, m,
    6).

    The chain is in the work frame; see `chebyshev_nodes`. Divide by length^k for derivatives by arc length.

    Raises:
        ReachError: A place cannot be reached, is singular, or has a joint beyond its range.
    """
    n, m = len(chain.lengths), len(nodes)
    starts: Array = 2.0 * np.arange(n, dtype=np.float64)
    # At a constant rate past the end of each segment: derivatives there are not those at rest.
    steady = Schedule(np.arange(n), starts, np.full(n, 1.5), np.tile([0.0, 1.0, 0.0, 0.0], (n, 1)), 2.0 * n)
    tool = Smoothed(chain, steady).sample((starts[:, None] + nodes).ravel())
    rates = sampled_joints(tool, arm, m)
    for row in np.flatnonzero(beyond_range(rates.q).any(axis=1))[:1]:
        raise unreachable(BEYOND, row // m, tool.tips[row, 0])
    return JointRates(*(column.reshape(n, m, 6) for column in rates))


def chebyshev_nodes(count: int) -> Array:
    """Extremes of a Chebyshev polynomial on [0, 1], both ends included, rising, shape (count,)."""
    return 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count))


def joint_motion(
    tips: Array, rotations: Array, linear: Array, angular: Array, arm: Arm, together: int = 1
) -> JointRates:
    """Joint motion (n, 6) of a tool motion given with its derivatives in time, exact at every sample.

    Tool points (n, 3) [m] and R_work_tool (n, 3, 3) are dense enough to stay on one branch of the arm.
    ``linear`` holds velocity, acceleration and jerk of the tool point, ``angular`` the spatial angular
    velocity and its first two derivatives, (3, n, 3) each, SI, work frame. An error counts as many samples
    ``together`` as one segment.

    Raises:
        ReachError: A sample cannot be reached, or is singular.
    """
    out = JointRates(*np.full((4, len(tips), 6), np.nan))
    given = (np.ascontiguousarray(each) for each in (tips, rotations, linear, angular))
    status, row = _fill_motion(*given, arm, ArmState(q=arm.q_start), out)
    if status != REACHED:
        raise unreachable(status, row // together, tips[row])
    return out


def sampled_joints(tool: Samples, arm: Arm, together: int = 1) -> JointRates:
    """Joint motion (n, 6) of a sampled tool motion; see `joint_motion`."""
    linear, angular = tool.tips[:, 1:].swapaxes(0, 1), tool.spins.swapaxes(0, 1)
    return joint_motion(tool.tips[:, 0], tool.rotations, linear, angular, arm, together)


@njit
def _fill_motion(
    tips: Array, rotations: Array, linear: Array, angular: Array, arm: Arm, state: ArmState, out: JointRates
) -> tuple[int, int]:
    """Joint rates of every sample; (status, row) of the first that fails, or (REACHED, -1)."""
    T, base = state.T, arm.T_base_work
    T[3, 3] = 1.0
    for row in range(len(tips)):
        set_to(T[:, 3], plus_matvec(base[:, 3], base, tips[row]))
        for i in range(3):
            set_to(T[:, i], matvec(base, rotations[row, :, i]))
        status = reach_pose(state, arm)
        if status != REACHED:
            return status, row
        for i in range(3):
            set_to(state.twists[i], matvec(base, linear[i, row]))
            set_to(state.twists[i, 3:], matvec(base, angular[i, row]))
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
