"""Where the part is held and how both arms do their work on it, decided before anything moves.

The master moves the part while the follower runs along its path. The turn of the tool about its axis is free:
in the follower's base it stays as it is, however the part turns, and is chosen to keep away from joint
limits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, box_middle
from polish_sim.dual.arms import ClosedChain
from polish_sim.dual.master import PartWay
from polish_sim.dual.strokes import Visits
from polish_sim.errors import ReachError
from polish_sim.experiments.placement import (
    any_turn_about,
    failure_of,
    rotations_towards,
    spin_direction,
    starts_at,
)
from polish_sim.motion import JOINT_LIMITS, JointPath, track
from polish_sim.spatial import apply_each, from_pose, inverse, transform

UPS = ((0.0, 1.0), (1.0, 1.0), (1.0, 0.0))
"""Directions of the worked side, towards the follower and up, best guess first; see ``_frame``."""
SHARES = (0.5, 0.6, 0.4)  #: Where between the bases the part is held, from the master's
SIDES = (0.1, -0.1, 0.0)  #: How far beside the line between the bases [m]
HEIGHTS = (0.3, 0.2, 0.4, 0.5)  #: Of the gripper's face above the master's base [m]
SPINS = tuple(np.radians(range(0, 360, 45)))
COMFORTABLE = 0.5 * np.pi  #: Distance from its limits from which on a joint counts as free [rad]
GOOD = 0.1  #: A way this far from singularities and limits is taken without looking further [-]
SAME_WAY = 0.1  #: Joints of one way with a chain that calibration has changed differ by less [rad]
#: What touches what with joints of master and follower, (n, 6) each; or empty
Collides = Callable[[Array, Array], str]


class PairWork(NamedTuple):
    """The work of both robots."""

    chain: ClosedChain
    visits: Visits  #: Where the tool moves on the part, and when
    way: PartWay  #: How the master moves the part meanwhile, base of the master

    @property
    def middle(self) -> Array:
        """How far the middle of the part's way is from its start, base of the master [m], shape (3,)."""
        return box_middle(self.way.shift(self.visits.clock))


class PairReach(NamedTuple):
    """A way to do it."""

    T_master_work: Array  #: The part at the start, base of the master, shape (4, 4)
    spin: float  #: Turn of the tool about its axis [rad]
    q_master: Array  #: Joints at the start [rad], shape (6,)
    q_follower: Array  #: Joints at the start [rad], shape (6,)
    #: Least singular value of both arms on the way, less where a joint comes near its limits [-]
    value: float

    def is_like(self, other: PairReach) -> bool:
        """Whether both arms stand in the configurations of another way, with the same spin."""
        apart = np.abs(np.concatenate([self.q_master - other.q_master, self.q_follower - other.q_follower]))
        return self.spin == other.spin and bool(apart.max() < SAME_WAY)


def default_poses(chain: ClosedChain, up: Array, middle_of_way: Array) -> Iterator[Array]:
    """Candidate poses T_master_work of the part at the start of its way, best guess first.

    Args:
        chain: Where the bases stand, and the part in the gripper: its face goes to the candidate places.
        up: Side of the part to be worked on, work frame, shape (3,).
        middle_of_way: How far the middle of its way is from its start, base of the master [m], shape (3,).
    """
    between = chain.T_master_follower[:3, 3]
    ahead = between / np.linalg.norm(between)
    beside = np.array([-ahead[1], ahead[0], 0.0])
    seat_work = inverse(chain.T_gripper_work)[:3, 3]
    for (far, high), height, share, side in product(UPS, HEIGHTS, SHARES, SIDES):
        R = _frame(up, far * ahead + np.array([0.0, 0.0, high]))
        middle = share * between + side * beside + np.array([0.0, 0.0, height])
        yield transform(R, middle - middle_of_way - R @ seat_work)


def held_poses(pose: tuple[float, ...], work: PairWork, up: Array) -> Iterator[Array]:
    """Where the part may be held at the start, base of the master, each (4, 4): at ``part.pose``, else
    candidates."""
    if pose:
        return iter([work.chain.T_master_follower @ from_pose(pose)])
    if file := work.way.file:
        return iter(file.part_poses(work.chain)[:1])
    return default_poses(work.chain, up, work.middle)


def _frame(up: Array, wanted: Array) -> Array:
    """A rotation that turns ``up`` of the part, roughly its z, to a direction [base of the master]."""
    z = wanted / np.linalg.norm(wanted)
    return any_turn_about(z) @ any_turn_about(up).T


def sampled(
    work: PairWork, T_master_work: Array, spin: float, visits: Visits | None = None
) -> tuple[Array, Array]:
    """Poses of the part in the master's base, and of the tool in the follower's, at the moments of the work
    or at other visits, (n, 4, 4) each.

    ``T_master_work``: the part at the start; ``spin``: turn of the tool about its axis [rad].
    """
    at = work.visits if visits is None else visits
    parts = work.way(T_master_work, at.clock)
    T_follower_work = inverse(work.chain.T_master_follower) @ parts
    turned = T_follower_work[:, :3, :3] @ _work_to_tool(work, T_master_work, spin, at.axes, at.meant)
    return parts, transform(turned, apply_each(T_follower_work, at.points))


def tool_on_start(work: PairWork, reach: PairReach, axes: Array, clock: Array) -> Array:
    """R_follower_tool (n, 3, 3) at points of the part, turned back with the part to where it is at the start.

    ``axes``: of the tool there, from the part to the tool, work frame, (n, 3); ``clock``: time of the
    master's motion when it is there [s], (n,).
    """
    R_follower_start = work.chain.T_master_follower[:3, :3].T @ reach.T_master_work[:3, :3]
    return R_follower_start @ _work_to_tool(work, reach.T_master_work, reach.spin, axes, clock)


