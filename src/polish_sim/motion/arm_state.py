"""The arm at one configuration: axes, link vectors and inverse Jacobian, in arrays that are filled again (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.kinematics import DH_A, DH_ALPHA, DH_D

Array = NDArray[np.float64]

_SINES = tuple(float(round(math.sin(a))) for a in DH_ALPHA)
_COSINES = tuple(float(round(math.cos(a))) for a in DH_ALPHA)
_A, _D = tuple(float(a) for a in DH_A), tuple(float(d) for d in DH_D)


class ArmState(NamedTuple):
    """Work space of one arm; all in the base frame. Link k turns with all joints up to k."""

    q: Array
    """Joint angles [rad], shape (6,)."""
    axes: Array
    """Unit joint axes, shape (6, 3)."""
    links: Array
    """From joint k's axis to the next one's, the last to the tool point [m], shape (6, 3); their sum, from the base's
    origin, is the tool point."""
    jacobian: Array
    """Joint speeds to (linear; angular) velocity of the tool point, shape (6, 6)."""
    inverse: Array
    """Its inverse, shape (6, 6)."""
    twists: Array
    """Wanted (linear; angular) velocity of the tool and its next derivatives, shape (4, 6)."""
    rates: Array
    """First to third derivative of the joint angles, shape (3, 6)."""
    scratch: Array
    """Shape (6, 12)."""


def new_arm_state() -> ArmState:
    """Fresh work space."""
    return ArmState(
        np.zeros(6),
        np.zeros((6, 3)),
        np.zeros((6, 3)),
        np.zeros((6, 6)),
        np.zeros((6, 6)),
        np.zeros((4, 6)),
        np.zeros((3, 6)),
        np.zeros((6, 12)),
    )


@njit(cache=True, error_model="numpy")
def place_arm(state: ArmState, T_flange_tool: Array) -> bool:
    """Fill axes, links, Jacobian and its inverse for the angles in ``state.q``.

    Args:
        state: Work space; all but rates and twists are written.
        T_flange_tool: The tool on the flange, shape (4, 4).

    Returns:
        Whether the Jacobian could be inverted.
    """
    _fill_links(state, T_flange_tool)
    _fill_jacobian(state)
    return invert6(state.jacobian, state.inverse, state.scratch)


@njit(cache=True, error_model="numpy")
def _fill_links(state: ArmState, T_flange_tool: Array) -> None:
    """Axes and link vectors by the chain of Denavit-Hartenberg frames."""
    xx, xy, xz = 1.0, 0.0, 0.0
    yx, yy, yz = 0.0, 1.0, 0.0
    zx, zy, zz = 0.0, 0.0, 1.0
    for i in range(6):
        c, s, sine, cosine = math.cos(state.q[i]), math.sin(state.q[i]), _SINES[i], _COSINES[i]
        state.axes[i, 0], state.axes[i, 1], state.axes[i, 2] = zx, zy, zz
        ux, uy, uz = c * xx + s * yx, c * xy + s * yy, c * xz + s * yz
        vx, vy, vz = c * yx - s * xx, c * yy - s * xy, c * yz - s * xz
        state.links[i, 0] = _D[i] * zx + _A[i] * ux
        state.links[i, 1] = _D[i] * zy + _A[i] * uy
        state.links[i, 2] = _D[i] * zz + _A[i] * uz
        xx, xy, xz = ux, uy, uz
        yx, yy, yz, zx, zy, zz = (
            cosine * vx + sine * zx,
            cosine * vy + sine * zy,
            cosine * vz + sine * zz,
            cosine * zx - sine * vx,
            cosine * zy - sine * vy,
            cosine * zz - sine * vz,
        )
    px, py, pz = T_flange_tool[0, 3], T_flange_tool[1, 3], T_flange_tool[2, 3]
    state.links[5, 0] += xx * px + yx * py + zx * pz
    state.links[5, 1] += xy * px + yy * py + zy * pz
    state.links[5, 2] += xz * px + yz * py + zz * pz


@njit(cache=True, error_model="numpy")
def _fill_jacobian(state: ArmState) -> None:
    """Columns z x (tool point - joint); z."""
    J, axes, links = state.jacobian, state.axes, state.links
    rx, ry, rz = 0.0, 0.0, 0.0
    for i in range(5, -1, -1):
        rx, ry, rz = rx + links[i, 0], ry + links[i, 1], rz + links[i, 2]
        x, y, z = axes[i, 0], axes[i, 1], axes[i, 2]
        J[0, i], J[1, i], J[2, i] = y * rz - z * ry, z * rx - x * rz, x * ry - y * rx
        J[3, i], J[4, i], J[5, i] = x, y, z


@njit(cache=True, error_model="numpy")
def invert6(matrix: Array, inverse: Array, scratch: Array) -> bool:
    """Invert a 6x6 matrix by Gauss-Jordan elimination with row pivoting; False if a pivot vanishes.

    Args:
        matrix: Shape (6, 6), kept.
        inverse: Written, shape (6, 6).
        scratch: Work space, shape (6, 12).

    Returns:
        Whether all pivots were above 1e-12.
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
