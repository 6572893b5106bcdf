"""From a part in a scenario to a part in the cell."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Figures, dots, norms
from polish_sim.cell import Stroke, Touch, tool_on_flange
from polish_sim.cell.stroke import TRAVEL_PACE, TRAVEL_SPEED, air_length, feed_pace
from polish_sim.config import HeadConfig, PadConfig, PartConfig, ProcessConfig, Scenario
from polish_sim.errors import MeshError, PlanError, place_in_mm
from polish_sim.experiments.placement import Reach, tool_rotations
from polish_sim.experiments.stroke_motion import CELL_LIMITS, stroke_motion, stroke_path
from polish_sim.geometry import PartMesh, Surface, fit_surface, load_part
from polish_sim.models import part_path
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.trajectory import (
    PathTable,
    TimedPath,
    at_rows,
    build_path_table,
    time_path,
    with_feed_share,
)
from polish_sim.planning.toolpath import APPROACH, LEAD_IN, ToolPath, pressed, stretches
from polish_sim.spatial import apply, matrices


class Streams(NamedTuple):
    """Independent generators of one seed."""

    sensor: np.random.Generator
    part: np.random.Generator  #: Of its errors
    payload: np.random.Generator  #: Of its calibration


def random_streams(seed: int) -> Streams:
    """The generators of a seed."""
    return Streams(*map(np.random.default_rng, np.random.SeedSequence(seed).spawn(3)))


def sunk_under(force: Array, head: HeadConfig, pad: PadConfig) -> Array:
    """Depth of the tool under a force [N], shape (n,) [m]: D = F / k, head spring and pad in series (paper 1,
    section 1.5); an active flange is held at mid stroke."""
    if head.flange.bandwidth_hz:
        return 0.5 * head.travel_m * (force > 0.0) + force / pad.stiffness_n_m
    return force / (1.0 / (1.0 / head.stiffness_n_m + 1.0 / pad.stiffness_n_m))


def check_set_points(path: ToolPath) -> None:
    """Refuse forces and feeds of a path that a scenario could not be set to either.

    Raises:
        PlanError: Naming the point, the value and the range.
    """
    ranges = {f.name: (f.metadata["low"], f.metadata["high"]) for f in fields(ProcessConfig)}
    for name, column, key, unit in (
        ("force", path.force, "contact_force_n", "N"),
        ("feed", path.feed, "feed_m_s", "m/s"),
    ):
        if column is None:
            continue
        low, high = ranges[key]
        wrong = np.flatnonzero(path.process & ~((column >= low) & (column <= high)))
        if len(wrong):
            raise PlanError(
                f"at {place_in_mm(path.positions_work[wrong[0]])} the path asks for a {name} of "
                f"{column[wrong[0]]:.4g} {unit}: it must be within {low:g} to {high:g} {unit}. Mend "
                "the path's file."
            )


class PlacedTool(NamedTuple):
    """A path before the robot, and how the tool stands at its points."""

    T_base_work: Array  #: Pose of the work frame, shape (4, 4)
    rotations: Array  #: R_base_tool at every point of the path, shape (n, 3, 3)
    arm: Arm | None  #: The robot, for strokes that keep the limits of its joints; None: only the tool's count


def placed_tool(path: ToolPath, reach: Reach) -> PlacedTool:
    """The tool along a path on a part that stands still, and the arm that holds it."""
    arm = Arm(np.eye(4), tool_on_flange(), reach.q_start)
    return PlacedTool(reach.T_base_work, reach.rotations(path.axes_work), arm)


def unplaced_tool(path: ToolPath) -> PlacedTool:
    """The tool alone, in the work frame."""
    return PlacedTool(np.eye(4), tool_rotations(path.axes_work, 0.0), None)


def placed_strokes(
    scenario: Scenario,
    path: ToolPath,
    placed: PlacedTool,
    hold: float,
    lift: float,
    progress: Callable[[float, float], None] = lambda done, total: None,
    air: SmoothingLimits | None = None,
) -> list[Stroke]:
    """The strokes of a path, base frame: for each stretch in contact the way down to it and the stretch,
    pressed in.

    The path is in the work frame, not pressed. The tool stays ``hold`` [s] at the end of a stroke and is
    lifted by ``lift`` [m]; 0 for no retract. ``progress`` is called with the length done and the whole length
    [m]. With limits for the ``air`` the path is followed where it is, and nothing is touched.
    """
    process = scenario.process
    rotations = placed.rotations
    wanted = path.force_at(path.s, process.contact_force_n) * (air is None)
    depths = sunk_under(wanted, scenario.head, scenario.pad)
    nominal = apply(placed.T_base_work, path.positions_work)
    pressed_in = apply(placed.T_base_work, pressed(path, depths).positions_work)
    strokes: list[Stroke] = []
    left = process.max_feed_s or math.inf
    for first, last in stretches(path.process):
        leave = first - points_before(path, first)
        come = first if air else _last_approach(path, leave, first, lift) if strokes else leave
        through, before = slice(leave, come + 1), slice(come, first + 1)
        during = slice(first, last + 1)
        s = path.s[during]
        table = build_path_table(
            pressed_in[during], rotations[during], s, path.curvature[during], path.pass_index[during]
        )
        force = at_rows(table, s, wanted[during])
        along = stroke_path(path, during, pressed_in, rotations, process.feed_m_s, air or CELL_LIMITS)
        if path.feed is not None:
            table = with_feed_share(table, s, along.feed / process.feed_m_s)
        motion = stroke_motion(scenario.smoothing, along, placed.arm) or time_path(
            table, feed_pace(process.feed_m_s)
        )
        strokes.append(
            Stroke(
                travel=travel_to(strokes, nominal[through], rotations[through]),
                lead_in=_air_table(nominal[before], rotations[before], process.approach_speed_m_s),
                process=table,
                motion=motion,
                depth=depths[first],
                early=scenario.pad.radius_m
                * math.tan(math.hypot(scenario.plan.lead_angle_rad, scenario.plan.tilt_angle_rad)),
                force=force,
                contact=air is None,
                approach_speed=process.approach_speed_m_s,
                feed=process.feed_m_s,
                threshold=process.contact_threshold_n,
                search_depth=process.search_depth_m,
                hold=hold,
                feed_time=left,
                lift=_lift_off(lift, depths[first], depths[last]),
                start_s=path.s[first],
                retare=bool(strokes) and process.tare == "strokes",
            )
        )
        left -= motion.playing_time
        progress(path.s[last], path.length_m)
        if left <= 0.0:
            break
    return strokes


def path_done(path: ToolPath, fed_s: Array) -> float:
    """Share of the path in contact that was fed along, 0 to 1.

    ``fed_s`` (n,) [m] is the arc length of the plan at the steps of the process phase.
    """
    if not len(fed_s):
        return 0.0
    begin, end = path.s[np.transpose(stretches(path.process))]
    total = sum(end - begin)
    reached = fed_s[-1] + 1e-9  # the law of the feed may end some roundings short of the last point
    left = sum(np.maximum(end - np.maximum(begin, reached), 0.0))
    return 1.0 - left / total if total > 0.0 else 1.0


def _lift_off(lift: float, depth_first: float, depth_last: float) -> float:
    """Lift that ends at the wanted height above the surface though the path ends at another depth [m]."""
    return max(lift + (depth_last - depth_first), 1e-3) if lift > 0.0 else 0.0


def points_before(path: ToolPath, first: int) -> int:
    """Number of approach and lead-in points right before a stretch."""
    count = 0
    while count < first and path.segment[first - 1 - count] in (APPROACH, LEAD_IN):
        count += 1
    return count


def _last_approach(path: ToolPath, leave: int, first: int, lift: float) -> int:
    """Row from which the tool comes down to a stretch; before it, it travels at least as high as it was
    lifted."""
    way = path.positions_work[leave:first] - path.positions_work[first]
    return leave + int(max(np.flatnonzero(way @ path.axes_work[first] >= lift - 1e-9), default=0))


def travel_to(strokes: list[Stroke], way: Array, rotations: Array) -> TimedPath:
    """From above the end of the last stroke through the air to where the next way down begins."""
    if not strokes:
        return time_path(build_path_table(way[:1], rotations[:1]), TRAVEL_PACE)
    last = strokes[-1]
    R_last = matrices(last.process.quaternions[-1])
    above = last.process.positions[-1] - (last.lift + last.depth) * R_last[:, 2]
    return time_path(
        _air_table(np.vstack([above, way]), np.stack([R_last, *rotations]), TRAVEL_SPEED), TRAVEL_PACE
    )


def _air_table(positions: Array, rotations: Array, speed: float) -> PathTable:
    """A way through the air, followed at a ``speed`` [m/s]; where the tool turns it is as long as that
    takes."""
    return build_path_table(positions, rotations, air_length(positions, rotations, speed))


# The part's shape as it really is: its own mesh where one is given, else the drawing.
#
# A plan is made on the drawing, what is polished is a casting with an edge too many. The mesh of the real
# part lies in the drawing's frame and unit; displacement, rotation and form error come on top.

#: A real part farther than this from most of the path is another part, or lies in another frame [m]
FAR_M = 0.02


class RealShape(NamedTuple):
    """What stands in the cell before it is displaced and bent; work frame."""

    mesh: PartMesh  #: The mesh that is drawn
    surface: Surface  #: The whole of it
    given: bool  #: Whether it has a mesh of its own


def real_shape(
    config: PartConfig, angle: float, mesh: PartMesh, surface: Surface, path: ToolPath
) -> RealShape:
    """Load the real part's mesh, if there is one, and check that it is where the path on the
    nominal one is.

    It is read as the nominal one is, with features of the same ``angle`` [rad]; that is the shape if none is
    named.

    Raises:
        MeshError: If it cannot be read, or does not lie where the drawing says.
    """
    if not config.real_file:
        return RealShape(mesh, surface, given=False)
    actual = load_part(part_path(config.real_file), mesh.unit, config.up)
    shape = RealShape(actual, fit_surface(actual, angle), given=True)
    _check_place(shape, mesh, config, path.in_contact.positions)
    return shape


def touched(shape: RealShape, path: ToolPath, pad_radius: float, depth: float) -> Touch:
    """Where the pad goes: along the path, and where the real surface lies above or below it, there too.

    The part is to be modelled ``depth`` [m] deep.
    """
    positions, axes = path.in_contact
    if not shape.given:
        return Touch(positions, axes, pad_radius, depth)
    there = shape.surface.closest(positions).positions
    return Touch(np.vstack([positions, there]), np.vstack([axes, axes]), pad_radius, depth)


def shape_figures(shape: RealShape, path: ToolPath) -> Figures:
    """How far the real part, before it is displaced and bent, lies from the drawing along the path.

    ``real_part``: lowest and highest place above the path [m] and what its mesh needed; empty without its own
    mesh.
    """
    if not shape.given:
        return {}
    positions, axes = path.in_contact
    above = dots(shape.surface.closest(positions).positions - positions, axes)
    facts = {"lowest_m": above.min(), "highest_m": above.max(), "notes": list(shape.mesh.notes)}
    return {"real_part": facts}


def _check_place(shape: RealShape, mesh: PartMesh, config: PartConfig, positions: Array) -> None:
    """Refuse a real part that most of the path does not lie on.

    Raises:
        MeshError: Saying how far away it is, and how large beside the drawing.
    """
    away = norms(shape.surface.closest(positions).positions - positions)
    if np.median(away) <= FAR_M:
        return
    nearest = away.argmin()
    raise MeshError(
        f"the real part '{config.real_file}' does not lie where '{config.file}' does: half of the path is "
        f"more than {1e3 * np.median(away):.4g} mm away from it (allowed: {1e3 * FAR_M:g} mm), the nearest "
        f"point of the path, {place_in_mm(positions[nearest])}, {1e3 * away[nearest]:.4g} mm. Read in "
        f"{shape.mesh.unit}, it is {_size(shape.mesh)} large and the nominal part {_size(mesh)}. Bring it to "
        "the nominal part's unit and frame."
    )


def _size(mesh: PartMesh) -> str:
    return " x ".join(f"{1e3 * side:.4g}" for side in np.ptp(mesh.vertices, axis=0)) + " mm"