def _work_to_tool(work: PairWork, T_master_work: Array, spin: float, axes: Array, clock: Array) -> Array:
    """R_work_tool (n, 3, 3) with axes (n, 3) such that the tool keeps its turn in the follower's base at a
    clock."""
    R_follower_master = work.chain.T_master_follower[:3, :3].T
    during = R_follower_master @ work.way(T_master_work, work.visits.clock)[:, :3, :3]
    x_follower = spin_direction(np.einsum("nij,nj->ni", during, work.visits.axes), spin)
    R_follower_work = R_follower_master @ work.way(T_master_work, clock)[:, :3, :3]
    wanted = rotations_towards(np.einsum("nij,nj->ni", R_follower_work, axes), x_follower)
    return np.swapaxes(R_follower_work, 1, 2) @ wanted


class Failed(NamedTuple):
    """Why a pose of the part is not feasible."""

    progress: float  #: How far the search got, to find the pose that got furthest [-]
    reason: str
    share: float = 0.0  #: Of the moments that could be done [-]


def find_pair_reach(
    work: PairWork, poses: Iterable[Array], collides: Collides, like: PairReach | None
) -> PairReach:
    """Find a pose of the part, configurations and a spin of the tool with which both arms do everything.

    Takes the first of the candidate poses T_master_work that keeps well away from singularities and limits,
    else the best; of its ways, one ``like`` another found for nearly the same chain, if there is any. Raises
    ReachError if there is none, with the arm that fails and where for the pose that came furthest, of a file
    the line.
    """
    best: PairReach | None = None
    furthest = Failed(-1.0, "no pose of the part was tried")
    for T_master_work in poses:
        found = _try_pose(work, T_master_work, collides, like)
        if isinstance(found, Failed):
            furthest = max(furthest, found, key=lambda failed: failed.progress)
        elif best is None or found.value > best.value:
            best = found
        if best and best.value > GOOD:
            break
    if best is None:
        raise ReachError(f"the two robots cannot do this: {furthest.reason}{_what_to_change(work, furthest)}")
    return best


def _what_to_change(work: PairWork, failed: Failed) -> str:
    file = work.way.file
    if file is None:
        return (
            ". Hold the part elsewhere with --part-pose (follower's base), place the follower elsewhere "
            "(dual.follower_pose), or move the part less or another way (dual.master_speed_m_s, "
            "dual.master_direction, dual.master_travel_m, dual.master_turn_rad_s, dual.master_path)."
        )
    clock = work.visits.clock
    there = clock[min(round(failed.share * len(clock)), len(clock) - 1)]
    return (
        f", {there:.2f} s into the master's motion ({file.place(there)}). Change the poses in the file, so "
        "that the part is held elsewhere or moves less."
    )


def _try_pose(
    work: PairWork, T_master_work: Array, collides: Collides, like: PairReach | None
) -> PairReach | Failed:
    """The best way with one pose of the part; else how far it came, and why no further."""
    masters, failed = _configurations(
        work.way(T_master_work, work.visits.clock), work.chain.T_flange_work, "master"
    )
    if not masters:
        return failed
    found: list[tuple[PairReach, Array, Array]] = []
    furthest = Failed(-1.0, "")
    for spin in SPINS:
        _, tools = sampled(work, T_master_work, spin)
        followers, failed = _configurations(tools, work.chain.T_flange_tool, "follower")
        furthest = max(furthest, failed, key=lambda one: one.progress)
        for value_f, q_f in followers:
            for value_m, q_m in masters[:2]:
                reach = PairReach(T_master_work, spin, q_m[0], q_f[0], min(value_m, value_f))
                found.append((reach, q_m, q_f))
    touching = ""
    found = [one for one in found if like is not None and one[0].is_like(like)] or found
    for reach, q_m, q_f in sorted(found, key=lambda one: -one[0].value):
        touching = collides(q_m, q_f)
        if not touching:
            return reach
    if found:
        return Failed(
            2.0, f"{touching} would touch, or come closer than dual.clearance_m or dual.pad_clearance_m"
        )
    return furthest._replace(progress=1.0 + furthest.progress)


def _configurations(poses: Array, T_flange_end: Array, arm: str) -> tuple[list[tuple[float, Array]], Failed]:
    """Joints (n, 6) of every configuration that follows all poses with its value, best first; how far others
    came."""
    found: list[tuple[float, Array]] = []
    furthest = 0.0
    reason = f"the {arm} does not reach the first pose"
    for q in starts_at(poses[0] @ inverse(T_flange_end)):
        joints = _tracked(poses, T_flange_end, q)
        failure = failure_of(joints, False)
        if failure is None:
            margin = np.minimum(joints.q - JOINT_LIMITS[:, 0], JOINT_LIMITS[:, 1] - joints.q).min()
            value = joints.smallest_singular_value * min(1.0, margin / COMFORTABLE)
            found.append((value, joints.q))
        elif failure.point / len(poses) >= furthest:
            furthest = failure.point / len(poses)
            reason = f"the {arm} gets {100.0 * furthest:.0f}% of the way, then {failure.reason}"
    return sorted(found, key=lambda way: -way[0]), Failed(furthest, reason, furthest)


def _tracked(poses: Array, T_flange_end: Array, q: Array) -> JointPath:
    """Joints along poses from near a configuration (6,), whole turns off where that suits their limits
    better."""
    joints = track(poses, T_flange_end, q)
    reached = joints.q[~np.isnan(joints.q[:, 0])]
    if not len(reached):
        return joints
    turns = np.round(box_middle(reached) / (2.0 * np.pi))
    return track(poses, T_flange_end, reached[0] - 2.0 * np.pi * turns) if turns.any() else joints
