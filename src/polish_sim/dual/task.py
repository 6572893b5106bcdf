"""The task of two robots, planned and checked before anything moves: on a region, or once round its rim."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from polish_sim.arrays import Array, chord_lengths, evenly_to, joined, norms, running_sums, unit
from polish_sim.cell import SILENT, Observer, Stroke
from polish_sim.cell.stroke import expected_duration
from polish_sim.config import Checked, DualConfig, PartConfig, PlanConfig
from polish_sim.dual.arms import NOMINAL_ARMS, ClosedChain, PairArms, follow_joints, pair_arms, real_arms
from polish_sim.dual.calibration.bases import ROBOTS
from polish_sim.dual.carrier import MasterRows
from polish_sim.dual.checks import MotionCheck, check_length, check_motion
from polish_sim.dual.frames import PairFrames, Site, calibrated_frames, spread_marks, tracker_sees, true_chain
from polish_sim.dual.master import master_motion
from polish_sim.dual.placement import (
    Collides,
    PairReach,
    PairWork,
    find_pair_reach,
    held_poses,
    sampled,
    tool_on_start,
)
from polish_sim.dual.scene import (
    Clearances,
    Held,
    Seat,
    build_pair_scene,
    load_of,
    pair_contacts,
    seat_part,
    seat_text,
)
from polish_sim.dual.strokes import Visits, lifted, pair_strokes, plan_visits
from polish_sim.errors import PlanError, SmoothingError
from polish_sim.experiments.assembly import Workplace
from polish_sim.experiments.part_setup import PlacedTool, check_set_points, real_shape, unplaced_tool
from polish_sim.experiments.placement import Reach, check_shaft
from polish_sim.geometry import PartMesh, Region, Surface, fit_surface
from polish_sim.motion import forward, use_arm
from polish_sim.planning import PlanResult
from polish_sim.planning.moves.travel import Move, move_in, path_of
from polish_sim.planning.part_plan import choose_region, load_mesh
from polish_sim.planning.toolpath import APPROACH, PROCESS, RETRACT, ToolPath, arc_length, interpolate
from polish_sim.spatial import inverse

SAMPLES = 60  # moments of the work at which a placement is tried, at least
SAMPLE_M = 0.02  # between its places then, at the usual feed, at most [m]
CHECK_S = 0.05  # between the moments at which the chosen placement is checked, at most [s]
CHECK_M = 0.001  # between its places, at most [m]
ROW_S = 0.02  # between rows of the master's joints [s]
SPARE_S = 1.0  # of its motion beyond the work, should the controller slow the feed [s]
FRAMES_STREAM = 15  # of the seed, for the simulated calibrations
ARMS_STREAM = 16  # of the seed, for arms off their tables


@dataclass(frozen=True)
class DualTask:
    """Part, path, motion of both arms, and the true and the believed frames."""

    #: As the follower sees it, part at the start of its way and where the host believes it to be
    place: Workplace
    frames: PairFrames
    arms: PairArms
    seat: Seat
    reach: PairReach
    work: PairWork  #: As the host believes it
    strokes: list[Stroke]  #: What the tool does, base of the follower, the part at its start
    master: MasterRows
    residual: float  #: Of the closed chain, over the planned joints [m] or [rad]


def prepare_dual(scenario: Checked, plan: PlanResult | None = None, observer: Observer = SILENT) -> DualTask:
    """Plan the path, or take a plan, calibrate, and check that both arms can do all of it without touching
    each other.

    Raises PolishSimError if the part cannot be used or planned, a calibration does not fit, or an arm cannot
    follow.
    """
    dual = scenario.dual
    use_arm(scenario.robot.arm)
    observer.stage("plan the path")
    mesh, surface, region, path = _given_or_rim(scenario.part, scenario.plan, plan)
    load_of(mesh, dual.density_kg_m3)
    check_set_points(path)
    path = lifted(path, dual.standoff_m)
    check_shaft(path, surface, dual.pad_clearance_m)
    seat = seat_part(surface, region.up, dual.part_on_gripper)
    # The tool's limits alone decide how fast the work goes.
    loose, feed = pair_strokes(scenario, path, unplaced_tool(path)), scenario.process.feed_m_s
    lasts = sum(map(expected_duration, loose))
    visits = plan_visits(loose, min(lasts / SAMPLES, SAMPLE_M / feed))
    true = true_chain(dual, seat.T_gripper_work)
    job = PairJob(scenario, mesh, path, visits, region.up, seat.nose)
    marks = spread_marks(region, surface, dual.marks)
    made = NOMINAL_ARMS
    drawn = None
    work = _asked_of_both(job, true)
    site = Site(_half_way(work, next(held_poses(scenario.part.pose, work, region.up))), marks)
    if scenario.robot.elastic:
        # Gears err by pose: arms are calibrated as they will stand at work.
        drawn = _find_way(job, true, observer)[1]
        q_work = {"master": drawn.q_master, "follower": drawn.q_follower}
        made = real_arms(scenario.robot.real, scenario.seed, _scene(job, true), q_work)
        site = Site(_half_way(work, drawn.T_master_work), marks, q_work)
    observer.stage("calibrate the robots")
    rng = np.random.default_rng([scenario.seed, ARMS_STREAM])
    arms = pair_arms(dual, scenario.robot.compensation, tracker_sees(true.T_master_follower), rng, made)
    rng = np.random.default_rng([scenario.seed, FRAMES_STREAM])
    frames = calibrated_frames(dual, true, site, rng, arms)
    work, reach, collides = _find_way(job, frames.believed, observer, drawn)
    T_base_work = inverse(frames.believed.T_master_follower) @ reach.T_master_work
    shape = real_shape(scenario.part, scenario.plan.feature_angle_rad, mesh, surface, path)
    rotations = tool_on_start(work, reach, path.axes_work, visits.clock_at(path.s))
    own = Reach(T_base_work, rotations[0, :, 0], reach.q_follower, reach.value)
    place = Workplace(mesh, surface, region, path, own, shape, held=seat_text(seat.T_gripper_work))
    placed = PlacedTool(T_base_work, rotations, None)
    master = _master_rows(dual, frames, arms, reach, work)
    close = plan_visits(loose, min(CHECK_S, CHECK_M / feed))
    check_motion(MotionCheck(work, reach, close, scenario.robot), master, collides)
    strokes = pair_strokes(scenario, path, placed)
    return DualTask(place, frames, arms, seat, reach, work, strokes, master, _residual(work, reach, arms))


class PairJob(NamedTuple):
    """What both arms are to do."""

    scenario: Checked
    mesh: PartMesh
    path: ToolPath
    visits: Visits
    up: Array  #: Side of the part to be worked on, work frame, shape (3,)
    nose: float  #: Of the gripper, see `Held`


def _find_way(
    job: PairJob, chain: ClosedChain, observer: Observer, like: PairReach | None = None
) -> tuple[PairWork, PairReach, Collides]:
    """A way to do it with a chain, ``like`` one found before for another chain close to it; else
    ReachError."""
    observer.stage("check the reach of both robots")
    work = _asked_of_both(job, chain)
    dual, pose = job.scenario.dual, job.scenario.part.pose
    clearances = Clearances(dual.clearance_m, dual.pad_clearance_m)
    collides = pair_contacts(_scene(job, chain, clearances), clearances)
    held = held_poses(pose, work, job.up) if like is None else iter([like.T_master_work])
    return work, find_pair_reach(work, held, collides, like), collides


def _scene(job: PairJob, chain: ClosedChain, clearances: Clearances | None = None) -> mujoco.MjModel:
    """The scene by a chain, nominal arms."""
    held = Held(job.mesh, job.scenario.dual.density_kg_m3, chain.T_flange_work, job.nose, clearances)
    return build_pair_scene(job.scenario, inverse(chain.T_master_follower), held)


def _given_or_rim(
    part: PartConfig, asked: PlanConfig, plan: PlanResult | None
) -> tuple[PartMesh, Surface, Region, ToolPath]:
    """The path that was given, else once around the part's rim; and what it is on."""
    if plan:
        return plan.mesh, plan.surface, plan.region, plan.path
    mesh = load_mesh(part)
    surface = fit_surface(mesh, asked.feature_angle_rad)
    region = choose_region(mesh, surface, asked)
    return mesh, surface, region, rim_path(surface, region, asked.clearance_m)


