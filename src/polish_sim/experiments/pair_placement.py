"""Where the part is held and how both arms do their work on it, decided and checked before anything moves (layer 9).

The master moves the part along a straight way with its orientation kept while the follower runs once along its path.
The turn of the tool about its axis is free; it is chosen to keep away from joint limits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import ReachError
from polish_sim.experiments.placement import failure_of, tool_rotations
from polish_sim.motion import inverse_all, track
from polish_sim.motion.coordination import Chain2
from polish_sim.motion.coordination.joints import COMFORTABLE, limit_margin
from polish_sim.planning.toolpath import ToolPath
from polish_sim.spatial import from_pose, inverse, rotation_to_axis, transform

Array = NDArray[np.float64]

UPS: Final = ((0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 0.0, 0.0))
"""How the side to be worked on may look, out of three that suit the follower: up, at it, between; see ``_frame``."""
SHARES: Final = (0.5, 0.6, 0.4)
"""Where between the bases the part is held, from the master's."""
SIDES: Final = (0.1, -0.1, 0.0)
"""How far beside the line between the bases [m]."""
HEIGHTS: Final = (0.3, 0.2, 0.4, 0.5)
"""Of the part's origin above the master's base [m]."""
SPINS: Final = tuple(np.radians(range(0, 360, 45)))
GOOD: Final = 0.1
"""A way this far from singularities and limits is taken without looking further [-]."""
SAMPLES: Final = 60
BASE_DISTANCES: Final = (1.1, 1.0, 1.2, 0.9, 1.3)
"""Between the bases, when another place for the follower's is looked for [m]."""
BASE_POSES: Final = 18
"""Poses of the part that are tried with each of them."""

Collides = Callable[[Array, Array], str]
"""What touches what with joints of master and follower (n, 6) each; empty if nothing does."""


class Work(NamedTuple):
    """What is to be done."""

    chain: Chain2
    path: ToolPath
    """Where the tool goes on the part."""
    way: Array
    """How the master moves the part meanwhile, from first to last point, base of the master [m], shape (3,)."""


class PairReach(NamedTuple):
    """A way to do it."""

    T_master_work: Array
    """The part at the start, base of the master, shape (4, 4)."""
    spin: float
    """Turn of the tool about its axis [rad]."""
    q_master: Array
    """Joints at the start [rad], shape (6,)."""
    q_follower: Array
    """Joints at the start [rad], shape (6,)."""
    value: float
    """Least singular value of both arms on the way, less where a joint comes near its limits [-]."""


def default_poses(chain: Chain2, up: Array, way: Array) -> Iterator[Array]:
    """Candidate poses of the part at the start of its way, best guess first.

    Args:
        chain: Where the bases stand.
        up: Side of the part to be worked on, work frame, shape (3,).
        way: How the part moves, base of the master [m], shape (3,).

    Yields:
        T_master_work, shape (4, 4).
    """
    between = chain.T_master_follower[:3, 3]
    ahead = between / np.linalg.norm(between)
    beside = np.array([-ahead[1], ahead[0], 0.0])
    for wish in UPS:
        R = _frame(up, wish[0] * ahead + np.array([0.0, 0.0, wish[2]]))
        for height in HEIGHTS:
            for share in SHARES:
                for side in SIDES:
                    middle = share * between + side * beside + np.array([0.0, 0.0, height])
                    yield transform(R, middle - 0.5 * way)


def find_pair_reach(work: Work, poses: Iterable[Array], collides: Collides) -> PairReach:
    """Find a pose of the part, configurations and a spin of the tool with which both arms do everything.

    Args:
        work: What is to be done.
        poses: Candidates for the part's pose at the start, base of the master, each (4, 4).
        collides: Looks for arms that touch.

    Returns:
        The first way that keeps well away from singularities and limits, else the best there is.

    Raises:
        ReachError: There is none; says which arm fails and where for the pose that came furthest.
    """
    best: PairReach | None = None
    furthest = (-1.0, "no pose of the part was tried")
    for T_master_work in poses:
        found, reached, reason = _try_pose(work, T_master_work, collides)
        if found is not None and (best is None or found.value > best.value):
            best = found
        if found is None and reached > furthest[0]:
            furthest = (reached, reason)
        if best is not None and best.value > GOOD:
            break
    if best is None:
        raise ReachError(
            f"the two robots cannot do this: {furthest[1]}. Hold the part elsewhere with --part-pose (follower's "
            "base), or move it less or another way (dual.master_speed_m_s, dual.master_direction)."
        )
    return best


