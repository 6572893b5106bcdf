"""A program for Universal Robots e-Series that presses with force mode (plan -> URScript).

What is written is the path on the surface. The pressed-in path of a simulation without force control is never written:
a stiff robot following it would push with all it has.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.exchange.needed_rows import needed_rows
from polish_sim.exchange.setup import ExportSetup, feeds_of, forces_of
from polish_sim.exchange.strokes import StrokeRows, strokes_of
from polish_sim.exchange.tool_frames import steady_frames
from polish_sim.exchange.urscript_frame import closing, opening
from polish_sim.planning import PlanResult, ToolPath
from polish_sim.planning.toolpath import APPROACH, RETRACT

Array = NDArray[np.float64]

CHORD_M: Final = 5e-5
AXIS_RAD: Final = np.radians(3.0)
LONGEST_M: Final = 1e-2
"""Points left out lie this close to the move [m], turn this little [rad], moves are no longer than this [m]."""
BLEND_SHARE: Final = 0.4
LARGEST_BLEND_M: Final = 2e-3
"""Blends take up less than half of the moves beside them: they never overlap, which would stop the robot."""
STANDOFF_M: Final = 3e-3
"""Height above the surface at which force mode takes over the landing [m]."""
CLEARANCE_M: Final = 0.03
"""Height from which a path without leads of its own is landed [m]."""
MOVES_PER_FUNCTION: Final = 200


class _Move(NamedTuple):
    """One straight move of the robot."""

    pose: Array
    """Position [m] and rotation vector [rad] in the work frame, shape (6,)."""
    speed: str
    """Speed as an expression of the program."""
    blend: float = 0.0


def urscript_text(result: PlanResult, setup: ExportSetup) -> str:
    """Write a path as a URScript program.

    Each stroke comes down in position control to 3 mm above the surface, follows the rest of its lead-in in force
    mode, so that an arc or a ramp lands on the move, is run with the force along tool z in a task frame that follows
    the tool, and ends force mode before it lifts.

    Args:
        result: The plan.
        setup: Force, speeds, the robot's tool and, if known, where the part is.

    Returns:
        The program.

    Raises:
        PlanError: Nothing to press on, or tool axes all around.
    """
    name = "polish_" + (re.sub(r"[^0-9a-z]+", "_", result.mesh.name.lower()).strip("_") or "part")
    path = result.path.rows(_kept(result.path))
    poses = np.concatenate([path.positions_work, Rotation.from_matrix(steady_frames(path)).as_rotvec()], axis=1)
    strokes = strokes_of(path)
    lines = [*opening(name, result, setup, len(path.s))]
    calls: list[str] = []
    for number, stroke in enumerate(strokes, start=1):
        down, landing = _down(path, poses, stroke)
        lines += _function(f"come_down_{number}", _motions(down))
        parts = list(_contact(path, poses, stroke, setup))
        chunks = [parts[k : k + MOVES_PER_FUNCTION] for k in range(0, len(parts), MOVES_PER_FUNCTION)]
        for part, chunk in enumerate(chunks, start=1):
            lines += _function(f"stroke_{number}_{part}", chunk)
        lines += _function(f"go_up_{number}", _motions(_up(path, poses, stroke)))
        calls += _run_stroke(number, len(chunks), down[0], landing, forces_of(path, setup)[stroke.contact[0]])
    return "\n".join([*lines, *closing(calls, result), ""])


def _kept(path: ToolPath) -> NDArray[np.bool_]:
    kept = np.zeros(len(path.s), dtype=np.bool_)
    kept[needed_rows(path, CHORD_M, float(AXIS_RAD), LONGEST_M)] = True
    return kept


def _down(path: ToolPath, poses: Array, stroke: StrokeRows) -> tuple[list[_Move], list[_Move]]:
    """The way to the part as far as the standoff, and from there; a path without one gets a straight one."""
    first = stroke.contact[0]
    axis = path.axes_work[first]
    height = (path.positions_work[stroke.down] - path.positions_work[first]) @ axis
    high = np.flatnonzero(height >= STANDOFF_M)
    free = stroke.down[: high[-1] + 1] if len(high) else stroke.down[:0]
    low = np.append(stroke.down[len(free) :], first)
    moves = [_Move(poses[row], _air_speed(path, row)) for row in free]
    if not moves:
        moves = [_Move(_lifted(poses[first], axis, CLEARANCE_M), "travel_speed")]
    # The lead goes down from the last place above the standoff to the first below it.
    above, below = moves[-1].pose, poses[low[0]]
    fall = (above[:3] - poses[first][:3]) @ axis - STANDOFF_M
    share = fall / max(float((above[:3] - below[:3]) @ axis), 1e-9)
    standoff = np.concatenate([above[:3] + min(share, 1.0) * (below[:3] - above[:3]), below[3:]])
    return [*moves, _Move(standoff, "landing_speed")], [_Move(poses[row], "landing_speed") for row in low]


def _up(path: ToolPath, poses: Array, stroke: StrokeRows) -> list[_Move]:
    if not len(stroke.up):
        last = stroke.contact[-1]
        return [_Move(_lifted(poses[last], path.axes_work[last], CLEARANCE_M), "landing_speed")]
    return [_Move(poses[row], _air_speed(path, row)) for row in stroke.up]


def _lifted(pose: Array, axis: Array, height: float) -> Array:
    return np.concatenate([pose[:3] + height * axis, pose[3:]])


def _air_speed(path: ToolPath, row: int) -> str:
    return "travel_speed" if path.segment[row] in (APPROACH, RETRACT) else "landing_speed"


def _contact(path: ToolPath, poses: Array, stroke: StrokeRows, setup: ExportSetup) -> Iterator[str]:
    """Moves in contact; the force is set where it changes."""
    rows = stroke.contact
    feed, force = feeds_of(path, setup), forces_of(path, setup)
    gap = np.linalg.norm(np.diff(path.positions_work[rows], axis=0), axis=1)
    blend = np.minimum(BLEND_SHARE * np.minimum(gap[:-1], gap[1:]), LARGEST_BLEND_M)
    for row, before, radius in zip(rows[1:], rows[:-1], [*blend, 0.0], strict=True):
        if path.force is not None and force[row] != force[before]:
            yield f"global force_n = {force[row]:.3f}"
        yield _motion(_Move(poses[row], _feed(feed[row], path), radius))


def _feed(value: float, path: ToolPath) -> str:
    """A feed of the path's own is a number in each move, the process's stands at the top."""
    return "feed" if path.feed is None else f"{value:.6f}"


def _motions(moves: Sequence[_Move]) -> list[str]:
    return [_motion(move) for move in moves]


def _motion(move: _Move) -> str:
    blend = f", r={move.blend:.6f}" if move.blend > 0.0 else ""
    return f"movel(on_part({_pose(move.pose)}), a=acceleration, v={move.speed}{blend})"


def _pose(pose: Array) -> str:
    return "p[" + ", ".join(f"{value:.6f}" for value in pose) + "]"


def _function(name: str, body: Sequence[str]) -> list[str]:
    return [f"  def {name}():", *(f"    {line}" for line in body), "  end", ""]


def _run_stroke(number: int, chunks: int, start: _Move, landing: Sequence[_Move], force: float) -> list[str]:
    """The steps of one stroke in the main program."""
    go, speed = ("movej", "joint_speed") if number == 1 else ("movel", "travel_speed")
    return [
        f"# stroke {number}",
        f"{go}(on_part({_pose(start.pose)}), a=acceleration, v={speed})",
        "zero_sensor()",
        "start_spindle()",
        f"come_down_{number}()",
        f"global force_n = {force:.3f}",
        "start_pressing()",
        *_motions(landing),
        "wait_for_contact()",
        *(f"stroke_{number}_{part}()" for part in range(1, chunks + 1)),
        "stop_pressing()",
        f"go_up_{number}()",
    ]
