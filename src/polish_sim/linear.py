"""The inverse of a 6x6 matrix for compiled kernels, on arrays that are filled again."""

from __future__ import annotations

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit


@njit(cache=True, error_model="numpy")
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
