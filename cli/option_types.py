"""The options commands share, each declared once, in panels of the help; units are the user's (mm, deg, N, mm/s)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

PART, PATH, TOOL, AXIS, RUN, CONFIG, OUTPUT = (
    "Part and region",
    "Path",
    "Tool and process",
    "Landing and tool axis",
    "Run",
    "Config",
    "Output",
)

# Part and region
PartFile = Annotated[
    str, typer.Argument(metavar="PART", help="STL, PLY or OBJ file, or the name of a shipped part.", show_default=False)
]
Part = Annotated[
    str | None,
    typer.Option(
        "--part",
        metavar="PART",
        help="STL, PLY or OBJ file, or the name of a shipped part; default freeform (surface), plate (force).",
        rich_help_panel=PART,
    ),
]
PartPose = Annotated[
    str | None,
    typer.Option(
        "--part-pose",
        metavar="POSE",
        help="X,Y,Z,RX,RY,RZ of the part in the robot base (mm, deg); default: chosen.",
        rich_help_panel=PART,
    ),
]
Units = Annotated[
    str | None,
    typer.Option(
        "--units", metavar="UNIT", help="Unit of the part's file: mm (default), cm, m or inch.", rich_help_panel=PART
    ),
]
Up = Annotated[
    str | None,
    typer.Option(
        "--up",
        metavar="SIDE",
        help="Side turned up: auto (default), x, y, z, -x, -y, -z, or a direction X,Y,Z.",
        rich_help_panel=PART,
    ),
]
Region = Annotated[
    str | None,
    typer.Option(
        "--region",
        metavar="REGION",
        help="auto (default), top, all, point:X,Y,Z, box:X0,Y0,Z0,X1,Y1,Z1, polygon:X,Y,Z;X,Y,Z;..., polygon:FILE "
        "or faces:FILE (mm).",
        rich_help_panel=PART,
    ),
]
FeatureAngle = Annotated[
    float | None,
    typer.Option(
        "--feature-angle",
        metavar="DEG",
        help="Edges that bend by more than this bound a smooth face (deg); default 30.",
        rich_help_panel=PART,
    ),
]
EdgeMargin = Annotated[
    float | None,
    typer.Option(
        "--edge-margin",
        metavar="MM",
        help="Keep the region this far from its edges (mm); default 0.",
        rich_help_panel=PART,
    ),
]

# Path
PathFile = Annotated[
    Path | None,
    typer.Option(
        "--path",
        metavar="PLAN",
        help="Path to run instead of planning one: a plan folder, path.json, CSV or APT file.",
        rich_help_panel=PATH,
    ),
]
Pattern = Annotated[
    str | None,
    typer.Option(
        "--pattern", metavar="NAME", help="spiral (default), raster, contour or fermat.", rich_help_panel=PATH
    ),
]
Stepover = Annotated[
    float | None,
    typer.Option(
        "--stepover", metavar="MM", help="Distance between neighbouring turns (mm); default 8.", rich_help_panel=PATH
    ),
]
Overlap = Annotated[
    float | None,
    typer.Option(
        "--overlap",
        metavar="PERCENT",
        help="Sets the step-over by how much neighbouring turns overlap, in percent of the pad's diameter.",
        rich_help_panel=PATH,
    ),
]
Order = Annotated[
    str | None,
    typer.Option("--order", metavar="NAME", help="spiral, contour: inward (default) or outward.", rich_help_panel=PATH),
]
Direction = Annotated[
    str | None,
    typer.Option(
        "--direction",
        metavar="NAME",
        help="spiral, contour: conventional (default: what is not done yet on the left) or climb.",
        rich_help_panel=PATH,
    ),
]
Start = Annotated[
    str | None,
    typer.Option(
        "--start", metavar="X,Y,Z", help="Begin the path near this point of the part (mm); default: chosen.",
        rich_help_panel=PATH,
    ),
]  # fmt: skip
RasterDirection = Annotated[
    str | None,
    typer.Option(
        "--raster-direction",
        metavar="X,Y,Z",
        help="raster: direction of the lines; default: along the region's long axis.",
        rich_help_panel=PATH,
    ),
]

# Landing and tool axis
LeadIn = Annotated[
    str | None,
    typer.Option(
        "--lead-in", metavar="NAME", help="How the tool lands: normal (default), tangent or arc.", rich_help_panel=AXIS
    ),
]
LeadAngle = Annotated[
    float | None,
    typer.Option(
        "--lead-angle",
        metavar="DEG",
        help="Lean the tool axis this far forward, along the feed (deg); default 0.",
        rich_help_panel=AXIS,
    ),
]
TiltAngle = Annotated[
    float | None,
    typer.Option(
        "--tilt-angle",
        metavar="DEG",
        help="Lean the tool axis this far to the left of the feed (deg); default 0.",
        rich_help_panel=AXIS,
    ),
]
AxisSmoothing = Annotated[
    float | None,
    typer.Option(
        "--axis-smoothing",
        metavar="MM",
        help="Average the tool axis over this length of the path (mm); default 0, not at all.",
        rich_help_panel=AXIS,
    ),
]
AxisDeviation = Annotated[
    float | None,
    typer.Option(
        "--axis-deviation",
        metavar="DEG",
        help="Largest turn --axis-smoothing may give a tool axis (deg); default 5.",
        rich_help_panel=AXIS,
    ),
]

# Tool and process
PadDiameter = Annotated[
    float | None,
    typer.Option("--pad-diameter", metavar="MM", help="Diameter of the pad (mm); default 50.", rich_help_panel=TOOL),
]
ContactForce = Annotated[
    float | None,
    typer.Option("--contact-force", metavar="N", help="Force to hold (N); default 20.", rich_help_panel=TOOL),
]
Feed = Annotated[
    float | None,
    typer.Option("--feed", metavar="MM_S", help="Speed along the path (mm/s); default 10.", rich_help_panel=TOOL),
]
SpindleSpeed = Annotated[
    float | None,
    typer.Option(
        "--spindle-rpm",
        metavar="RPM",
        help="Speed of the spindle, 0 = off (1/min); default 6000 in surface, else off.",
        rich_help_panel=TOOL,
    ),
]

# Run
Experiment = Annotated[str, typer.Argument(help="arc, force or surface.", show_default=False)]
Controller = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="NAME",
        help="hybrid-pi (default), hybrid-pi-position, position, or FILE.py:CLASS.",
        rich_help_panel=RUN,
    ),
]
Seed = Annotated[
    int | None,
    typer.Option("--seed", metavar="N", help="Seed of everything random; default 0.", rich_help_panel=RUN),
]
Seeds = Annotated[
    int | None,
    typer.Option(
        "--seeds", metavar="N", min=1, help="Run this many seeds, counting up from --seed.", rich_help_panel=RUN
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Plan and check the reach, do not simulate.", rich_help_panel=RUN)
]
Check = Annotated[
    bool,
    typer.Option("--check", help="Exit with 1 when a figure falls short of what is asked of it.", rich_help_panel=RUN),
]
View = Annotated[bool, typer.Option("--view", help="Watch the run in the MuJoCo viewer.", rich_help_panel=RUN)]

# Config
Config = Annotated[
    Path | None,
    typer.Option("--config", metavar="FILE.toml", help="TOML file; see 'polish-sim config'.", rich_help_panel=CONFIG),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="KEY=VALUE of the config; may be repeated.", rich_help_panel=CONFIG
    ),
]

# Output
Video = Annotated[
    bool,
    typer.Option("--video", help="Write a video of the run (mp4, or GIF without ffmpeg).", rich_help_panel=OUTPUT),
]
LogRate = Annotated[
    str | None,
    typer.Option(
        "--log-rate",
        metavar="HZ|full",
        help="Rows of the log per second (Hz), or 'full'; default 250.",
        rich_help_panel=OUTPUT,
    ),
]
Export = Annotated[
    list[str] | None,
    typer.Option(
        "--export",
        metavar="NAME",
        help="Also write the plan as apt, urscript, ros, ply, glb, html, or all of them; may be repeated.",
        rich_help_panel=OUTPUT,
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Output folder; default results/<command>/<date-time>.",
        rich_help_panel=OUTPUT,
    ),
]
Overwrite = Annotated[
    bool,
    typer.Option("--overwrite", help="Replace files in an existing output folder.", rich_help_panel=OUTPUT),
]
