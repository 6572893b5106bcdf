"""The options commands share, each declared once, in panels of the help; units are the user's (mm, deg, N, mm/s)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

PART, PATH, TOOL, AXIS, HAND, PAIR, RUN, CONFIG, OUTPUT = (
    "Part and region",
    "Path",
    "Tool and process",
    "Landing and tool axis",
    "Hand guiding",
    "Two robots",
    "Run",
    "Config",
    "Output",
)


def _option(panel: str, name: str, metavar: str | None, text: str, least: int | None = None) -> Any:
    """Declare an option: panel and name, what stands for its value (None for a switch), help, smallest value."""
    return typer.Option(name, metavar=metavar, help=text, rich_help_panel=panel, min=least)


# Part and region
PartFile = Annotated[
    str, typer.Argument(metavar="PART", help="STL, PLY or OBJ file, or the name of a shipped part.", show_default=False)
]
Part = Annotated[
    str | None,
    _option(
        PART,
        "--part",
        "PART",
        "STL, PLY or OBJ file, or the name of a shipped part; default freeform (surface, teach), plate (force), "
        "wheel_hub_rim (dual).",
    ),
]
RealPart = Annotated[
    str | None,
    _option(
        PART,
        "--real-part",
        "PART",
        "The part as it really is, where it differs from --part: the path comes from --part, the contact from this.",
    ),
]
PartPose = Annotated[
    str | None,
    _option(PART, "--part-pose", "POSE", "X,Y,Z,RX,RY,RZ of the part in the robot base (mm, deg); default: chosen."),
]
Units = Annotated[str | None, _option(PART, "--units", "UNIT", "Unit of the part's file: mm (default), cm, m or inch.")]
Up = Annotated[
    str | None,
    _option(PART, "--up", "SIDE", "Side turned up: auto (default), x, y, z, -x, -y, -z, or a direction X,Y,Z."),
]
Region = Annotated[
    str | None,
    _option(
        PART,
        "--region",
        "REGION",
        "auto (default), top, all, point:X,Y,Z, box:X0,Y0,Z0,X1,Y1,Z1, polygon:X,Y,Z;X,Y,Z;..., polygon:FILE "
        "or faces:FILE (mm).",
    ),
]
FeatureAngle = Annotated[
    float | None,
    _option(PART, "--feature-angle", "DEG", "Edges that bend by more than this bound a smooth face (deg); default 30."),
]
EdgeMargin = Annotated[
    float | None, _option(PART, "--edge-margin", "MM", "Keep the region this far from its edges (mm); default 0.")
]

# Path
PathFile = Annotated[
    Path | None,
    _option(PATH, "--path", "PLAN", "Path to run instead of planning one: a plan folder, path.json, CSV or APT file."),
]
Pattern = Annotated[str | None, _option(PATH, "--pattern", "NAME", "spiral (default), raster, contour or fermat.")]
Stepover = Annotated[
    float | None, _option(PATH, "--stepover", "MM", "Distance between neighbouring turns (mm); default 8.")
]
Overlap = Annotated[
    float | None,
    _option(
        PATH,
        "--overlap",
        "PERCENT",
        "Sets the step-over by how much neighbouring turns overlap, in percent of the pad's diameter.",
    ),
]
Order = Annotated[str | None, _option(PATH, "--order", "NAME", "spiral, contour: inward (default) or outward.")]
Direction = Annotated[
    str | None,
    _option(
        PATH,
        "--direction",
        "NAME",
        "spiral, contour: conventional (default: what is not done yet on the left) or climb.",
    ),
]
DirectionInRun = Annotated[
    str | None,
    _option(
        PATH,
        "--direction",
        "NAME",
        "spiral, contour: conventional (default: what is not done yet on the left) or climb. teach: x or y, the way of "
        "the hand's move; default both.",
    ),
]
Start = Annotated[
    str | None,
    _option(
        PATH,
        "--start",
        "X,Y,Z",
        "Begin the path as near this point of the part (mm) as its pattern and order allow; default: chosen.",
    ),
]
RasterDirection = Annotated[
    str | None,
    _option(
        PATH, "--raster-direction", "X,Y,Z", "raster: direction of the lines; default: along the region's long axis."
    ),
]

# Landing and tool axis
LeadIn = Annotated[
    str | None, _option(AXIS, "--lead-in", "NAME", "How the tool lands: normal (default), tangent or arc.")
]
LeadAngle = Annotated[
    float | None,
    _option(AXIS, "--lead-angle", "DEG", "Lean the tool axis this far forward, along the feed (deg); default 0."),
]
TiltAngle = Annotated[
    float | None,
    _option(AXIS, "--tilt-angle", "DEG", "Lean the tool axis this far to the left of the feed (deg); default 0."),
]
AxisSmoothing = Annotated[
    float | None,
    _option(
        AXIS,
        "--axis-smoothing",
        "MM",
        "Average the tool axis over this length of the path (mm); default 0, not at all.",
    ),
]
AxisDeviation = Annotated[
    float | None,
    _option(AXIS, "--axis-deviation", "DEG", "Largest turn --axis-smoothing may give a tool axis (deg); default 5."),
]

# Tool and process
PadDiameter = Annotated[float | None, _option(TOOL, "--pad-diameter", "MM", "Diameter of the pad (mm); default 50.")]
ContactForce = Annotated[float | None, _option(TOOL, "--contact-force", "N", "Force to hold (N); default 20.")]
Feed = Annotated[float | None, _option(TOOL, "--feed", "MM/S", "Speed along the path (mm/s); default 10.")]
SpindleSpeed = Annotated[
    float | None,
    _option(TOOL, "--spindle-rpm", "RPM", "Speed of the spindle, 0 = off (1/min); default 6000 in surface, else off."),
]

# Hand guiding
Mode = Annotated[
    str | None,
    _option(
        HAND,
        "--mode",
        "NAME",
        "teach: none, gravity, classical, inertia or assist; default: all, side by side; with --follow: assist.",
    ),
]
Follow = Annotated[
    str | None,
    _option(
        HAND,
        "--follow",
        "rim|PATH",
        "teach: the hand drags the tool along the part's rim, or a path of it, and taught.csv is made of that.",
    ),
]
Duration = Annotated[
    float | None, _option(HAND, "--duration", "S", "teach: duration of the hand's move (s); default 0.6 and 1.")
]

# Two robots
Dual = Annotated[
    bool,
    _option(
        PAIR,
        "--dual",
        None,
        "For two robots: once around the rim; reach, limits and collisions of both arms are checked.",
    ),
]
MasterSpeed = Annotated[
    float | None,
    _option(PAIR, "--master-speed", "MM/S", "dual: speed at which the master moves the part (mm/s); default 5."),
]
MasterTurn = Annotated[
    float | None,
    _option(PAIR, "--master-turn", "DEG/S", "dual: the part turns about its own axis meanwhile (deg/s); default 0."),
]
MasterPath = Annotated[
    Path | None,
    _option(PAIR, "--master-path", "FILE", "dual: CSV of the part's or the master's flange's poses over time instead."),
]
Standoff = Annotated[
    float | None,
    _option(PAIR, "--standoff", "MM", "dual: follow this far above the part, without force (mm); default: press."),
]

# Run
Experiment = Annotated[
    str,
    typer.Argument(metavar="EXPERIMENT", help="arc, force, surface, smooth, teach or dual.", show_default=False),
]
Controller = Annotated[
    str | None,
    _option(RUN, "--controller", "NAME", "A shipped one of 'polish-sim list' (default hybrid-pi), or FILE.py:CLASS."),
]
Calibration = Annotated[
    list[Path] | None,
    _option(
        RUN,
        "--calibration",
        "FILE",
        "calibration.toml of 'calibrate payload': the tool whose weight is compensated; in dual also of 'calibrate "
        "arm', 'base' and 'tcp', one of each; default: calibrated before the run.",
    ),
]
Seed = Annotated[int | None, _option(RUN, "--seed", "N", "Seed of everything random; default 0.")]
Seeds = Annotated[int | None, _option(RUN, "--seeds", "N", "Run this many seeds, counting up from --seed.", least=1)]
DryRun = Annotated[bool, _option(RUN, "--dry-run", None, "Plan and check the reach, do not simulate.")]
Check = Annotated[bool, _option(RUN, "--check", None, "Exit with 1 when a figure falls short of what is asked of it.")]
Faults = Annotated[
    list[str] | None,
    _option(
        RUN,
        "--fault",
        "NAME@TIME",
        "Inject a fault so many seconds from the start, or NAME@contact+TIME from first contact; may be repeated. "
        "'polish-sim list faults' names them.",
    ),
]
View = Annotated[bool, _option(RUN, "--view", None, "Watch the run in the MuJoCo viewer.")]

# Config
Config = Annotated[Path | None, _option(CONFIG, "--config", "FILE.toml", "TOML file; see 'polish-sim config'.")]
Set = Annotated[list[str] | None, _option(CONFIG, "--set", "KEY=VALUE", "KEY=VALUE of the config; may be repeated.")]

# Output
Video = Annotated[bool, _option(OUTPUT, "--video", None, "Write a video of the run (mp4, or GIF without ffmpeg).")]
LogRate = Annotated[
    str | None, _option(OUTPUT, "--log-rate", "HZ|full", "Rows of the log per second (Hz), or 'full'; default 250.")
]
Export = Annotated[
    list[str] | None,
    _option(
        OUTPUT,
        "--export",
        "NAME",
        "Also write the plan as apt, urscript, ros, ply, glb, html, or all of them; may be repeated.",
    ),
]
Out = Annotated[
    Path | None, _option(OUTPUT, "--out", "DIR", "Output folder; default results/<command>[-<experiment>]/<date-time>.")
]
Overwrite = Annotated[bool, _option(OUTPUT, "--overwrite", None, "Replace files in an existing output folder.")]
