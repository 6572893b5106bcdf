"""A program for Universal Robots e-Series that presses with force mode (plan -> URScript).

What is written is the path on the surface. The pressed-in path of a simulation without force control is never
written: a stiff robot following it would push with all it has.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, chord_lengths
from polish_sim.exchange.strokes import (
    ExportSetup,
    StrokeRows,
    feeds_of,
    forces_of,
    in_part_remarks,
    moves_in_part,
    needed_rows,
    steady_frames,
    strokes_of,
)
from polish_sim.planning import PlanResult, ToolPath
from polish_sim.planning.quality.tool_room import pad_in_part_warning
from polish_sim.planning.toolpath import APPROACH, RETRACT
from polish_sim.spatial import vectors_from_rotations

# The fixed part of a URScript program: settings at the top, force mode, spindle, what happens when
# contact fails.

CONTACT_SHARE = 0.5  #: The tool counts as landed at this share of the force
TRAVEL_M_S = 0.05
JOINT_RAD_S = 0.2
ACCELERATION_M_S2 = 0.3
SIDEWAYS_M = 0.01
ANGLE_RAD = 0.1  #: In force mode the robot stops when it is pushed this far off the path, or turned
DAMPING = 0.05
GAIN_SCALING = 0.5
PATIENCE = 2.0  #: Contact is waited for this many times as long as the way takes

HEADER = """\
# {name}: polish '{part}' with force mode. For Universal Robots e-Series, PolyScope 5. Made by polish-sim.
#
# READ BEFORE YOU RUN{warning}
# - Measure where the part is, set T_base_work and only then part_is_placed = True. Without it the program \
stops.
# - Set tool centre point, payload, spindle output and force limits to those of your cell. Run it first in \
the air:
#   T_base_work raised along its z, spindle off.
# - The path is the one ON the surface; force mode presses. Never run these poses pressed in, and never \
without
#   force mode where they touch: a robot in position control pushes with all it has.
# - Tool frame: z into the part, x steady, so that the last joint does not wind up; tool_turn turns it.
# - Sent to the robot's script interface the program runs as it is; in a Script node of PolyScope add the \
line {name}().
# - Start with the tool above the part, free way to the first pose. The robot's safety limits stay what \
protects you.
# - Long programs: older (CB) controllers were reported to refuse some 1000 to 2500 poses sent in one piece.
# - {poses} poses in {pattern}, step-over {stepover:g} mm, {length:.2f} m in contact.
"""

FUNCTIONS = """\
  def on_part(T_work_tool):
    return pose_trans(pose_trans(T_base_work, T_work_tool), p[0, 0, 0, 0, 0, tool_turn])
  end

  # The task frame is the tool's own, taken anew every cycle: its z axis follows the normal of the surface.
  # Only tool z yields; force_limits hold the speed along it and, for the other axes, how far off the path \
is too far.
  thread press():
    while True:
      force_mode(get_actual_tcp_pose(), [0, 0, 1, 0, 0, 0], [0, 0, force_n, 0, 0, 0], 2, force_limits)
      sync()
    end
  end

  def zero_sensor():
    sleep(0.5)
    zero_ftsensor()
    sleep(0.1)
  end

  def start_spindle():
    if not spindle_runs:
      set_standard_digital_out(spindle_output, True)
      sleep(spindle_wait)
      global spindle_runs = True
    end
  end

  def stop_spindle():
    set_standard_digital_out(spindle_output, False)
    global spindle_runs = False
  end

  def start_pressing():
    force_mode_set_damping({damping:g})
    force_mode_set_gain_scaling({gain:g})
    global pressing = run press()
  end

  def stop_pressing():
    kill pressing
    end_force_mode()
    sleep(0.1)
  end

  def wait_for_contact():
    global waited = 0.0
    while force() < contact_share * force_n and waited < contact_timeout:
      sync()
      global waited = waited + get_steptime()
    end
    if force() < contact_share * force_n:
      stop_pressing()
      stop_spindle()
      popup("No contact: is the part where T_base_work says?", title="polish-sim", error=True, blocking=True)
      halt
    end
  end
