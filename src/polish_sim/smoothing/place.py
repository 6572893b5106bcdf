"""A path laid before the robot as a chain of segments, and smoothed by a rule."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, chord_lengths, in_groups, turns_along
from polish_sim.cell import tool_on_flange
from polish_sim.errors import PolishSimError, ReachError, SmoothingError, place_in_mm
from polish_sim.exchange import WayPoints, plan_facts
from polish_sim.experiments.placement import (
    Reach,
    default_placements,
    failure_of,
    find_reach,
)
from polish_sim.motion.rules.chain import HALF_TURN, Chain, build_chain, chain_from_axes, part_of
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.rules.schedule import RULES, SmoothMotion
from polish_sim.planning.toolpath import APPROACH, RETRACT, ToolPath
from polish_sim.spatial import from_pose

FEW = 3  #: Segments that suffice to have a rule compiled
SAME_M, SAME_RAD = 1e-9, 1e-9  #: A way point that differs less than this from the one before is left out
STEP_M, STEP_RAD = 0.02, 0.1  #: The reach is checked at least this often on the way between two points


class PlacedPath(NamedTuple):
    """A path as smoothing takes it."""

    chain: Chain  #: Its segments in the work frame
    rows: Indices  #: Row of the file's path that each of the chain's way points is, shape (segments + 1,)
    arm: Arm | None  #: The robot before it; None for the tool alone


def path_without_robot(points: WayPoints) -> PlacedPath:
    """The path of a tool alone; SmoothingError for points all the same or an axis that turns by 180 deg."""
    rows = distinct_rows(points)
    chain = chain_from_axes(points.path.positions_work[rows], -points.path.axes_work[rows])
    return PlacedPath(chain, rows, None)


def place_path(points: WayPoints, pose: Sequence[float]) -> PlacedPath:
    """Lay a path before the robot as `run surface` does, and check that the arm follows it, else ReachError.

    ``pose``: of the work frame in the robot's base [m, rad]; empty: where a plan was proven, else chosen, the
    side turned up that it says, or that most tool axes point to.
    """
    rows = distinct_rows(points)
    positions = points.path.positions_work[rows]
    axes = points.path.axes_work[rows]
    facts = plan_facts(points.file)
    side = np.array(facts.get("up") or _main_side(axes), dtype=float)
    pose = pose or (facts.get("proof") or {}).get("pose", ())
    placements = [from_pose(pose)] if pose else default_placements(positions, side, (positions @ side).min())
    reach, _way, q = follow_path(
        points,
        rows,
        placements,
        "or smooth the tool's motion alone with --no-joints",
        "Move the path with --part-pose X,Y,Z,RX,RY,RZ (mm, deg).",
    )
    return PlacedPath(
        build_chain(positions, reach.T_base_work[:3, :3].T @ reach.rotations(axes)),
        rows,
        Arm(reach.T_base_work, tool_on_flange(), q[0].copy()),
    )


def distinct_rows(points: WayPoints) -> Indices:
    """Indices of a path that differ from the one before in tip or axis, in order.

    Raises:
        SmoothingError: As in `path_without_robot`.
    """
    axes = points.path.axes_work
    moved = (chord_lengths(points.path.positions_work) > SAME_M) | (chord_lengths(axes) > SAME_RAD)
    rows = np.flatnonzero([True, *moved])
    if len(rows) < 2:
        raise SmoothingError(
            f"'{points.file}': all points are the same: there is no way to go. Give two that differ."
        )
    half = np.flatnonzero(turns_along(axes[rows]) > HALF_TURN)
    if len(half):
        first, second = (points.place(rows[half[0] + k]) for k in range(2))
        raise SmoothingError(
            f"'{points.file}': the tool axis turns by 180 deg between {first} and {second}: which way round "
            "is not given. Put a point between them."
        )
    return rows


class PlacedWay(NamedTuple):
    """Way points with more between them."""

    positions: Array  #: [m], shape (m, 3)
    axes: Array  #: Unit tool axes, from the part to the tool, shape (m, 3)
    ends: Indices  #: The way point each row is, or is on the way to, shape (m,)


def way_between(positions: Array, axes: Array) -> PlacedWay:
    """Add points so that the arm can be followed from each way point to the next.

    Args:
        positions: [m], shape (n, 3).
        axes: Unit tool axes, shape (n, 3), no two in a row opposite.

    Returns:
        The way, the first point included.
    """
    turns = turns_along(axes)
    counts = np.maximum(np.ceil(np.maximum(chord_lengths(positions) / STEP_M, turns / STEP_RAD)), 1.0).astype(
        np.int64
    )
    k, place = in_groups(counts)
    u = (place + 1.0) / counts[k]
    on_way = positions[k] + u[:, None] * (positions[k + 1] - positions[k])
    # Slerp (paper 4, eq. 11); sinc stays good where the turn vanishes.
    share = turns[k] / np.pi
    old, new = (1.0 - u) * np.sinc((1.0 - u) * share), u * np.sinc(u * share)
    turned = (old[:, None] * axes[k] + new[:, None] * axes[k + 1]) / np.sinc(share)[:, None]
    ends = np.concatenate([[0], k + 1])
    return PlacedWay(np.concatenate([positions[:1], on_way]), np.concatenate([axes[:1], turned]), ends)


def follow_path(
    points: WayPoints, rows: Indices, placements: Iterable[Array], otherwise: str, cure: str
) -> tuple[Reach, PlacedWay, Array]:
    """Lay a path before the robot at the first placement that reaches it, and follow all of it with the
    joints.

    Args:
        points: The path.
        rows: Its rows to pass, from `distinct_rows`.
        placements: Poses of the work frame in the base to try, (4, 4) each.
        otherwise: Other advice if none reaches the path.
        cure: Advice if the arm leaves the path on the way.

    Returns:
        The reach, the way with points in between, and joint angles along it [rad], shape (m, 6); or a
        ReachError that names the first place out of reach.
    """
    way = way_between(points.path.positions_work[rows], points.path.axes_work[rows])
    reach = find_reach(way.positions, way.axes, placements, above_table=True, otherwise=otherwise)
    joints = reach.follow(way.positions, way.axes)
    if failure := failure_of(joints, False):
        end = points.place(rows[way.ends[failure.point]])
        raise ReachError(
            f"'{points.file}': on the way to {end}, at {place_in_mm(way.positions[failure.point])} of the "
            f"path: {failure.reason}. {cure}"
        )
    return reach, way, joints.q


def _main_side(axes: Array) -> Array:
    """The side of the work frame most tool axes point to, shape (3,)."""
    mean = axes.mean(axis=0)
    k = np.abs(mean).argmax()
    return np.eye(3)[k] * (1.0 if mean[k] >= 0.0 else -1.0)


class SmoothingTask(NamedTuple):
    """A path to be smoothed, with limits and tolerances."""

    placed: PlacedPath
    limits: SmoothingLimits
    tolerance: float  #: Largest distance of the tip from the path [m]; 0: exact stops at corners
    axis_tolerance: float  #: Largest angle of the tool axis to its path [rad]
    #: Largest speed of the tip on each segment [m/s], inf where it has none, (segments,)
    feeds: Array | None = None


def smooth_path(task: SmoothingTask, rule: str) -> SmoothMotion:
    """Smooth a path by a rule of `RULES`; SmoothingError says where no motion keeps within the limits."""
    placed = task.placed
    return RULES[rule](placed.chain, task.limits, task.tolerance, task.axis_tolerance, placed.arm, task.feeds)


def feeds_on_way(path: ToolPath, rows: Indices) -> Array | None:
    """Feed of the point each segment goes to, infinite in the air [m/s], (segments,); None if the path has
    none."""
    if path.feed is None:
        return None
    in_air = np.isin(path.segment[rows[1:]], (APPROACH, RETRACT))
    return np.where(in_air, np.inf, path.feed[rows[1:]])


def prepare_rule(task: SmoothingTask, rule: str) -> None:
    """Have a rule compiled before its time is taken, on the first segments of the path; its failures come
    later."""
    few = task.placed._replace(chain=part_of(task.placed.chain, slice(0, FEW)))
    feeds = None if task.feeds is None else task.feeds[:FEW].copy()
    try:
        smooth_path(task._replace(placed=few, feeds=feeds), rule)
    except PolishSimError:
        return
