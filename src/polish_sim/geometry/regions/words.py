"""The words a user may say for a region, and reading their numbers (text -> metres, facet numbers)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError

Floats = NDArray[np.float64]

CHOICES = (
    "auto, top, all, point:X,Y,Z, box:X0,Y0,Z0,X1,Y1,Z1, polygon:X,Y,Z;X,Y,Z;..., polygon:FILE, faces:FILE "
    "(lengths in mm)"
)


def parse_numbers(argument: str, count: int, form: str) -> list[float]:
    """Read numbers separated by commas.

    Raises:
        InputError: They are not as many as asked for, or not numbers.
    """
    try:
        numbers = [float(word) for word in argument.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        name = form.partition(":")[0]
        raise InputError(f"region '{name}:{argument}' is not {form} ({count} numbers in mm). Valid: {CHOICES}.")
    return numbers


def parse_point(argument: str) -> Floats:
    """Read a point [m], shape (3,)."""
    return np.array(parse_numbers(argument, 3, "point:X,Y,Z")) * 1e-3


def parse_box(argument: str) -> Floats:
    """Read the least and the greatest corner of a box [m], shape (2, 3).

    Raises:
        InputError: Not six numbers, or a box without volume.
    """
    corners = np.sort(np.reshape(parse_numbers(argument, 6, "box:X0,Y0,Z0,X1,Y1,Z1"), (2, 3)), axis=0)
    if (corners[0] == corners[1]).any():
        raise InputError(f"region 'box:{argument}' has no volume. Give two opposite corners in mm.")
    return corners * 1e-3


def parse_corners(argument: str) -> Floats:
    """Read the corners of a polygon, in the option itself or from a file [m], shape (n, 3).

    Raises:
        InputError: Not a list of three or more corners.
    """
    named = ";" not in argument
    lines = _read(Path(argument), "corners x, y, z in mm, one per line").splitlines() if named else argument.split(";")
    rows = [line.partition("#")[0].replace(",", " ").split() for line in lines]
    try:
        corners = np.array([[*map(float, row), 0.0][:3] for row in rows if row])
    except ValueError:
        corners = np.empty(0)
    whole = all(len(row) in (0, 2, 3) for row in rows)
    if not whole or corners.ndim != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise InputError(
            f"region 'polygon:{argument}' is not a polygon: give three or more corners X,Y,Z;X,Y,Z;... in mm, "
            "or a text file with x, y, z of one corner per line ('#' for comments)."
        )
    return corners * 1e-3


def read_facet_numbers(argument: str) -> NDArray[np.int64]:
    """Read facet numbers from a text file, shape (n,).

    Raises:
        InputError: The file cannot be read, or holds something else.
    """
    path = Path(argument)
    lines = _read(path, "facet numbers").splitlines()
    try:
        words = [word for line in lines for word in line.partition("#")[0].replace(",", " ").split()]
        numbers = np.array([int(word) for word in words], dtype=np.int64)
    except (ValueError, OverflowError):
        raise InputError(f"{path}: not a list of facet numbers (whole numbers from 0, '#' for comments).") from None
    if len(numbers) == 0:
        raise InputError(f"{path}: lists no facet numbers (whole numbers from 0, '#' for comments).")
    return numbers


def _read(path: Path, content: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}). Give a text file of {content}.") from None
    except (UnicodeDecodeError, ValueError):
        raise InputError(f"{path}: is not a text file. Give a text file of {content}.") from None