def _asked_of_both(job: PairJob, chain: ClosedChain) -> PairWork:
    """The work of both robots with a chain."""
    way = master_motion(job.scenario.dual, job.path, job.up, chain)
    check_length(job.visits, way)
    return PairWork(chain, job.visits, way)


def _half_way(work: PairWork, T_master_work: Array) -> Array:
    """Half way from where the part is held, base of the master, shape (4, 4)."""
    T_half = T_master_work.copy()
    T_half[:3, 3] += work.middle
    return T_half


def _master_rows(
    dual: DualConfig, frames: PairFrames, arms: PairArms, reach: PairReach, work: PairWork
) -> MasterRows:
    """Joints of the master along its way; the loop lets their time begin and end gently."""
    believed = frames.believed
    true = frames.true
    duration = min(work.visits.clock[-1] + SPARE_S, work.way.lasts)
    time = evenly_to(duration, ROW_S)
    T_base_flange = believed.master_flange(work.way(reach.T_master_work, time))
    q = arms.joints("master", T_base_flange, follow_joints(T_base_flange, reach.q_master, "master"))
    T_master_work = arms.resting_flange("master", q[0]) @ true.T_flange_gripper @ true.T_gripper_work
    return MasterRows(
        time[1],
        q,
        np.ascontiguousarray(CubicSpline(time, q)(time, 1)),
        inverse(true.T_master_follower) @ T_master_work,
        inverse(believed.T_master_follower) @ true.T_master_follower,
        arms.believed["master"],
        arms.known["master"],
        dual.master_delay_s,
        1.0 / dual.master_rate_hz,
        dual.command_lead_s,
    )


