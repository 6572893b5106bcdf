"""What every writer needs: its settings, the path's strokes, tool frames, and the rows that must stay."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, chord_lengths, into_plane, norms, unit
from polish_sim.config import ProcessConfig, SpindleConfig
from polish_sim.errors import InputError, PlanError
from polish_sim.kernel_cache import njit
from polish_sim.kernels import dot, minus, plus, scaled
from polish_sim.planning.quality.tool_room import CHECKED_APART
from polish_sim.planning.toolpath import LEAD_IN, LEAD_OUT, RETRACT, ToolPath, stretches
from polish_sim.spatial import steady_rotations

if TYPE_CHECKING:
    from polish_sim.planning import PlanResult


@dataclass(frozen=True)
class RobotTool:
    """The tool as a robot controller needs it; the defaults are the shipped cell's (models/README.md)."""

    tcp_pose: tuple[float, ...] = (0.0, 0.0, 0.22, 0.0, 0.0, 0.0)
    """Middle of the pad's face in the flange: x, y, z [m], rotation vector [rad]; z points into the part."""
    payload_kg: float = 2.0  #: Mass of everything behind the flange [kg]
    payload_center_m: tuple[float, float, float] = (0.002, 0.0, 0.0974)  #: Its centre in the flange frame [m]
    spindle_output: int = 0  #: Standard digital output that switches the spindle
    spindle_wait_s: float = 2.0  #: Time the spindle takes to come up to speed [s]


@dataclass(frozen=True)
class ExportSetup:
    """What the writers take beside the plan."""

    process: ProcessConfig = ProcessConfig()
    spindle: SpindleConfig = SpindleConfig()
    tool: RobotTool = RobotTool()
    #: Work frame in the robot's base [m], rotation vector [rad]; empty: unknown
    part_pose: tuple[float, ...] = ()
    frame_id: str = "work"  #: Name of the work frame in ROS

    def __post_init__(self) -> None:
        for name, pose in (("part_pose", self.part_pose), ("tool.tcp_pose", self.tool.tcp_pose)):
            if len(pose) not in ((0, 6) if name == "part_pose" else (6,)) or not np.isfinite(pose).all():
                raise InputError(
                    f"{name} {tuple(pose)} is no pose: wanted x, y, z [m] and a rotation vector [rad]."
                )


def feeds_of(path: ToolPath, setup: ExportSetup) -> Array:
    """Feed at every point [m/s], shape (n,): the path's own, else the process's, at leads the approach
    speed."""
    if path.feed is not None:
        return path.feed
    leads = (path.segment == LEAD_IN) | (path.segment == LEAD_OUT)
    return np.where(leads, setup.process.approach_speed_m_s, setup.process.feed_m_s)


def forces_of(path: ToolPath, setup: ExportSetup) -> Array:
    """Contact force at every point [N], shape (n,): the path's own, else the process's."""
    return path.force if path.force is not None else np.full(len(path.s), setup.process.contact_force_n)


def moves_in_part(result: PlanResult, kept: Bools) -> Bools:
    """Whether the tool is in the part on the way to each of the rows (n,) that are kept, shape (k,).

    Only of a path that was made elsewhere: a plan keeps clear.
    """
    path = result.path
    inside = np.zeros(len(result.path.s), dtype=np.bool_)
    if len(result.in_part):
        apart = 0.5 * CHECKED_APART * result.tool.pad.radius_m  # places are looked at twice as far apart
        inside = path.process & (cKDTree(result.in_part).query(path.positions_work)[0] <= apart)
    ends = np.flatnonzero(kept)
    return np.logical_or.reduceat(inside, np.append(0, ends[:-1] + 1))


def in_part_remarks(inside: Bools) -> list[str]:
    """What stands in a program where the tool comes into the part or out of it, row by row (k,); empty
    elsewhere."""
    words = {1: "the tool is in the part from here", -1: "the tool is in the part up to here"}
    return [words.get(change, "") for change in np.diff(inside.astype(int), prepend=0).tolist()]


class StrokeRows(NamedTuple):
    """Rows of one stretch in contact and of the ways to it and from it; the ways may be empty."""

    down: Indices
    contact: Indices
    up: Indices


def strokes_of(path: ToolPath) -> list[StrokeRows]:
    """Split a path where the tool leaves the part; PlanError for no point in contact, or a stroke of one
    point."""
    pieces = [np.arange(first, last + 1) for first, last in stretches(path.process)]
    if not pieces:
        raise PlanError("the path has no process point: nothing to press on. Plan it again.")
    strokes = []
    free = 0
    for number, contact in enumerate(pieces):
        if len(contact) < 2:
            raise PlanError(
                f"stroke {number + 1} of the path is a single point: there is nothing to run along."
            )
        follow = int(pieces[number + 1][0]) if number + 1 < len(pieces) else len(path.s)
        after = np.arange(contact[-1] + 1, follow)
        leaving = np.isin(path.segment[after], (LEAD_OUT, RETRACT))
        last = int(leaving.argmin()) if not leaving.all() else len(after)
        strokes.append(StrokeRows(np.arange(free, contact[0]), contact, after[:last]))
        free = int(contact[-1]) + 1 + last
    return strokes


