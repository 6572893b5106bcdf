"""Types of the arrays and figures that flow between modules, and sums and products of arrays of vectors;
docstrings say shapes and units."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]
#: What a run, a plan or a calibration reports, by the names of metrics.json
Figures = dict[str, Any]
SLICE = 16_384
N = TypeVar("N", bound=tuple[Any, ...])


class Uncertain:
    """Parameters found with their covariance."""

    covariance: Array  #: Shape (p, p)

    @property
    def std(self) -> Array:
        """Standard deviations of the parameters, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))


def norms(vectors: Array) -> Array:
    """Lengths of vectors (..., k), shape (...)."""
    return np.sqrt(dots(vectors, vectors))


def dots(first: Array, second: Array) -> Array:
    """Scalar products of vectors (..., k) and others, shape (...)."""
    products = first * second
    if products.shape[-1] == 3:  # the same bits as a sum along the rows, in a tenth of the time
        return products[..., 0] + products[..., 1] + products[..., 2]
    return products.sum(axis=-1)


def chord_lengths(points: Array) -> Array:
    """Distances from each of points (n, k) to the next, shape (n - 1,)."""
    return norms(np.diff(points, axis=0))


def unit(vectors: Array) -> Array:
    """Scale vectors (..., 3) to length one; zero stays zero."""
    return vectors / np.maximum(norms(vectors)[..., None], 1e-300)


def crosses(first: Array, second: Array) -> Array:
    """Vector products of vectors (..., 3), bit for bit those of `np.cross`, whose look at the axes takes most
    of its time where vectors are few."""
    ahead, behind = [1, 2, 0], [2, 0, 1]
    return first.take(ahead, -1) * second.take(behind, -1) - first.take(behind, -1) * second.take(ahead, -1)


def into_plane(directions: Array, normals: Array) -> Array:
    """Components across unit normals, n x (v x n) (paper 1, eq. 4)."""
    return directions - dots(directions, normals)[..., None] * normals


def directions_at(angles: Array) -> Array:
    """Unit vectors in a plane at angles (n,) [rad] from its first axis, shape (n, 2)."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def angles_between(first: Array, second: Array) -> Array:
    """Angles between vectors, exact for small ones too, (n, 3) each -> (n,) [rad]."""
    return np.arctan2(norms(crosses(first, second)), dots(first, second))


def foot_on_chord(away: Array, chord: Array) -> tuple[Array, Array]:
    """Where along chords (..., d) the nearest point to points ``away`` (..., d) from their beginnings lies.

    Returns shares of the chords, 0 to 1, and distances, shape (...).
    """
    share = np.clip(dots(away, chord) / np.maximum(dots(chord, chord), 1e-300), 0.0, 1.0)
    return share, norms(away - share[..., None] * chord)


def turns_along(directions: Array) -> Array:
    """Angles from each vector to the next [rad], (n, 3) -> (n - 1,)."""
    return angles_between(directions[:-1], directions[1:])


def perpendicular(vectors: Array) -> Array:
    """A unit vector square to each vector and to the coordinate axis it runs along least, shape (..., 3).

    It does not turn with the vectors: where a result must turn with the part, nothing may depend on the
    choice.
    """
    return unit(crosses(vectors, np.eye(3)[np.abs(vectors).argmin(axis=-1)]))


def plane_axes(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors square to each unit normal and to each other, as of `perpendicular`, (..., 3) each."""
    first = perpendicular(normals)
    return first, crosses(normals, first)


def turned(first: Array, second: Array, angles: Any) -> Array:
    """Vectors (..., 3) at angles (...) [rad] from ``first`` towards ``second``, unit vectors square to each
    other; arrays broadcast."""
    return np.cos(angles)[..., None] * first + np.sin(angles)[..., None] * second


def two_waves(phase: Array) -> Array:
    """Sine and cosine of angles (...) [rad], and those of twice the angles, shape (..., 4)."""
    return np.stack([np.sin(phase), np.cos(phase), np.sin(2.0 * phase), np.cos(2.0 * phase)], axis=-1)


