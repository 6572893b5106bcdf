"""`polish-sim compare`: a robot's log beside the simulation."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from polish_sim.cli import console
from polish_sim.cli.options import OUTPUT_OPTIONS, Given, Own, argument, refuse_beside, refuse_without, takes
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.config.key import SECOND
from polish_sim.errors import InputError
from polish_sim.page import save_page
from polish_sim.row_file import put_file, write_json
from polish_sim.scenario_file import numbers_of, override, to_toml

if TYPE_CHECKING:
    from collections.abc import Sequence

    from polish_sim.config import Scenario
    from polish_sim.exchange.robot_log import RobotRecording

PANEL = "Log"
FREE_N = 5.0  #: Beyond what noise and drift of a wrist sensor make without contact [N]
FREE_SHARE = 0.01  #: Of the time; a shorter excess is no contact
REPLAY = ("--arm", "--payload", "--payload-center", "--set")
LogFile = Annotated[
    Path,
    argument("REAL", "CSV of ur_rtde or an RTDE recorder, ROS bag (.mcap, .db3, folder), npz or run folder."),
]  # fmt: skip


LOG_OPTIONS = (
    Own("--map", PANEL, "FILE.toml", "Names of columns and units where they are others'; "
                                     "docs/how_to_log.md.", Path),
    Own("--run", PANEL, "NAME", "Which of several runs in an npz."),
    Own("--from", PANEL, "S", "First second of the log to use (s).", float, 0.0, unit=SECOND),
    Own("--to", PANEL, "S", "Last second (s); default: the end, 1000 s at 500 Hz at most.", float, 0.0,
        unit=SECOND),
)  # fmt: skip
"""What a robot's log is read by."""


def read_measured_log(
    file: Path, given: Given, need: Sequence[str], slides: Sequence[int] = (), *of_gap: str | None
) -> RobotRecording:
    """Read a robot's log by `LOG_OPTIONS`, with the quantities it needs; raises as `read_robot_recording`.

    ``slides``: which joints slide, whose columns have our names or the map's; ``of_gap``: what to do about a
    gap, as there.
    """
    from polish_sim.exchange.robot_log import BY_NAME, columns_of, read_column_map, read_robot_recording

    columns = columns_of(slides) if slides else BY_NAME
    if given["--map"]:
        columns = read_column_map(given["--map"], len(slides) or 6)._replace(wanted=columns.wanted)
    window = given["--from"] or 0.0, math.inf if given["--to"] is None else given["--to"]
    log = read_robot_recording(file, need, columns, given["--run"] or "", window, *of_gap)
    if not log.whole and given["--to"] is None:
        console.note(
            f"the log is long: its first {log.time[-1]:.0f} s from there are used; --from and --to choose."
        )
    return log


def override_robot(
    scenario: Scenario, settings: Sequence[str], keys: tuple[str, ...], takes: str
) -> Scenario:
    """A scenario with what ``--set`` changes of its robot; InputError for keys that would change nothing,
    and what the command ``takes``."""
    for text in settings:
        if not text.startswith(keys):
            raise InputError(f"--set {text} would change nothing in {takes}.")
    return override(scenario, settings)


@takes(
    *LOG_OPTIONS,
    Own("--arm", PANEL, "NAME", "The robot's make, robot.arm; default: the cell's."),
    Own(
        "--payload",
        PANEL,
        "KG",
        "What it carried on its flange without a setting of its controller for it (kg).",
        float,
        0.0,
        50.0,
    ),
    Own("--payload-center", PANEL, "X,Y,Z", "Its centre of mass from the flange (mm)."),
    Own("--beside", PANEL, "RUN", "A saved run: its force beside the log's, both from first contact.", Path),
    Own(
        "--asked", PANEL, "N", "With --beside: the force asked for; default: the run's (N).", float, 0.0, 1e4
    ),
    *("--set", *OUTPUT_OPTIONS),
)
def compare(real: LogFile, given: Given) -> int:
    """Replay a robot's log in the cell, measured beside simulated: joints, torques, friction, ripple; or
    forces."""
    beside = given["--beside"]
    refuse_beside(given, "--beside", *REPLAY)
    refuse_without(given, "--beside", "--asked")
    refuse_taken(given, real)
    log = read_measured_log(real, given, () if beside else ("q_rad",))
    if beside is None and (pressed := pressing(log)):
        console.note(f"note: {pressed}")
    with claimed(given, "compare") as folder:
        if beside:
            _forces(real, log, beside, given, folder.draft)
        else:
            _joints(real, log, given, folder.draft)
    console.say_folder(folder.final)
    return 0