"""


def opening(name: str, result: PlanResult, setup: ExportSetup, poses: int) -> list[str]:
    """Header, settings and fixed functions."""
    warning = pad_in_part_warning(result.figures)
    header = HEADER.format(
        name=name,
        warning=f"\n# - DO NOT RUN IT AS IT IS: {warning}." if warning else "",
        part="".join(letter if letter.isprintable() else " " for letter in result.mesh.name),
        poses=poses,
        pattern=result.plan.pattern,
        stepover=1e3 * result.plan.stepover_m,
        length=float(result.figures["path_length_m"]),
    )
    functions = FUNCTIONS.format(damping=DAMPING, gain=GAIN_SCALING)
    return [*header.splitlines(), f"def {name}():", *_settings(setup), "", *functions.splitlines(), ""]


def closing(calls: Sequence[str], result: PlanResult) -> list[str]:
    """The main program; it stops with a question where the plan's pad runs into the part."""
    warning = pad_in_part_warning(result.figures)
    guard = [
        "if not part_is_placed:",
        '  popup("Set T_base_work and part_is_placed first.", title="polish-sim", error=True, blocking=True)',
        "  halt",
        "end",
        *(
            [f'popup("Continue? {warning}.", title="polish-sim", warning=True, blocking=True)']
            if warning
            else []
        ),
        "stop_spindle()",
    ]
    return [*(f"  {line}" for line in (*guard, *calls, "stop_spindle()")), "end"]


def _settings(setup: ExportSetup) -> list[str]:
    process = setup.process
    tool = setup.tool
    way = process.search_depth_m + 3e-3
    timeout = PATIENCE * way / process.approach_speed_m_s
    limits = [SIDEWAYS_M, SIDEWAYS_M, process.approach_speed_m_s, ANGLE_RAD, ANGLE_RAD, ANGLE_RAD]
    placed = len(setup.part_pose) == 6
    settings = (
        (
            "T_base_work",
            _pose(setup.part_pose if placed else (0.0,) * 6),
            "frame of the part's STL in the base [m, rad]",
        ),
        ("part_is_placed", str(placed), "whether T_base_work is right"),
        ("tool_turn", "0.0", "turn of the tool about its own axis [rad]"),
        ("force_n", f"{process.contact_force_n:g}", "contact force along tool z [N]"),
        ("feed", f"{process.feed_m_s:g}", "speed in contact [m/s]"),
        ("landing_speed", f"{process.approach_speed_m_s:g}", "speed close to the part [m/s]"),
        ("travel_speed", f"{TRAVEL_M_S:g}", "speed in the air [m/s]"),
        ("joint_speed", f"{JOINT_RAD_S:g}", "speed to the first pose [rad/s]"),
        ("acceleration", f"{ACCELERATION_M_S2:g}", "[m/s^2], to the first pose [rad/s^2]"),
        ("force_limits", _list(limits), "x, y [m], z [m/s], angles [rad]"),
        ("contact_share", f"{CONTACT_SHARE:g}", "share of the force that counts as contact"),
        ("contact_timeout", f"{timeout:.1f}", "longest wait for contact [s]"),
        ("spindle_output", str(tool.spindle_output), "standard digital output of the spindle"),
        (
            "spindle_wait",
            f"{tool.spindle_wait_s:g}",
            f"time to come up to {setup.spindle.speed_rpm:g} 1/min [s]",
        ),
        ("spindle_runs", "False", ""),
    )
    lines = [f"  global {name} = {value}" + (f"  # {text}" if text else "") for name, value, text in settings]
    mass = f"  set_payload({tool.payload_kg:g}, {_list(tool.payload_center_m)})"
    return [*lines, f"  set_tcp({_pose(tool.tcp_pose)})", f"{mass}  # [kg], centre in the flange [m]"]


def _pose(values: Sequence[float] | Array, form: str = ".6g") -> str:
    return "p" + _list(values, form)


def _list(values: Sequence[float] | Array, form: str = "g") -> str:
    return "[" + ", ".join(f"{value:{form}}" for value in values) + "]"


CHORD_M = 5e-5
AXIS_RAD = np.radians(3.0)
#: Points left out lie this close to the move [m], [rad]; no move is longer than this [m]
LONGEST_M = 1e-2
BLEND_SHARE = 0.4
#: Less than half of the moves beside a blend: blends that overlap stop the robot
LARGEST_BLEND_M = 2e-3
STANDOFF_M = 3e-3  #: Height above the surface at which force mode takes over the landing [m]
CLEARANCE_M = 0.03  #: Height from which a path without leads of its own is landed [m]
MOVES_PER_FUNCTION = 200


class _Move(NamedTuple):
    """One straight move of the robot."""

    pose: Array  #: Position [m] and rotation vector [rad] in the work frame, shape (6,)
    speed: str  #: Speed as an expression of the program
    blend: float = 0.0


