"""What two robots are to do, planned and checked before anything moves (layer 9)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from polish_sim.cell import Observer, Silent
from polish_sim.cell.carrier import RAMP_S, MasterRows
from polish_sim.cell.pair_contacts import CLEARANCE, PairContacts
from polish_sim.cell.pair_scene import Held, build_pair_scene, check_load
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.errors import ConfigError, PlanError, ReachError
from polish_sim.experiments.assembly import Workplace
from polish_sim.experiments.pair_frames import PairFrames, calibrated_frames, true_chain
from polish_sim.experiments.pair_placement import (
    Collides,
    PairReach,
    Work,
    default_poses,
    find_pair_reach,
    sampled,
    suggest_base,
)
from polish_sim.experiments.pair_survey import Site
from polish_sim.experiments.part_setup import check_set_points, part_file, stretches_in_contact
from polish_sim.experiments.placement import Reach, given_placement
from polish_sim.experiments.real_shape import real_shape
from polish_sim.experiments.rim_path import rim_path
from polish_sim.geometry import PartMesh, Region, Surface, fit_surface, load_part, select_region
from polish_sim.motion import forward_many
from polish_sim.motion.coordination import Chain2, follow_joints, master_flange, plan_coordinated
from polish_sim.planning import PlanResult, ToolPath
from polish_sim.spatial import inverse, perpendicular, rotation_to_axis, transform

Array = NDArray[np.float64]

ROW_S: Final = 0.02  # between rows of the master's joints [s]
SPARE_S: Final = 1.0  # of its motion beyond the path at the feed, for ramps of both [s]
FRAMES_STREAM: Final = 15  # of the seed, for the simulated calibrations


@dataclass(frozen=True)
class DualTask:
    """Part, path, both arms' way to do it, and what is believed of where everything stands."""

    place: Workplace
    """As the follower sees it, part at the start of its way and where the host believes it to be."""
    frames: PairFrames
    reach: PairReach
    way: Array
    """How the master moves the part, its base [m], shape (3,)."""
    master: MasterRows
    residual: float
    """Of the closed chain, over the planned joints [m] or [rad]."""


def prepare_dual(scenario: Scenario, plan: PlanResult | None = None, observer: Observer | None = None) -> DualTask:
    """Plan the path, calibrate, and check that both arms can do all of it without touching each other.

    Args:
        scenario: The scenario.
        plan: A path made before, on its part; else once around the part's rim.
        observer: Told of the progress.

    Returns:
        The task.

    Raises:
        PolishSimError: If the part cannot be used or planned, a calibration does not fit, or an arm cannot follow.
    """
    observer = observer or Silent()
    build_controller(scenario.controller)
    observer.stage("plan the path")
    mesh, surface, region, path = _planned(scenario, plan)
    check_load(mesh, scenario.dual.density_kg_m3)
    check_set_points(path)
    touched, path = path, lifted(path, scenario.dual.standoff_m)
    way = master_way(scenario, path)
    observer.stage("calibrate the robots")
    frames = calibrated_frames(scenario.dual, _site(scenario, touched, region.up, way), _frames_stream(scenario.seed))
    observer.stage("check the reach of both robots")
    work = Work(frames.believed, path, way)
    poses = _poses(scenario, frames.believed, region.up, way)
    held = Held(mesh, scenario.dual.density_kg_m3, frames.true.T_flange_gripper, CLEARANCE)

    def contacts(T_master_follower: Array) -> Collides:
        return PairContacts(build_pair_scene(scenario, inverse(T_master_follower), held)).first

    try:
        reach = find_pair_reach(work, poses, contacts(frames.true.T_master_follower))
    except ReachError as error:
        observer.stage("look for another place of the follower's base")
        better = suggest_base(work, region.up, contacts)
        raise ReachError(f"{error} {_base_text(better)}") from error
    T_base_work = inverse(frames.believed.T_master_follower) @ reach.T_master_work
    own = Reach(T_base_work, reach.spin, reach.q_follower, reach.value)
    place = Workplace(mesh, surface, region, path, own, real_shape(scenario, mesh, surface, path))
    return DualTask(place, frames, reach, way, _master_rows(scenario, frames, reach, way), _residual(work, reach))


def master_way(scenario: Scenario, path: ToolPath) -> Array:
    """How far the master moves the part while the path is done at the feed, base of the master [m], shape (3,).

    Raises:
        ConfigError: The direction is none.
    """
    direction = np.array(scenario.dual.master_direction)
    size = float(np.linalg.norm(direction)) if len(direction) else 0.0
    if not size > 0.0:
        raise ConfigError("'dual.master_direction' is no direction: give x, y, z, not all zero.")
    return np.asarray(direction / size * scenario.dual.master_speed_m_s * _working_time(scenario, path))