def pressing(log: RobotRecording) -> str:
    """That a log is of a tool that pressed on something, which its replay does not; empty if it is not."""
    from polish_sim.arrays import norms

    measured = log.values.get("wrench", log.values.get("force_n"))
    if measured is None:
        return ""
    force = norms(measured[:, :3])
    share = float((force > FREE_N).mean())
    if share < FREE_SHARE:
        return ""
    return (
        f"the log's force is above {FREE_N:g} N for {100.0 * share:.0f}% of the time, {force.max():.0f} N at "
        "most: its tool pressed on something. The replay is in free space, so torques differ by that force; "
        "--beside RUN compares forces."
    )


def _joints(real: Path, log: RobotRecording, given: Given, draft: Path) -> None:
    from polish_sim.cell.scene import build_scene
    from polish_sim.compare.replay import (
        FIGURES,
        PICTURE,
        SCENARIO,
        CarriedPayload,
        compare_joints,
        joint_page,
        joint_table,
        plot_joint_torques,
    )

    arm = [f"robot.arm={given['--arm']}"] if given["--arm"] else []
    takes = "'compare': it takes robot.KEY and robot.real.KEY"
    scenario = override_robot(SCENARIO, [*arm, *(given["--set"] or [])], ("robot.",), takes)
    payload = CarriedPayload(given["--payload"] or 0.0, _center(given["--payload-center"] or "0,0,0"))
    with console.progress() as observer:
        observer.stage("replay")
        found = compare_joints(scenario.robot, log, payload)
        observer.stage("draw")
        title = f"{real.name} beside {scenario.robot.arm}"
        put_file(draft, "config.toml", to_toml(scenario))
        write_json(draft / FIGURES, found.figures)
        plot_joint_torques(found, title).savefig(draft / PICTURE)
        save_page(draft, joint_page(found, build_scene(scenario), title))
    console.table(joint_table(f"compare: {title}", found.figures))


def _center(text: str) -> tuple[float, ...]:
    numbers = numbers_of(text, 3)
    if not numbers or max(map(abs, numbers)) > 1000.0:
        raise InputError(f"--payload-center {text}: wanted X,Y,Z in mm, e.g. 0,0,60, at most 1000 each.")
    return tuple(1e-3 * number for number in numbers)


def _forces(real: Path, log: RobotRecording, run: Path, given: Given, draft: Path) -> None:
    from polish_sim.analysis.run_record import read_record
    from polish_sim.compare.figures import compare_steps, from_contact
    from polish_sim.compare.replay import FIGURES, PICTURE, plot_steps, step_page, step_table

    record = read_record(run)
    if "force_n" in log.values or "wrench" not in log.values:
        force = log.need("force_n", real)
    else:
        force = log.values["wrench"][:, 2:3]
    asked = given["--asked"] or record.scenario.process.contact_force_n
    measured = from_contact(log.time, force[:, 0], asked)
    simulated = from_contact(record.log["time_s"], record.log["normal_force_n"], asked)
    found = compare_steps(measured, simulated)
    title = f"{given['--run'] or real.name} beside {record.name}"
    write_json(draft / FIGURES, found)
    plot_steps([(title, measured, simulated)], "force from first contact").savefig(draft / PICTURE)
    save_page(draft, step_page(found, title))
    console.table(step_table(f"compare: {title}", found))