def urscript_text(result: PlanResult, setup: ExportSetup) -> str:
    """Write a path as a URScript program.

    Each stroke comes down in position control to 3 mm above the surface, follows the rest of its lead-in in
    force mode, so that an arc or a ramp lands on the move, is run with the force along tool z in a task frame
    that follows the tool, and ends force mode before it lifts. ``setup``: force, speeds, the robot's tool
    and, if known, where the part is. Raises PlanError if there is nothing to press on, or tool axes all
    around.
    """
    name = "polish_" + (re.sub(r"[^0-9a-z]+", "_", result.mesh.name.lower()).strip("_") or "part")
    kept = np.zeros(len(result.path.s), dtype=np.bool_)
    kept[needed_rows(result.path, CHORD_M, float(AXIS_RAD), LONGEST_M)] = True
    path = result.path.rows(kept)
    inside = moves_in_part(result, kept)
    poses = np.concatenate([path.positions_work, vectors_from_rotations(steady_frames(path))], axis=1)
    strokes = strokes_of(path)
    lines = opening(name, result, setup, len(path.s))
    calls: list[str] = []
    for number, stroke in enumerate(strokes, start=1):
        down, landing = _down(path, poses, stroke)
        lines += _function(f"come_down_{number}", map(_motion, down))
        parts = list(_contact(path, poses, stroke, setup, inside))
        chunks = [parts[k : k + MOVES_PER_FUNCTION] for k in range(0, len(parts), MOVES_PER_FUNCTION)]
        for part, chunk in enumerate(chunks, start=1):
            lines += _function(f"stroke_{number}_{part}", chunk)
        lines += _function(f"go_up_{number}", map(_motion, _up(path, poses, stroke)))
        calls += _run_stroke(number, len(chunks), down[0], landing, forces_of(path, setup)[stroke.contact[0]])
    return "\n".join([*lines, *closing(calls, result), ""])


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
        moves = [_Move(_lifted(poses[first], axis), "travel_speed")]
    # The lead goes down from the last place above the standoff to the first below it.
    above = moves[-1].pose
    below = poses[low[0]]
    fall = (above[:3] - poses[first][:3]) @ axis - STANDOFF_M
    share = fall / max(float((above[:3] - below[:3]) @ axis), 1e-9)
    standoff = np.concatenate([above[:3] + min(share, 1.0) * (below[:3] - above[:3]), below[3:]])
    return [*moves, _Move(standoff, "landing_speed")], [_Move(poses[row], "landing_speed") for row in low]


def _up(path: ToolPath, poses: Array, stroke: StrokeRows) -> list[_Move]:
    if not len(stroke.up):
        last = stroke.contact[-1]
        return [_Move(_lifted(poses[last], path.axes_work[last]), "landing_speed")]
    return [_Move(poses[row], _air_speed(path, row)) for row in stroke.up]


def _lifted(pose: Array, axis: Array) -> Array:
    return np.concatenate([pose[:3] + CLEARANCE_M * axis, pose[3:]])


def _air_speed(path: ToolPath, row: int) -> str:
    return "travel_speed" if path.segment[row] in (APPROACH, RETRACT) else "landing_speed"


def _contact(
    path: ToolPath, poses: Array, stroke: StrokeRows, setup: ExportSetup, inside: Bools
) -> Iterator[str]:
    """Moves in contact; the force is set where it changes, remarks stand where the tool is in the part."""
    rows = stroke.contact
    feed = feeds_of(path, setup)
    force = forces_of(path, setup)
    gap = chord_lengths(path.positions_work[rows])
    blend = np.minimum(BLEND_SHARE * np.minimum(gap[:-1], gap[1:]), LARGEST_BLEND_M)
    remarks = in_part_remarks(inside[rows[1:]])  # the first row is where the tool lands
    for row, before, radius, remark in zip(rows[1:], rows[:-1], [*blend, 0.0], remarks, strict=True):
        if remark:
            yield f"# {remark}"
        if path.force is not None and force[row] != force[before]:
            yield f"global force_n = {force[row]:.3f}"
        # A feed of the path's own is a number in each move, the process's stands at the top.
        speed = "feed" if path.feed is None else f"{feed[row]:.6f}"
        yield _motion(_Move(poses[row], speed, radius))


def _motion(move: _Move) -> str:
    blend = f", r={move.blend:.6f}" if move.blend > 0.0 else ""
    return f"movel(on_part({_pose(move.pose, '.6f')}), a=acceleration, v={move.speed}{blend})"


def _function(name: str, body: Iterable[str]) -> list[str]:
    return [f"  def {name}():", *(f"    {line}" for line in body), "  end", ""]


def _run_stroke(number: int, chunks: int, start: _Move, landing: Sequence[_Move], force: float) -> list[str]:
    """The steps of one stroke in the main program."""
    go, speed = ("movej", "joint_speed") if number == 1 else ("movel", "travel_speed")
    return [
        f"# stroke {number}",
        f"{go}(on_part({_pose(start.pose, '.6f')}), a=acceleration, v={speed})",
        "zero_sensor()",
        "start_spindle()",
        f"come_down_{number}()",
        f"global force_n = {force:.3f}",
        "start_pressing()",
        *map(_motion, landing),
        "wait_for_contact()",
        *(f"stroke_{number}_{part}()" for part in range(1, chunks + 1)),
        "stop_pressing()",
        f"go_up_{number}()",
    ]
