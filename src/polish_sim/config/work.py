"""What is done to which part: part, plan, process and smoothing."""

from __future__ import annotations

import math
from dataclasses import dataclass

from polish_sim.config.key import AXIS, DEG, DIRECTION, FEED, MM, NEWTON, PART, PATH, POSE, TOOL, Option, key

LEAST_FORCE_N = 0.5  #: Of any point of a path in contact
MOST_LEAN_RAD = math.radians(40.0)  #: Further over the pad touches with its edge only


@dataclass(frozen=True)
class PartConfig:
    """Which part is in the cell, where, and how it differs from its drawing."""

    file: str = key(
        "freeform",
        "STL, PLY, OBJ or STEP file, or the name of a shipped part",
        option=Option("--part", PART, "PART"),
    )
    real_file: str = key(
        "",
        "the part as it really is (file or shipped part, unit and frame of the nominal one): contact with "
        "this, path from the nominal one; empty = as drawn",
        option=Option("--real-part", PART, "PART"),
    )
    fixture_file: str = key(
        "",
        "mesh of what holds the part (unit and frame of the part), which tool and arm keep clear of; empty "
        "= none",
        option=Option("--fixture", PART, "FIXTURE"),
    )
    unit: str = key(
        "auto",
        "unit of the part's file: mm, cm, m or inch; auto = mm, or m where only that makes a sensible part; "
        "STEP files state their own",
        option=Option("--units", PART, "UNIT"),
    )
    up: str = key(
        "auto",
        "side turned up: auto, x, y, z, -x, -y, -z, or a direction X,Y,Z",
        option=Option("--up", PART, "SIDE"),
    )
    pose: tuple[float, ...] = key(
        (),
        "pose of the work frame in the base frame: x, y, z [m], rotation vector [rad]; auto = where the arm "
        "does the whole path",
        -100.0,
        100.0,
        length=6,
        option=Option(
            "--part-pose",
            PART,
            "POSE",
            POSE,
            help="X,Y,Z,RX,RY,RZ of the part in the robot base (mm, deg); auto = where the arm does the "
            "whole path",
        ),
    )
    displacement_m: float = key(0.001, "how far the real part sits from its nominal place [m]", 0.0, 0.02)
    rotation_rad: float = key(math.radians(0.5), "how far the real part is turned [rad]", 0.0, 0.2)
    form_error_m: float = key(0.0003, "form error of the real part, peak to peak [m]", 0.0, 0.005)
    motion_m: float = key(
        0.0, "the part moves along its mean normal by a sine of this amplitude [m]", 0.0, 0.02
    )
    motion_hz: float = key(1.0, "frequency of that motion [Hz]", 0.0, 50.0)