def _residual(work: PairWork, reach: PairReach, arms: PairArms) -> float:
    """How far the closed chain of the planned joints is from closing, by the host's tables [m] or [rad]."""
    parts, tools = sampled(work, reach.T_master_work, reach.spin)
    T_work_tool = inverse(parts) @ work.chain.T_master_follower @ tools
    wanted = work.chain.master_flange(parts), work.chain.follower_flange(parts, T_work_tool)
    reached = []
    for robot, T, q_near in zip(ROBOTS, wanted, (reach.q_master, reach.q_follower), strict=True):
        q = arms.joints(robot, T, follow_joints(T, q_near, robot))
        reached.append(forward(q, arms.believed[robot]))
    return np.abs(work.chain.residual(reached[0], reached[1], T_work_tool)).max()


DEGREE = 5  #: Of the curve, which has four continuous derivatives everywhere


def fit_closed_spline(points: Array) -> BSpline:
    """The curve, C4 everywhere, through points (n, 3) [m] in order and back to the first one, which is not
    repeated; its parameter grows by chord length, see `length_of`.

    Raises SmoothingError for two neighbours in one place.
    """
    round_trip = np.concatenate([points, points[:1]])
    chords = chord_lengths(round_trip)
    if chords.min() <= 1e-9:
        k = chords.argmin()
        raise SmoothingError(
            f"points {k + 1} and {(k + 1) % len(points) + 1} are in one place: leave one out."
        )
    u = running_sums(chords)
    return make_interp_spline(u, round_trip, k=DEGREE, bc_type="periodic")


def length_of(curve: BSpline) -> float:
    """Sum of the chords of a closed curve [m]: its parameter once round."""
    return curve.t[-1 - DEGREE]


SPACING = 0.001  # of the path's points [m]
POINTS = (12, 24, 48, 96)  # the curve goes through as few points as will do
OFF_SURFACE = 2e-5  # the curve may leave the surface by this [m]
_DENSE = 5e-4  # between points the borders are compared at [m]


def rim_path(surface: Surface, region: Region, clearance: float) -> ToolPath:
    """Plan a path down to the rim, once around a ring-shaped region and up, from ``clearance`` [m] above the
    part.

    Raises PlanError if the region is no ring, or too uneven for a smooth curve on it.
    """
    loops = region.boundary_loops
    if len(region.components()) != 1 or len(loops) != 2:
        raise PlanError(
            "a path around a rim needs a region in one piece with an outer and an inner border; this one has "
            f"{len(region.components())} piece(s) and {len(loops)} border(s). Choose a ring with --region, "
            "or give a path with --path."
        )
    outer, inner = (_resampled(loop, max(8, round(arc_length(loop)[-1] / _DENSE))) for loop in loops)
    curve = _curve_between(surface, outer, inner)
    length = length_of(curve)
    u = np.linspace(0.0, length, max(24, round(length / SPACING)) + 1)
    positions = curve(u)
    there = surface.closest(positions)
    bend = surface.normal_curvature(there.facets, there.barycentric, unit(curve(u, 1)))
    axes = there.normals
    above = positions + clearance * axes
    moves = (
        move_in(APPROACH, above[:1], axes[:1], 0),
        move_in(PROCESS, positions, axes, 0),
        move_in(RETRACT, above[-1:], axes[-1:], 0),
    )
    return path_of(Move(*joined(moves)), np.pad(bend, 1, mode="edge"))


def _curve_between(surface: Surface, outer: Array, inner: Array) -> BSpline:
    """The closed curve through points of the surface midway between two borders, (p, 3) and (q, 3)."""
    gap = np.inf
    for count in POINTS:
        out = outer[np.linspace(0, len(outer), count, endpoint=False).astype(int)]
        nearest = inner[np.argmin(norms(out[:, None] - inner[None]), axis=1)]
        curve = fit_closed_spline(surface.closest(0.5 * (out + nearest)).positions)
        points = curve(np.linspace(0.0, length_of(curve), 8 * count))
        gap = norms(points - surface.closest(points).positions).max()
        if gap <= OFF_SURFACE:
            return curve
    raise PlanError(
        f"a curve through {POINTS[-1]} points of this rim is still {1e3 * gap:.2f} mm off its surface: the "
        "rim is too uneven. Choose a smoother one with --region, or give a path with --path."
    )


def _resampled(loop: Array, count: int) -> Array:
    """Points at equal steps along a closed polyline, its end left out, shape (count, 3)."""
    s = arc_length(loop)
    return interpolate(np.linspace(0.0, s[-1], count, endpoint=False), s, loop)
