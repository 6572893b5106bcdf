"""What compiled kernels share: how they are compiled, and how their mutable state is declared.

State is one numpy record per struct: named fields, integers, booleans and nested arrays that Python and
compiled code change in place. Constants and arrays whose length is not known beforehand travel beside it in
NamedTuples.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Self, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit

Vector2 = Annotated[Array, (2,)]
Vector3 = Annotated[Array, (3,)]
Vector4 = Annotated[Array, (4,)]
Vector6 = Annotated[Array, (6,)]
Matrix3 = Annotated[Array, (3, 3)]
Matrix4 = Annotated[Array, (4, 4)]
Matrix6 = Annotated[Array, (6, 6)]

kernel = njit(cache=False, forceinline=True)
"""Compiled into the kernels that call it and kept on disk only with them; callable from Python, too."""

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
        formats = {name: _format(hint) for name, hint in hints.items() if name != "dtype"}
        ends = np.cumsum([0] + [-(-np.dtype(form).itemsize // 8) * 8 for form in formats.values()])
        layout: Any = {
            "names": list(formats),
            "formats": list(formats.values()),
            "offsets": ends[:-1],
            "itemsize": ends[-1],
        }
        cls.dtype = np.dtype((np.record, np.dtype(layout, align=True)))

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


@kernel
def dot(a: Array, b: Array) -> float:
    """Scalar product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]  # type: ignore[no-any-return]


@kernel
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float]:
    """Vector product."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
