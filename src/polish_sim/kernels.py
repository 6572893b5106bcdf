"""What compiled kernels share: how they are compiled, and how their mutable state is declared.

State is one numpy record per struct: named fields, integers, booleans and nested arrays that Python and
compiled code change in place. Constants and arrays whose length is not known beforehand travel beside it in
bundles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self, dataclass_transform, get_args, get_origin, get_type_hints

import numpy as np
from numba import typeof
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.kernel_cache import BundleType, njit

Vector2 = Annotated[Array, (2,)]
Vector3 = Annotated[Array, (3,)]
Vector4 = Annotated[Array, (4,)]
Vector6 = Annotated[Array, (6,)]
Matrix3 = Annotated[Array, (3, 3)]
Matrix4 = Annotated[Array, (4, 4)]
Matrix6 = Annotated[Array, (6, 6)]

part = njit(cache=False)
"""Compiled for the kernels that call it and kept on disk only with them; callable from Python, too."""
bare = njit(cache=False, _nrt=False)
"""A part that allocates nothing: no references are counted in it and what it calls."""
kernel = njit(cache=False, forceinline=True)
"""A part that is put in the place of each call."""

Triple = tuple[float, float, float]
Vector = Array | Triple
Matrix = Array | tuple[Triple, Triple, Triple]

_SCALARS = {float: np.float64, int: np.int64, bool: np.bool_}


class Record:
    """Base of records: annotate the fields of a subclass, then call it with values; the other fields are
    zero.

    The call returns a `numpy.record` that owns its memory. Fields are ``float``, ``int``, ``bool``, another
    record or an array of fixed shape such as ``Vector3``, ``Annotated[Indices, (n,)]`` or
    ``Annotated[list[Other], (n,)]``.
    """

    dtype: ClassVar[Any]

    def __init_subclass__(cls) -> None:
        hints = get_type_hints(cls, include_extras=True)
        fields = [(name, _format(hint)) for name, hint in hints.items() if name != "dtype"]
        cls.dtype = np.dtype((np.record, np.dtype(fields, align=True)))

    def __new__(cls, *values: Any, **named: Any) -> Self:
        """Make a record with values for its first fields, and by name."""
        state = np.zeros(1, cls.dtype)[0]
        for name, value in (dict(zip(cls.dtype.names, values, strict=False)) | named).items():
            state[name] = value
        return state  # type: ignore[no-any-return]


def _format(hint: Any) -> Any:
    """Type of a field for numpy."""
    if get_origin(hint) is Annotated:
        element, shape = get_args(hint)
        while parts := get_args(element):  # newer numpy's `NDArray` is an alias of one argument
            element = parts[-1]
        return (element.dtype if issubclass(element, Record) else element, shape)
    if hint in _SCALARS:
        return _SCALARS[hint]
    return hint.dtype


def memory_of(record: Any) -> NDArray[np.uint8]:
    """The bytes of a record, the same memory, shape (size,): for compiled code that takes an address."""
    return np.asarray(record).reshape(1).view(np.uint8)


@dataclass_transform(frozen_default=True, eq_default=False)
class Bundle:
    """Base of what kernels get as one address: numbers, arrays, records and bundles, fixed once it is made.

    Annotate a subclass as a NamedTuple; kernels read its fields and cannot make one. An array that a kernel
    takes out of a bundle lives as long as the bundle.
    """

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, eq=False)(cls)

    def __post_init__(self) -> None:
        values = dict(vars(self))
        fields: dict[str, Any] = {}
        words: list[int] = []
        for name, value in values.items():
            first = len(words)
            words += _words(value)
            fields[name] = typeof(value), first
        held = np.array(words)
        kind = BundleType(type(self).__name__, fields)
        vars(self).update(_values=values, _held=held, address=held.ctypes.data, _numba_type_=kind)

    def __reduce__(self) -> Any:
        return type(self), tuple(vars(self)["_values"].values())

    def _replace(self, **changed: Any) -> Self:
        return type(self)(**vars(self)["_values"] | changed)


def _words(value: Any) -> list[int]:
    """What numba passes of a value, in words of 8 bytes; of a function its address and room for two more."""
    if isinstance(value, np.ndarray):
        return [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]
    if isinstance(value, np.void):
        return [np.frombuffer(value, np.uint8).ctypes.data]  # its own memory, of an unpickled one, too
    if hasattr(value, "address"):
        return [value.address, 0, 0]
    numbers = np.atleast_1d(value)
    return list(numbers.view(np.int64) if numbers.dtype == float else numbers)


# Vectors by value. In go arrays (3,), the first three elements of longer ones, or tuples; out come tuples, so
# that nothing is allocated. Sums are added from the left, as a formula is read.


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Triple:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def plus(a: Vector, b: Vector) -> Triple:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def minus(a: Vector, b: Vector) -> Triple:
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def scaled(factor: float, v: Vector) -> Triple:
    """Product with a number."""
    return factor * v[0], factor * v[1], factor * v[2]


@kernel
def plus_cross(v: Vector, a: Vector, b: Vector) -> Triple:
    """v + a x b: a velocity or a moment, carried from one point of a body to another."""
    return (
        v[0] + a[1] * b[2] - a[2] * b[1],
        v[1] + a[2] * b[0] - a[0] * b[2],
        v[2] + a[0] * b[1] - a[1] * b[0],
    )


@kernel
def second_by_turning(w: Vector, dw: Vector, v: Vector) -> Triple:
    """Second derivative of a vector fixed in a body of angular velocity ``w``: dw x v + w x (w x v)."""
    return plus_cross(cross(dw, v), w, cross(w, v))  # type: ignore[no-any-return]


@kernel
def matvec(M: Matrix, v: Vector) -> Triple:
    """Product of a matrix (3, 3) and a vector."""
    return dot(M[0], v), dot(M[1], v), dot(M[2], v)


@kernel
def plus_matvec(p: Vector, M: Array, v: Vector) -> Triple:
    """p + M v: a place in the frame of a pose."""
    return (
        p[0] + M[0, 0] * v[0] + M[0, 1] * v[1] + M[0, 2] * v[2],
        p[1] + M[1, 0] * v[0] + M[1, 1] * v[1] + M[1, 2] * v[2],
        p[2] + M[2, 0] * v[0] + M[2, 1] * v[1] + M[2, 2] * v[2],
    )


@kernel
def turn_about(n: Vector, cosine: float, sine: float, rest: float, v: Vector) -> Triple:
    """``v`` turned about a unit axis ``n`` by the angle of this cosine and sine (Rodrigues); ``rest`` is 1 -
    cosine."""
    along = scaled(rest * dot(n, v), n)
    return plus(plus(scaled(cosine, v), scaled(sine, cross(n, v))), along)  # type: ignore[no-any-return]


@kernel
def set_to(out: Array, v: Vector) -> None:
    """Write a vector into an array (3,)."""
    out[0], out[1], out[2] = v[0], v[1], v[2]


@kernel
def add_to(out: Array, v: Vector) -> None:
    """Add a vector to an array (3,)."""
    out[0], out[1], out[2] = out[0] + v[0], out[1] + v[1], out[2] + v[2]


@kernel
def set_product(out: Array, A: Array, B: Array) -> None:
    """Write the product of two poses, (3, 4) or (4, 4), into another one's first three rows."""
    for j in range(4):
        set_to(out[:, j], matvec(A, B[:, j]))
    add_to(out[:, 3], A[:, 3])


@part
def solve_positive(A: Array, b: Array, x: Array) -> None:
    """Solve A x = b with a symmetric positive A (n, n) by Cholesky's method; its lower triangle, all that is
    read of it, is overwritten by the factor."""
    for i in range(len(x)):
        x[i] = b[i]
        for j in range(i + 1):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] = math.sqrt(max(A[i, i], 1e-300)) if i == j else A[i, j] / A[j, j]
        for k in range(i):
            x[i] -= A[i, k] * x[k]
        x[i] /= A[i, i]
    for i in range(len(x) - 1, -1, -1):
        for k in range(i + 1, len(x)):
            x[i] -= A[k, i] * x[k]
        x[i] /= A[i, i]
