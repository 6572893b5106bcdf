"""The fixed part of a URScript program: settings at the top, force mode, spindle, what happens when contact fails."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from polish_sim.exchange.setup import ExportSetup
from polish_sim.planning import PlanResult
from polish_sim.planning.quality.pad_in_part import pad_in_part_warning

CONTACT_SHARE: Final = 0.5
"""The tool counts as landed at this share of the force."""
TRAVEL_M_S: Final = 0.05
JOINT_RAD_S: Final = 0.2
ACCELERATION_M_S2: Final = 0.3
SIDEWAYS_M: Final = 0.01
ANGLE_RAD: Final = 0.1
"""In force mode the robot stops when it is pushed this far off the path, or turned."""
DAMPING: Final = 0.05
GAIN_SCALING: Final = 0.5
PATIENCE: Final = 2.0
"""Contact is waited for this many times as long as the way takes."""

HEADER: Final = """\
# {name}: polish '{part}' with force mode. For Universal Robots e-Series, PolyScope 5. Made by polish-sim.
#
# READ BEFORE YOU RUN{warning}
# - Measure where the part is, set T_base_work and only then part_is_placed = True. Without it the program stops.
# - Set tool centre point, payload, spindle output and force limits to those of your cell. Run it first in the air:
#   T_base_work raised along its z, spindle off.
# - The path is the one ON the surface; force mode presses. Never run these poses pressed in, and never without
#   force mode where they touch: a robot in position control pushes with all it has.
# - Tool frame: z into the part, x steady, so that the last joint does not wind up; tool_turn turns it.
# - Sent to the robot's script interface the program runs as it is; in a Script node of PolyScope add the line {name}().
# - Start with the tool above the part, free way to the first pose. The robot's safety limits stay what protects you.
# - Long programs: older (CB) controllers were reported to refuse some 1000 to 2500 poses sent in one piece.
# - {poses} poses in {pattern}, step-over {stepover:g} mm, {length:.2f} m in contact.
"""

FUNCTIONS: Final = """\
  def on_part(T_work_tool):
    return pose_trans(pose_trans(T_base_work, T_work_tool), p[0, 0, 0, 0, 0, tool_turn])
  end

  # The task frame is the tool's own, taken anew every cycle: its z axis follows the normal of the surface.
  # Only tool z yields; force_limits hold the speed along it and, for the other axes, how far off the path is too far.
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
        *([f'popup("Go on? {warning}.", title="polish-sim", warning=True, blocking=True)'] if warning else []),
        "stop_spindle()",
    ]
    return [*(f"  {line}" for line in (*guard, *calls, "stop_spindle()")), "end"]


def _settings(setup: ExportSetup) -> list[str]:
    process, tool = setup.process, setup.tool
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
        ("force_limits", "[" + ", ".join(f"{value:g}" for value in limits) + "]", "x, y [m], z [m/s], angles [rad]"),
        ("contact_share", f"{CONTACT_SHARE:g}", "share of the force that counts as contact"),
        ("contact_timeout", f"{timeout:.1f}", "longest wait for contact [s]"),
        ("spindle_output", str(tool.spindle_output), "standard digital output of the spindle"),
        ("spindle_wait", f"{tool.spindle_wait_s:g}", f"time to come up to {setup.spindle.speed_rpm:g} 1/min [s]"),
        ("spindle_runs", "False", ""),
    )
    lines = [f"  global {name} = {value}" + (f"  # {text}" if text else "") for name, value, text in settings]
    mass = f"  set_payload({tool.payload_kg:g}, [{', '.join(f'{value:g}' for value in tool.payload_center_m)}])"
    return [*lines, f"  set_tcp({_pose(tool.tcp_pose)})", f"{mass}  # [kg], centre in the flange [m]"]


def _pose(values: Sequence[float]) -> str:
    return "p[" + ", ".join(f"{value:.6g}" for value in values) + "]"
