"""A path as read from a file, with the checks every path passes, and the handling of unknown words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Indices, norms
from polish_sim.errors import InputError
from polish_sim.planning.toolpath import PROCESS, RETRACT, ToolPath, arc_length
from polish_sim.tables import FileRows, Place

# What every path read from a file must satisfy: numbers, unit axes, sane lengths (columns -> checked arrays).


UNIT_TOLERANCE = 1e-3  #: A tool axis may differ from length 1 by the rounding of printed digits
LARGEST_M = 100.0  #: A coordinate beyond this [m] is a wrong unit, not a path a robot could follow


class PathRows(FileRows):
    """Points of a path in a file."""

    def place(self, row: int) -> str:
        """Where a point stands; in a path.json there are no lines."""
        return f"line {self.lines[row]}, point {row + 1}" if self.lines else f"point {row + 1}"

    def unit_axes(self, names: Sequence[str], axes: Array) -> Array:
        """Tool axes (n, 3) brought to length 1 exactly; InputError if one is no unit vector to printed
        precision."""
        length = norms(axes)
        self.refuse(
            np.abs(length - 1.0) > UNIT_TOLERANCE,
            lambda row: (
                f"the tool axis ({', '.join(names)}) has length {length[row]:.4g}, wanted 1: a unit "
                "vector from the part to the tool."
            ),
        )
        return axes / length[:, None]

    def checked_length(self, positions: Array) -> Array:
        """Arc length (n,) of points (n, 3) [m]; InputError for fewer than two, or coordinates no robot
        reaches."""
        self.refuse(
            np.abs(positions).max(axis=1, initial=0.0) > LARGEST_M,
            lambda _: (
                f"a coordinate beyond {LARGEST_M:g} m. Plain CSV is in mm, path.csv in m: correct the unit."
            ),
        )
        if len(positions) < 2:
            count = "one point" if len(positions) == 1 else "0 points"
            raise InputError(f"'{self.file}' is no path: it has {count}. Two are the least.")
        return arc_length(positions)


#: Called with an unknown word that can be skipped: raises the error or notes it
Unknown = Callable[[InputError], None]


class WayPoints(NamedTuple):
    """A path read from a file: points may repeat, and the tool may turn where it stands."""

    path: ToolPath  #: The points; arc length does not fall, but may stay
    file: Path
    place: Place  #: Where in the file a point stands
    assumed: str = ""  #: What the file does not say and is taken for granted, as a sentence; empty if nothing


def refuse_unknown(error: InputError) -> None:
    """Refuse what is unknown: raises the error."""
    raise error


# What CAM paths say by RAPID and feed: segments, strokes and feeds of their points.

Codes = NDArray[np.int8]


@dataclass
class CamPoints(PathRows):
    """The points of a CAM path, gathered statement by statement."""

    file: Path
    rows: list[tuple[float, ...]] = field(default_factory=list)
    """Position [m] and tool axis of each, feed [m/s], force [N] and number of the stroke; NaN what is not
    said."""
    segments: list[int] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)  #: Where they stand

    def add(self, line: int, segment: int, *row: float) -> None:
        """Take up one more point."""
        self.rows.append(row)
        self.segments.append(segment)
        self.lines.append(line)

    def path(self, no_points: str, no_feed: str) -> ToolPath:
        """The whole path; ``no_points`` and ``no_feed`` say what is wrong with a file without any."""
        if not self.rows:
            raise InputError(f"'{self.file}' holds no points: {no_points}")
        table = np.array(self.rows, dtype=np.float64)
        axes = self.unit_axes(("i", "j", "k"), table[:, 3:6])
        segment = np.array(self.segments, dtype=np.int8)
        noted = np.isfinite(table[:, 8]).all()
        if not (segment == PROCESS).any():
            raise InputError(f"'{self.file}': every {no_feed}")
        stroke = table[:, 8].astype(np.int64) if noted else _numbered_strokes(segment)
        if not noted:
            segment[np.flatnonzero(segment == PROCESS)[-1] + 1 :] = RETRACT
        return ToolPath(
            table[:, :3].copy(),
            axes,
            self.checked_length(table[:, :3]),
            stroke,
            segment,
            np.zeros(len(table)),
            table[:, 7].copy() if np.isfinite(table[:, 7]).all() else None,
            _feeds_from_first(table[:, 6]),
        )


def _numbered_strokes(segment: Codes) -> Indices:
    """Number of the stroke of every point, (n,): a new one begins where the tool comes down from the air."""
    begins = np.diff((segment == PROCESS).astype(int), prepend=0) > 0
    return np.maximum(np.cumsum(begins) - 1, 0)


def _feeds_from_first(feed: Array) -> Array | None:
    """Feed at every point (n,) from feeds that are NaN before the first one: that one holds; None if there is
    none."""
    known = np.flatnonzero(np.isfinite(feed))
    if not len(known):
        return None
    return np.where(np.arange(len(feed)) < known[0], feed[known[0]], feed)