@dataclass(frozen=True)
class PlanConfig:
    """How the tool path covers the region."""

    file: str = key(
        "",
        "a finished path to run: plan folder, path.json, CSV or APT file; empty = plan anew",
        option=Option("--path", PATH, "PLAN"),
    )
    begin_m: float = key(
        0.0,
        "a finished path is run from this arc length on; what lies before counts as done [m]",
        0.0,
        1e4,
        option=Option("--from", PATH, "MM", MM),
    )
    pattern: str = key(
        "spiral", "spiral, raster, contour or fermat", option=Option("--pattern", PATH, "NAME")
    )
    region: str = key(
        "auto",
        "auto, top, all, point:X,Y,Z, box:X0,Y0,Z0,X1,Y1,Z1, polygon:X,Y,Z;X,Y,Z;..., polygon:FILE, "
        "faces:FILE (mm) or under:REMOVAL.ply:SHARE, where a run took off less",
        option=Option("--region", PART, "REGION"),
    )
    feature_angle_rad: float = key(
        math.radians(30.0),
        "edges that bend by more than this bound a smooth face [rad]",
        math.radians(1.0),
        math.radians(175.0),
        option=Option("--feature-angle", PART, "DEG", DEG),
    )
    edge_margin_m: float = key(
        0.0,
        "how far the region keeps from its outer edges, along the surface [m]",
        0.0,
        0.5,
        option=Option("--edge-margin", PART, "MM", MM),
    )
    hole_margin_m: float = key(
        0.0,
        "how far the region keeps from the edges of its holes, along the surface [m]",
        0.0,
        0.5,
        option=Option("--hole-margin", PART, "MM", MM),
    )
    stepover_m: float = key(
        0.008,
        "distance between neighbouring turns [m]",
        0.0002,
        1.0,
        option=Option("--stepover", PATH, "MM", MM),
    )
    bridge_m: float = key(0.02, "holes up to this diameter are run over by the pad [m]", 0.0, 0.5)
    overrun_m: float = key(
        0.0,
        "how far past its border the region is covered, with nothing under the pad's middle; only where "
        "nothing stands beside the region [m]",
        0.0,
        0.1,
        option=Option("--overrun", PATH, "MM", MM),
    )
    removal: str = key(
        "",
        "even, or a PLY map (mm; a vertex property target, relative or removal_m): feed and force follow "
        "what is to come off; empty = one feed",
        option=Option("--removal", PATH, "even|MAP.ply"),
    )
    removal_feed: tuple[float, ...] = key(
        (0.4, 2.0), "least and largest feed then, over the usual one [-]", 0.05, 20.0, length=2
    )
    removal_force: float = key(
        0.0, "share by which the force may then differ from the usual one, 0 = not at all [-]", 0.0, 0.9
    )
    order: str = key("inward", "spiral, contour: inward or outward", option=Option("--order", PATH, "NAME"))
    direction: str = key(
        "conventional",
        "spiral, contour: conventional (what is not done yet on the left) or climb; spirals round holes: "
        "climb alone",
        option=Option("--direction", PATH, "NAME"),
    )
    start: tuple[float, ...] = key(
        (),
        "the path begins as near this point as pattern and order allow: x, y, z in the work frame [m]; auto "
        "= chosen",
        length=3,
        option=Option("--start", PATH, "X,Y,Z", MM),
    )
    raster_direction: tuple[float, ...] = key(
        (),
        "direction of the raster's lines: x, y, z in the work frame; auto = along the region's long axis",
        length=3,
        option=Option("--raster-direction", PATH, "X,Y,Z", DIRECTION),
    )
    clearance_m: float = key(0.03, "height of the first and last point above the part [m]", 0.001, 0.5)
    tool_clearance_m: float = key(
        0.001, "pad, shaft, spindle, sensor and wrist keep this from what stands beside them [m]", 0.0, 0.05
    )
    avoid: str = key(
        "trim",
        "where walls leave the spindle no room: trim (left out) or tilt (the tool leans away if that gains "
        "ground)",
        option=Option("--avoid", AXIS, "NAME"),
    )
    lead_in: str = key(
        "normal", "how the tool lands: normal, tangent or arc", option=Option("--lead-in", AXIS, "NAME")
    )
    lead_angle_rad: float = key(
        0.0,
        "the tool leans this far forward, along the feed [rad]",
        -MOST_LEAN_RAD,
        MOST_LEAN_RAD,
        option=Option("--lead-angle", AXIS, "DEG", DEG),
    )
    tilt_angle_rad: float = key(
        0.0,
        "the tool leans this far to the left of the feed [rad]",
        -MOST_LEAN_RAD,
        MOST_LEAN_RAD,
        option=Option("--tilt-angle", AXIS, "DEG", DEG),
    )
    axis_smoothing_m: float = key(
        0.0,
        "the tool axis is averaged over this length of the path, 0 = not [m]",
        0.0,
        1.0,
        option=Option("--axis-smoothing", AXIS, "MM", MM),
    )
    axis_deviation_rad: float = key(
        math.radians(5.0),
        "averaging turns the tool axis by no more than this [rad]",
        0.0,
        MOST_LEAN_RAD,
        option=Option("--axis-deviation", AXIS, "DEG", DEG),
    )


@dataclass(frozen=True)
class ProcessConfig:
    """What the tool is asked to do on the part."""

    contact_force_n: float = key(
        20.0,
        "force to hold along the tool axis [N]",
        LEAST_FORCE_N,
        200.0,
        option=Option("--contact-force", TOOL, "N", NEWTON),
    )
    feed_m_s: float = key(
        0.01,
        "speed along the path, slower where the plan was found to need it [m/s]",
        1e-4,
        0.5,
        option=Option("--feed", TOOL, "auto|MM/S", FEED),
    )
    approach_speed_m_s: float = key(0.005, "speed of the approach [m/s]", 1e-4, 0.3)
    hold_s: float = key(4.0, "how long `force` holds after first contact [s]", 1.0, 600.0)
    contact_threshold_n: float = key(
        2.0,
        "measured force that counts as contact; if the sensor is noisier, 5 sigma of its noise do [N]",
        0.1,
        50.0,
    )
    tare: str = key(
        "start",
        "when the sensor is zeroed in free space: start (of the run) or strokes (before each one)",
        words=("start", "strokes"),
    )
    search_depth_m: float = key(0.01, "how far past the nominal surface contact is sought [m]", 0.0, 0.1)
    preston_1_pa: float = key(
        0.0,
        "wear coefficient of Preston's law, removal = this x pressure x way; 0 = unknown, removal relative "
        "[1/Pa]",
        0.0,
        1.0,
    )
    changes: str = key(
        "",
        "set points changed during the run, with commas: force_n=N@TIME or feed_m_s=M_S@TIME, seconds from "
        "the start, or @contact+TIME; empty = none",
    )
    learn: str = key(
        "",
        "a run along the same path on the same part: its tool depths are fed forward; empty = none",
        option=Option("--learn", TOOL, "RUN"),
    )
    max_feed_s: float = key(0.0, "stop the feed after this long, 0 = the whole path [s]", 0.0, 1e6)


@dataclass(frozen=True)
class SmoothingConfig:
    """How way points become a motion."""

    rule: str = key(
        "spline",
        "surface: spline, joint-jerk, joint-acceleration, or none: constant feed, no limits; "
        "smooth plays the three in the middle",
    )
    tolerance_m: float = key(
        1e-4, "how far the tool may be from the path, 0 = exact (not with spline) [m]", 0.0, 0.01
    )
    axis_tolerance_rad: float = key(
        math.radians(0.2),
        "how far the tool axis may be from its way, 0 = exact (not with spline) [rad]",
        0.0,
        0.2,
    )
    limits_file: str = key("", "TOML file of limits, see 'smooth --limits'; empty = the experiment's own")