# Tool poses along a path: z into the part, x along the feed or as steady as can be (ToolPath -> rotations).


#: A feed direction with a smaller part across the tool axis says nothing: the tool moves along its axis
ACROSS = 0.05


def feed_frames(path: ToolPath) -> Array:
    """Tool frames (n, 3, 3) with z into the part and x along the feed, the convention of ROS tool paths.

    Where the tool moves along its own axis (straight leads), x is that of the nearest point before that has
    one, at the start of the path that of the first.
    """
    z = -path.axes_work
    feed = np.diff(path.positions_work, axis=0)
    feed = np.concatenate([feed, feed[-1:]])
    feed = unit(feed)
    across = into_plane(feed, z)
    known = norms(across) > ACROSS
    if not known.any():
        raise PlanError("the path runs along the tool axis only: no feed direction to turn the tool to.")
    # The last known row at or before each row; rows before the first take the first.
    source = np.maximum.accumulate(np.where(known, np.arange(len(z)), -1))
    source = np.where(source < 0, int(known.argmax()), source)
    x = across[source]
    x = unit(into_plane(x, z))
    return np.stack([x, np.cross(z, x), z], axis=2)


def steady_frames(path: ToolPath) -> Array:
    """Tool frames (n, 3, 3) with z into the part and x as near as can be to one of the work frame's axes.

    A round pad does not care how it is turned about its axis, but a robot's last joint does: with x along the
    feed every turn of a spiral would wind it once round. Raises PlanError if tool axes point along all three
    axes of the work frame, so that no x axis is clear of them all.
    """
    rotations = steady_rotations(-path.axes_work)
    if rotations is None:
        raise PlanError(
            "tool axes point all around: along x, y and z of the work frame. One robot pass cannot reach "
            "that; plan a region that looks one way, e.g. --region top."
        )
    return rotations


# Fewer points for the same line: robots and viewers need no more than its shape asks for (ToolPath -> rows).

#: A left-out point in the air is this near the straight move [m], [rad]
AIR_CHORD_M, AIR_AXIS_RAD = 1e-6, 1e-4
PRINTED_M = 2e-9  #: Places nearer to each other may be the same where they are printed
NOTICED = 0.02  #: Relative change of force or feed that is passed on


def needed_rows(path: ToolPath, chord_m: float, axis_rad: float, longest_m: float) -> Indices:
    """Rows that must stay so that straight moves between them keep to the path.

    Ends of segments and points where force or feed change by some 2% always stay.

    Args:
        path: The path.
        chord_m: Largest distance of a left-out point from the straight move [m].
        axis_rad: Largest angle between a left-out tool axis and those at both ends of its move [rad].
        longest_m: Longest straight move over left-out points [m].
    """
    fixed = np.zeros(len(path.s), dtype=np.bool_)
    fixed[[0, -1]] = True
    wishes = [column for column in (path.force, path.feed) if column is not None]
    steps: list[NDArray[Any]] = [path.segment, *(np.round(np.log(column) / NOTICED) for column in wishes)]
    for column in steps:
        change = np.flatnonzero(np.diff(column) != 0)
        fixed[change] = fixed[change + 1] = True
    kept = np.zeros(len(path.s), dtype=np.bool_)
    _keep(path.positions_work, path.axes_work, fixed, chord_m, float(np.cos(axis_rad)), longest_m, kept)
    return np.flatnonzero(kept)


def rows_without_straight_air(path: ToolPath) -> Bools:
    """Mask of all points in contact and of those in the air at which the tool changes its way, shape (n,);
    where it turns in place the last."""
    kept = path.process.copy()
    kept[needed_rows(path, AIR_CHORD_M, AIR_AXIS_RAD, np.inf)] = True
    rows = np.flatnonzero(kept)
    kept[rows[:-1][chord_lengths(path.positions_work[rows]) < PRINTED_M]] = False
    return kept


@njit
def _keep(
    positions: Array, axes: Array, fixed: Bools, chord: float, cosine: float, longest: float, kept: Bools
) -> None:
    """Lengthen each move until a point between would be missed; mark the rows that end moves."""
    first = 0
    kept[0] = True
    last = len(fixed) - 1
    for end in range(1, last + 1):
        if fixed[end - 1] and end - 1 > first:
            kept[end - 1] = True
            first = end - 1
        if not _straight(positions, axes, first, end, chord, cosine, longest):
            kept[end - 1] = True
            first = end - 1
    kept[last] = True


@njit
def _straight(
    positions: Array, axes: Array, first: int, end: int, chord_m: float, cosine: float, longest: float
) -> bool:
    """Whether one move from a row to another leaves out only points it passes close by."""
    if end == first + 1:
        return True
    chord = minus(positions[end], positions[first])
    length = dot(chord, chord)
    if length > longest * longest:
        return False
    for row in range(first + 1, end):
        away = minus(positions[row], positions[first])
        share = min(max(dot(away, chord) / length, 0.0), 1.0) if length > 0.0 else 0.0
        beside = minus(positions[row], plus(positions[first], scaled(share, chord)))
        lean = min(dot(axes[row], axes[first]), dot(axes[row], axes[end]))
        if dot(beside, beside) > chord_m * chord_m or lean < cosine:
            return False
    return True