def parts_between(values: Array, edges: Iterable[Any]) -> Array:
    """The parts of values (...) from zero to the first of k rising edges, between them and beyond the last,
    which add up to the values, shape (k + 1, ...); edges broadcast."""
    ends = [np.minimum(np.abs(values), edge) for edge in (0.0, *edges, np.inf)]
    return np.sign(values) * np.diff(ends, axis=0)


def running_sums(values: Any) -> Any:
    """Sums of the first 0, 1 ... n of some values (n,), shape (n + 1,): arc lengths from chords, where parts
    begin."""
    return np.concatenate([[0], np.cumsum(values)])


def rms(values: Any) -> float:
    """Root mean square of numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


def rms_length(vectors: Array) -> float:
    """Root mean square of the lengths of vectors (n, k)."""
    return float(np.sqrt(np.mean(dots(vectors, vectors))))


def midpoints(values: Array) -> Array:
    """Means of neighbours (n, ...), shape (n - 1, ...)."""
    return 0.5 * (values[1:] + values[:-1])


def spans_at(knots: Array, places: Array) -> Indices:
    """Which span between rising knots (n,) each of some places is in, the first or the last beyond their
    ends."""
    return np.clip(np.searchsorted(knots, places, side="right") - 1, 0, len(knots) - 2)


def evenly_to(end: float, spacing: float, least: int = 1, start: float = 0.0) -> Array:
    """Even values from ``start`` to ``end``, both included, no further apart than a spacing; ``least`` steps
    or more."""
    return np.linspace(start, end, max(math.ceil((end - start) / spacing), least) + 1)


def longest_side(points: Array) -> float:
    """Of the box around points (n, k)."""
    return float(np.ptp(points, axis=0).max())


def box_middle(points: Array) -> Array:
    """Middle of the box around points (n, k), shape (k,)."""
    return 0.5 * (points.min(axis=0) + points.max(axis=0))


def diagonal_of(points: Array) -> float:
    """Diagonal of the box around points (n, k), in their unit."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def boxes_of(corners: Array) -> tuple[Array, Array]:
    """Least and greatest of corners (m, k, 3), both (m, 3); numpy itself takes ten times as long along such
    short rows."""
    rows = corners.swapaxes(0, 1).copy()
    return rows.min(axis=0), rows.max(axis=0)


def next_corners(corners: Any) -> Any:
    """What facets (m, 3, ...) have at each corner's successor: where their edges end."""
    return np.roll(corners, -1, axis=1)


def joined(groups: Any) -> Iterator[Any]:
    """The columns of groups of arrays, each group's rows behind those before."""
    return (np.concatenate(columns) for columns in zip(*groups, strict=True))


def some_rows(columns: N, kept: Any) -> N:
    """Some rows of a named tuple of arrays: a slice, a mask (n,) or numbers."""
    named: Any = type(columns)
    return named(*(column[kept] for column in columns))  # type: ignore[no-any-return]


def in_groups(counts: Any) -> tuple[Indices, Indices]:
    """Group of each of ``counts`` (n,) items, group after group, and its place in it, (m,) each."""
    group = np.repeat(np.arange(len(counts)), counts)
    return group, np.arange(len(group)) - (np.cumsum(counts) - counts)[group]


def summed(labels: Any, rows: Array, count: int) -> Array:
    """Sums of rows (..., k) of each of ``count`` labels (...), shape (count, k)."""
    flat, columns = labels.ravel(), rows.reshape(-1, rows.shape[-1]).T
    return np.column_stack([np.bincount(flat, weights=column, minlength=count) for column in columns])


def by_slices(function: Callable[..., Any], *rows: Any) -> Any:
    """What a function makes of rows (n, ...), from `SLICE` rows at a time: what it holds on its way stays
    small."""
    made = np.empty(0)
    for start in range(0, max(len(rows[0]), 1), SLICE):
        part = function(*(array[start : start + SLICE] for array in rows))
        if start == 0:
            made = np.empty((len(rows[0]), *part.shape[1:]), part.dtype)
        made[start : start + SLICE] = part
    return made
