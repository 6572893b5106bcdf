"""`polish-sim smooth`: jerk-limited motion along any tool path, within tolerances and limits of tool and
joints."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from polish_sim.cli import console
from polish_sim.cli.options import OUTPUT_OPTIONS, Given, Own, argument, refuse_beside, takes
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.config.key import DEG, MM, MM_S, OUTPUT, PATH, Unit

MOTION = "Motion"

PathFile = Annotated[
    Path,
    argument(
        "PATH",
        "Plan folder, path.json, path.csv, CSV of x,y,z,i,j,k (mm), APT/CLDATA, or G-code of G0 and G1 "
        "(.nc, .ngc, .gcode).",
    ),
]
OPTIONS = (
    Own("--rule", MOTION, "NAME", "spline (default), joint-jerk or joint-acceleration."),
    Own("--against", MOTION, "NAME", "A rule to measure and draw beside it."),
    Own(
        "--tolerance",
        MOTION,
        "MM",
        "Largest distance of the tip from the path (spline) or of a corner from the "
        "tip's motion (the others) (mm); 0 stops at every corner; default 0.02.",
        float,
        0.0,
        0.01,
        MM,
    ),
    Own(
        "--axis-tolerance",
        MOTION,
        "DEG",
        "Largest angle of the tool axis to its path (deg); default 0.02.",
        float,
        0.0,
        10.0 * DEG.si,
        DEG,
    ),
    Own(
        "--limits",
        MOTION,
        "FILE.toml",
        "Limits of tip, axis and joints; 'polish-sim config limits' prints the default.",
        Path,
    ),
    Own(
        "--feed",
        MOTION,
        "MM/S",
        "Largest speed of the tip (mm/s), instead of the limits' and the path's own feeds.",
        float,
        1e-6,
        5.0,
        MM_S,
    ),
    Own("--no-joints", MOTION, "", "Smooth the tool's motion alone, without a robot."),
    Own(
        "--lenient",
        PATH,
        "",
        "Leave out unknown words of G-code or APT, and say so; what moves the tool stays refused.",
    ),
    Own(
        "--rate",
        OUTPUT,
        "HZ",
        "Samples of the trajectory per second; default 500.",
        float,
        1.0,
        10_000.0,
        Unit("Hz", 1.0),
    ),
)


@takes(*OPTIONS, "--part-pose", *OUTPUT_OPTIONS)
def smooth(path: PathFile, given: Given) -> None:
    """Smooth a tool path: trajectory.npz, trajectory.csv, metrics.json, limits.toml and pictures."""
    refuse_beside(given, "--no-joints", "--part-pose")
    refuse_taken(given, path)
    from polish_sim.cli.smoothed import show_smoothing, smooth_file

    with claimed(given, "smooth") as folder, console.progress() as observer:
        figures, notes = smooth_file(path, given, folder.draft, observer)
    console.notes(notes)
    show_smoothing(path.name, figures)
    console.say_folder(folder.final)