def suggest_base(work: Work, up: Array, scene_check: Callable[[Array], Collides]) -> Array | None:
    """Another place for the follower's base at which the work can be done.

    Args:
        work: What is to be done; its chain says what the follower's base is now.
        up: Side of the part to be worked on, work frame, shape (3,).
        scene_check: Makes the check for arms that touch, for a base of the follower in the master's (4, 4).

    Returns:
        T_master_follower, shape (4, 4), the bases facing each other; None if none of the tried ones will do.
    """
    for distance in BASE_DISTANCES:
        T = from_pose([-distance, 0.0, 0.0, 0.0, 0.0, np.pi])
        moved = work._replace(chain=work.chain._replace(T_master_follower=T))
        try:
            find_pair_reach(moved, islice(default_poses(moved.chain, up, work.way), BASE_POSES), scene_check(T))
        except ReachError:
            continue
        return T
    return None


def sampled(work: Work, T_master_work: Array, spin: float, count: int = SAMPLES) -> tuple[Array, Array]:
    """Poses of the part in the master's base and of the tool in the follower's while the path is done, (n, 4, 4)."""
    rows = np.unique(np.linspace(0, len(work.path.s) - 1, count).astype(int))
    first, last = np.flatnonzero(work.path.process)[[0, -1]]
    rows = np.unique(np.concatenate([rows, [first, last]]))
    s = work.path.s
    share = np.clip((s[rows] - s[first]) / (s[last] - s[first]), 0.0, 1.0)
    parts = np.tile(T_master_work, (len(rows), 1, 1))
    parts[:, :3, 3] += share[:, None] * work.way
    T_follower_work = inverse(work.chain.T_master_follower) @ parts
    axes = np.einsum("nij,nj->ni", T_follower_work[:, :3, :3], work.path.axes_work[rows])
    points = np.einsum("nij,nj->ni", T_follower_work[:, :3, :3], work.path.positions_work[rows])
    return parts, transform(tool_rotations(axes, spin), points + T_follower_work[:, :3, 3])


def _try_pose(work: Work, T_master_work: Array, collides: Collides) -> tuple[PairReach | None, float, str]:
    """The best way with one pose of the part; else how far it came, and why no further."""
    T_flange_work = work.chain.T_flange_gripper @ work.chain.T_gripper_work
    parts, _ = sampled(work, T_master_work, 0.0)
    masters, came_m, why_m = _configurations(parts, T_flange_work, "master")
    if not masters:
        return None, came_m, why_m
    found: list[PairReach] = []
    joints: dict[int, tuple[Array, Array]] = {}
    came_f, why_f = -1.0, ""
    for spin in SPINS:
        _, tools = sampled(work, T_master_work, float(spin))
        followers, came, why = _configurations(tools, work.chain.T_flange_tool, "follower")
        if came > came_f:
            came_f, why_f = came, why
        for value_f, q_f in followers:
            for value_m, q_m in masters[:2]:
                joints[len(found)] = (q_m, q_f)
                found.append(PairReach(T_master_work, float(spin), q_m[0], q_f[0], min(value_m, value_f)))
    touching = ""
    for index in sorted(range(len(found)), key=lambda k: -found[k].value):
        touching = collides(*joints[index])
        if not touching:
            return found[index], 3.0, ""
    return None, *((2.0, f"{touching} would touch") if found else (1.0 + came_f, why_f))


def _configurations(poses: Array, T_flange_end: Array, arm: str) -> tuple[list[tuple[float, Array]], float, str]:
    """Joints (n, 6) of every configuration that follows all poses with its value, best first; how far others came."""
    found: list[tuple[float, Array]] = []
    furthest, reason = 0.0, f"the {arm} does not reach the first pose"
    solutions = inverse_all(np.ascontiguousarray(poses[0] @ inverse(T_flange_end)))
    for q in solutions[~np.isnan(solutions).any(axis=1)]:
        joints = track(poses, T_flange_end, (q + np.pi) % (2.0 * np.pi) - np.pi)
        failure = failure_of(joints, False)
        if failure is None:
            value = joints.smallest_singular_value * min(1.0, limit_margin(joints.q) / COMFORTABLE)
            found.append((value, joints.q))
        elif failure.point / len(poses) >= furthest:
            furthest = failure.point / len(poses)
            reason = f"the {arm} gets {100.0 * furthest:.0f}% of the way, then {failure.reason}"
    return sorted(found, key=lambda way: -way[0]), furthest, reason


def _frame(up: Array, wanted: Array) -> Array:
    """A rotation that turns ``up`` of the part, roughly its z, to a direction [base of the master]."""
    z = wanted / np.linalg.norm(wanted)
    R_z = rotation_to_axis(z[None], np.eye(3)[int(np.abs(z).argmin())])[0]
    R_up = rotation_to_axis(up[None], np.eye(3)[int(np.abs(up).argmin())])[0]
    return np.asarray(R_z @ R_up.T)


__all__ = ["Collides", "PairReach", "Work", "default_poses", "find_pair_reach", "sampled", "suggest_base"]
