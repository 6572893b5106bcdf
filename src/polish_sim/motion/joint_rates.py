"""Joint angles and their first three derivatives along a tool motion.

With x' the tool's twist (linear; angular) and J q' = x', each further derivative of q solves the same system:
J q'' = x'' - J' q', J q''' = x''' - 2 J' q'' - J'' q'. What is subtracted is the tool's own acceleration and
jerk when the joints have none, found by adding the links' motions up from the base.
"""

from __future__ import annotations

from typing import Annotated

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import (
    Matrix4,
    Matrix6,
    Record,
    Triple,
    Vector6,
    add_to,
    cross,
    matvec,
    minus,
    plus,
    scaled,
    second_by_turning,
    set_to,
    third_by_turning,
)
from polish_sim.motion.kinematics import advance_frame

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


@njit(_nrt=False, inline="always")
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


@njit(_nrt=False, inline="always")
def _fill_jacobian(state: ArmState) -> None:
    """Columns z x (tool point - joint); z."""
    J, axes, links = state.jacobian, state.axes, state.links
    arm = 0.0, 0.0, 0.0
    for i in range(5, -1, -1):
        arm = plus(arm, links[i])
        set_to(J[:, i], cross(axes[i], arm))
        set_to(J[3:, i], axes[i])


@njit(_nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def solve_rates(state: ArmState) -> None:
    """Write the three derivatives of q that give the tool the motion in ``twists``."""
    _solve(state, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    _solve_second(state)
    _solve_third(state)


@njit(_nrt=False, inline="always")
def _solve(state: ArmState, row: int, linear: Triple, angular: Triple) -> None:
    """rates[row] = inverse (twists[row] - (linear; angular))."""
    m, twist = state.inverse, state.twists[row]
    x, y, z = minus(twist, linear)
    a, b, c = minus(twist[3:], angular)
    for i in range(6):
        state.rates[row, i] = (
            m[i, 0] * x + m[i, 1] * y + m[i, 2] * z + m[i, 3] * a + m[i, 4] * b + m[i, 5] * c
        )


@njit(_nrt=False, inline="always")
def _solve_second(state: ArmState) -> None:
    """q'' after q': every link's turning w and its derivative e without q'', from the base outwards."""
    axes, links, q1 = state.axes, state.links, state.rates[0]
    w = e = linear = 0.0, 0.0, 0.0
    for k in range(6):
        e = plus(e, scaled(q1[k], cross(w, axes[k])))
        w = plus(w, scaled(q1[k], axes[k]))
        linear = plus(linear, second_by_turning(w, e, links[k]))
    _solve(state, 1, linear, e)


@njit(_nrt=False, inline="always")
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


@njit(_nrt=False, inline="always")
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