def lifted(path: ToolPath, standoff: float) -> ToolPath:
    """What is done of a path: all of it in contact, else its part in contact at this height above the part [m].

    Raises:
        PlanError: The path leaves the part on its way and is to be followed above it: only one stretch can be.
    """
    if standoff == 0.0:
        return path
    stretches = len(stretches_in_contact(path))
    if stretches != 1:
        raise PlanError(
            f"this path touches the part in {stretches} stretches: at a stand-off (dual.standoff_m, --standoff) only "
            "one can be followed. Press with it (--standoff 0), or give a path of one stretch with --path."
        )
    path = path.rows(path.process)
    return replace(path, positions_work=path.positions_work + standoff * path.axes_work)


class _Planned(NamedTuple):
    mesh: PartMesh
    surface: Surface
    region: Region
    path: ToolPath


def _planned(scenario: Scenario, plan: PlanResult | None) -> _Planned:
    """The path that was given, else once around the part's rim; and what it is on."""
    if plan is not None:
        return _Planned(plan.mesh, plan.surface, plan.region, plan.path)
    mesh = load_part(part_file(scenario.part.file), scenario.part.unit, scenario.part.up)
    angle = scenario.plan.feature_angle_rad
    surface = fit_surface(mesh, angle)
    region = select_region(surface, mesh, scenario.plan.region, angle, scenario.plan.edge_margin_m)
    return _Planned(mesh, surface, region, rim_path(surface, region, scenario.plan.clearance_m))


def _base_text(T_master_follower: Array | None) -> str:
    if T_master_follower is None:
        return "No other place of the follower's base that was tried would do either."
    x, y = T_master_follower[:2, 3]
    return (
        "It can be done with the follower's base elsewhere and the part where it is put by itself: "
        f"--set dual.follower_pose=[{x:g},{y:g},0,0,0,{math.pi:.5g}]."
    )


def _poses(scenario: Scenario, chain: Chain2, up: Array, way: Array) -> Iterator[Array]:
    """Where the part may be held at the start of its way, base of the master, each (4, 4)."""
    if scenario.part.pose:
        return (chain.T_master_follower @ T for T in given_placement(scenario.part.pose))
    return default_poses(chain, up, way)


def _site(scenario: Scenario, path: ToolPath, up: Array, way: Array) -> Site:
    """Marks to find the part by, spread along the path, touched half way of the first place the part may be held."""
    rows = np.flatnonzero(path.process)
    rows = rows[np.linspace(0, len(rows), scenario.dual.marks, endpoint=False).astype(int)]
    T_master_work = next(_poses(scenario, true_chain(scenario.dual), up, way)).copy()
    T_master_work[:3, 3] += 0.5 * way
    R_work_tool = np.stack([rotation_to_axis(-axis[None], perpendicular(axis))[0] for axis in path.axes_work[rows]])
    return Site(T_master_work, transform(R_work_tool, path.positions_work[rows]))


def _frames_stream(seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, FRAMES_STREAM])


def _working_time(scenario: Scenario, path: ToolPath) -> float:
    """How long the path in contact takes at the feed, with something to spare [s]."""
    length = sum(float(path.s[b] - path.s[a]) for a, b in stretches_in_contact(path))
    longest = scenario.process.max_feed_s or math.inf
    return min(length / scenario.process.feed_m_s, longest) + SPARE_S


def _master_rows(scenario: Scenario, frames: PairFrames, reach: PairReach, way: Array) -> MasterRows:
    """Joints of the master along its way, at constant speed; the loop lets their time begin and end gently."""
    believed, true = frames.believed, frames.true
    speed = scenario.dual.master_speed_m_s
    duration = max(float(np.linalg.norm(way)) / speed if speed > 0.0 else 0.0, 2.0 * RAMP_S)
    rows = math.ceil(duration / ROW_S) + 1
    parts = np.tile(reach.T_master_work, (rows, 1, 1))
    parts[:, :3, 3] += np.linspace(0.0, 1.0, rows)[:, None] * way
    q = follow_joints(master_flange(believed, parts), reach.q_master, "master")
    time = np.linspace(0.0, duration, rows)
    T_master_work = forward_many(q[:1])[0] @ true.T_flange_gripper @ true.T_gripper_work
    return MasterRows(
        float(time[1]),
        q,
        np.ascontiguousarray(CubicSpline(time, q)(time, 1)),
        inverse(true.T_master_follower) @ T_master_work,
        inverse(believed.T_master_follower) @ true.T_master_follower,
    )


def _residual(work: Work, reach: PairReach) -> float:
    """How far the closed chain of the planned joints is from closing [m] or [rad]."""
    parts, tools = sampled(work, reach.T_master_work, reach.spin)
    T_work_tool = inverse(parts) @ work.chain.T_master_follower @ tools
    return plan_coordinated(work.chain, parts, T_work_tool, (reach.q_master, reach.q_follower)).residual
