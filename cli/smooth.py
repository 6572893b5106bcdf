"""`polish-sim smooth`: jerk-limited motion along any tool path, within tolerances and limits of tool and joints."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.cli import option_types as o
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.cli.rendering import prepare_headless
from polish_sim.cli.scenario_options import parse_pose
from polish_sim.errors import InputError

MOTION = "Motion"
LARGEST_TOLERANCE_MM, LARGEST_TOLERANCE_DEG = 10.0, 10.0
LARGEST_RATE_HZ = 10_000.0

PathFile = Annotated[
    Path,
    typer.Argument(
        metavar="PATH",
        help="Plan folder, path.json, path.csv, CSV of x,y,z,i,j,k (mm), APT/CLDATA, or G-code of G0 and G1 (.nc, "
        ".ngc, .gcode).",
        show_default=False,
    ),
]
Rule = Annotated[
    str,
    typer.Option("--rule", metavar="NAME", help="certified, joint-jerk or joint-acceleration.", rich_help_panel=MOTION),
]
Against = Annotated[
    str | None,
    typer.Option("--against", metavar="NAME", help="A rule to measure and draw beside it.", rich_help_panel=MOTION),
]
Tolerance = Annotated[
    float,
    typer.Option(
        "--tolerance",
        metavar="MM",
        help="How far the tip may be from the path (certified) or a corner from the tip's way (the others) (mm); "
        "0 stops at every corner.",
        rich_help_panel=MOTION,
    ),
]
AxisTolerance = Annotated[
    float,
    typer.Option(
        "--axis-tolerance",
        metavar="DEG",
        help="Largest angle of the tool axis to its path (deg).",
        rich_help_panel=MOTION,
    ),
]
Limits = Annotated[
    Path | None,
    typer.Option(
        "--limits",
        metavar="FILE.toml",
        help="Limits of tip, axis and joints; 'polish-sim config limits' prints the default.",
        rich_help_panel=MOTION,
    ),
]
Feed = Annotated[
    float | None,
    typer.Option(
        "--feed",
        metavar="MM/S",
        help="Largest speed of the tip (mm/s), instead of the limits' and the path's own feeds.",
        rich_help_panel=MOTION,
    ),
]
PathPose = Annotated[
    str | None,
    typer.Option(
        "--part-pose",
        metavar="POSE",
        help="X,Y,Z,RX,RY,RZ of the path's frame in the robot base (mm, deg); default: chosen.",
        rich_help_panel=MOTION,
    ),
]
NoJoints = Annotated[
    bool, typer.Option("--no-joints", help="Smooth the tool's motion alone, without a robot.", rich_help_panel=MOTION)
]
Lenient = Annotated[
    bool,
    typer.Option(
        "--lenient",
        help="Leave out unknown words of G-code or APT, and say so; what moves the tool stays refused.",
        rich_help_panel=o.PATH,
    ),
]
Rate = Annotated[
    float, typer.Option("--rate", metavar="HZ", help="Samples of the trajectory per second.", rich_help_panel=o.OUTPUT)
]


def smooth(
    path: PathFile,
    rule: Rule = "certified",
    against: Against = None,
    tolerance: Tolerance = 0.02,
    axis_tolerance: AxisTolerance = 0.02,
    limits: Limits = None,
    feed: Feed = None,
    part_pose: PathPose = None,
    no_joints: NoJoints = False,
    lenient: Lenient = False,
    rate: Rate = 500.0,
    out: o.Out = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Smooth a tool path: trajectory.npz, trajectory.csv, metrics.json, limits.toml and pictures."""
    _check_range("--tolerance", tolerance, 0.0, LARGEST_TOLERANCE_MM, "mm")
    _check_range("--axis-tolerance", axis_tolerance, 0.0, LARGEST_TOLERANCE_DEG, "deg")
    _check_range("--rate", rate, 1.0, LARGEST_RATE_HZ, "Hz")
    if feed is not None:
        _check_range("--feed", feed, 0.001, 5000.0, "mm/s")
    if no_joints and part_pose is not None:
        raise InputError("--part-pose would change nothing with --no-joints: leave it out.")
    refuse_taken(out, overwrite)
    pose = tuple(parse_pose(part_pose)) if part_pose is not None else ()
    prepare_headless()
    # Lazy: --help must not wait for the numerical libraries.
    from polish_sim.cli.smoothing import SmoothRequest, smooth_file

    request = SmoothRequest(
        path,
        (rule,) if against is None else (rule, against),
        1e-3 * tolerance,
        math.radians(axis_tolerance),
        limits,
        None if feed is None else 1e-3 * feed,
        None if no_joints else pose,
        lenient,
        rate,
    )
    with claimed(out, "smooth", overwrite) as folder, console.progress() as observer:
        outcome = smooth_file(request, folder.draft, observer)
    outcome.show()
    console.say(f"folder: {folder.final}")


def _check_range(option: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise InputError(f"{option} {value:g} is outside {low:g} to {high:g} {unit}.")
