"""Where the part is held and how both arms do their work on it, decided and checked before anything moves.

The master moves the part while the follower runs along its path. The turn of the tool about its axis is free: in the
follower's base it stays as it is, however the part turns, and is chosen to keep away from joint limits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.dual.coordination import COMFORTABLE, Chain2, PartWay, limit_margin
from polish_sim.dual.master import MasterPath
from polish_sim.dual.scene import GRIPPER_RADIUS
from polish_sim.dual.strokes import Visits
from polish_sim.errors import ReachError, place_in_mm
from polish_sim.experiments.placement import failure_of, rotations_towards, spin_direction, upright
from polish_sim.geometry import Surface
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.motion import JointPath, inverse_all, track
from polish_sim.spatial import apply, from_pose, inverse, rotation_to_axis, transform

Array = NDArray[np.float64]

UPS: Final = ((0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 0.0, 0.0))
"""How the side to be worked on may look, out of three that suit the follower: up, at it, between; see ``_frame``."""
SHARES: Final = (0.5, 0.6, 0.4)
"""Where between the bases the part is held, from the master's."""
SIDES: Final = (0.1, -0.1, 0.0)
"""How far beside the line between the bases [m]."""
HEIGHTS: Final = (0.3, 0.2, 0.4, 0.5)
"""Of the gripper's face above the master's base [m]."""
SPINS: Final = tuple(np.radians(range(0, 360, 45)))
GOOD: Final = 0.1
"""A way this far from singularities and limits is taken without looking further [-]."""
Collides = Callable[[Array, Array], str]
"""What touches what with joints of master and follower (n, 6) each; empty if nothing does."""


class Work(NamedTuple):
    """What is to be done."""

    chain: Chain2
    visits: Visits
    """Where the tool goes on the part, and when."""
    way: PartWay
    """How the master moves the part meanwhile, base of the master."""

    @property
    def middle(self) -> Array:
        """How far the middle of the part's way is from its start, base of the master [m], shape (3,)."""
        shifts = self.way.shift(self.visits.clock)
        return np.asarray(0.5 * (shifts.min(axis=0) + shifts.max(axis=0)))


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


def default_poses(chain: Chain2, up: Array, middle_of_way: Array) -> Iterator[Array]:
    """Candidate poses of the part at the start of its way, best guess first.

    Args:
        chain: Where the bases stand, and the part in the gripper: its face goes to the candidate places.
        up: Side of the part to be worked on, work frame, shape (3,).
        middle_of_way: How far the middle of its way is from its start, base of the master [m], shape (3,).

    Yields:
        T_master_work, shape (4, 4).
    """
    between = chain.T_master_follower[:3, 3]
    ahead = between / np.linalg.norm(between)
    beside = np.array([-ahead[1], ahead[0], 0.0])
    seat_work = inverse(chain.T_gripper_work)[:3, 3]
    for wish in UPS:
        R = _frame(up, wish[0] * ahead + np.array([0.0, 0.0, wish[2]]))
        for height in HEIGHTS:
            for share in SHARES:
                for side in SIDES:
                    middle = share * between + side * beside + np.array([0.0, 0.0, height])
                    yield transform(R, middle - middle_of_way - R @ seat_work)


def find_pair_reach(
    work: Work, poses: Iterable[Array], collides: Collides, file: MasterPath | None = None
) -> PairReach:
    """Find a pose of the part, configurations and a spin of the tool with which both arms do everything.

    Args:
        work: What is to be done.
        poses: Candidates for the part's pose at the start, base of the master, each (4, 4).
        collides: Looks for arms that touch.
        file: Where the master's motion comes from, if from a file.

    Returns:
        The first way that keeps well away from singularities and limits, else the best there is.

    Raises:
        ReachError: There is none; says which arm fails and where for the pose that came furthest, of a file the line.
    """
    best: PairReach | None = None
    furthest = Failed(-1.0, "no pose of the part was tried")
    for T_master_work in poses:
        found = _try_pose(work, T_master_work, collides)
        if isinstance(found, Failed):
            furthest = max(furthest, found, key=lambda failed: failed.came)
        elif best is None or found.value > best.value:
            best = found
        if best is not None and best.value > GOOD:
            break
    if best is None:
        raise ReachError(f"the two robots cannot do this: {furthest.reason}{_cure(work, furthest, file)}")
    return best


class Failed(NamedTuple):
    """Why a pose of the part does not do."""

    came: float
    """How far, to tell which came furthest [-]."""
    reason: str
    share: float = 0.0
    """Of the moments that could be done [-]."""


def _cure(work: Work, failed: Failed, file: MasterPath | None) -> str:
    """What to change, after the reason."""
    if file is None:
        return (
            ". Hold the part elsewhere with --part-pose (follower's base), or move it less or another way "
            "(dual.master_speed_m_s, dual.master_direction, dual.master_turn_rad_s, dual.master_path)."
        )
    clock = work.visits.clock
    there = float(clock[min(round(failed.share * len(clock)), len(clock) - 1)])
    return (
        f", {there:.2f} s into the master's motion ({file.place(there)}). Change the poses in the file, so that the "
        "part is held elsewhere or moves less."
    )


class Sampled(NamedTuple):
    """Both robots' work at n moments."""

    parts: Array
    """Poses of the part in the master's base, shape (n, 4, 4)."""
    tools: Array
    """Poses of the tool in the follower's base, shape (n, 4, 4)."""


def sampled(work: Work, T_master_work: Array, spin: float, visits: Visits | None = None) -> Sampled:
    """Where part and tool are at the moments of the work, or at other ones.

    Args:
        work: What is to be done.
        T_master_work: The part at the start, base of the master, shape (4, 4).
        spin: Turn of the tool about its axis [rad].
        visits: The moments; those of the work if not given.
    """
    at = work.visits if visits is None else visits
    parts = work.way(T_master_work, at.clock)
    T_follower_work = inverse(work.chain.T_master_follower) @ parts
    points = np.einsum("nij,nj->ni", T_follower_work[:, :3, :3], at.points) + T_follower_work[:, :3, 3]
    turned = T_follower_work[:, :3, :3] @ _work_to_tool(work, T_master_work, spin, at.axes, at.meant)
    return Sampled(parts, transform(turned, points))


def tool_on_start(work: Work, reach: PairReach, axes: Array, clock: Array) -> Array:
    """How the tool stands at points of the part, turned back with the part to where it is at the start.

    Args:
        work: What is to be done.
        reach: How.
        axes: Tool axes from the part to the tool there, work frame, shape (n, 3).
        clock: Time of the master's motion when it is there [s], shape (n,).

    Returns:
        R_follower_tool, shape (n, 3, 3).
    """
    R_follower_start = work.chain.T_master_follower[:3, :3].T @ reach.T_master_work[:3, :3]
    return np.asarray(R_follower_start @ _work_to_tool(work, reach.T_master_work, reach.spin, axes, clock))


def _work_to_tool(work: Work, T_master_work: Array, spin: float, axes: Array, clock: Array) -> Array:
    """R_work_tool (n, 3, 3) with axes (n, 3) such that the tool keeps its turn in the follower's base at a clock."""
    R_follower_work = work.chain.T_master_follower[:3, :3].T @ work.way(T_master_work, clock)[:, :3, :3]
    axes_follower = np.einsum("nij,nj->ni", R_follower_work, axes)
    wanted = rotations_towards(axes_follower, _direction(work, T_master_work, spin))
    return np.asarray(np.swapaxes(R_follower_work, 1, 2) @ wanted)


def _direction(work: Work, T_master_work: Array, spin: float) -> Array:
    """Where tool x points for a spin during all of the work, follower's base, shape (3,)."""
    parts = work.way(T_master_work, work.visits.clock)[:, :3, :3]
    axes = np.einsum("nij,nj->ni", work.chain.T_master_follower[:3, :3].T @ parts, work.visits.axes)
    return spin_direction(axes, spin)


def _try_pose(work: Work, T_master_work: Array, collides: Collides) -> PairReach | Failed:
    """The best way with one pose of the part; else how far it came, and why no further."""
    T_flange_work = work.chain.T_flange_gripper @ work.chain.T_gripper_work
    parts = work.way(T_master_work, work.visits.clock)
    masters, failed = _configurations(parts, T_flange_work, "master")
    if not masters:
        return failed
    found: list[PairReach] = []
    joints: dict[int, tuple[Array, Array]] = {}
    furthest = Failed(-1.0, "")
    for spin in SPINS:
        tools = sampled(work, T_master_work, float(spin)).tools
        followers, failed = _configurations(tools, work.chain.T_flange_tool, "follower")
        furthest = max(furthest, failed, key=lambda one: one.came)
        for value_f, q_f in followers:
            for value_m, q_m in masters[:2]:
                joints[len(found)] = (q_m, q_f)
                found.append(PairReach(T_master_work, float(spin), q_m[0], q_f[0], min(value_m, value_f)))
    touching = ""
    for index in sorted(range(len(found)), key=lambda k: -found[k].value):
        touching = collides(*joints[index])
        if not touching:
            return found[index]
    if found:
        return Failed(2.0, f"{touching} would touch, or come closer than dual.clearance_m or dual.pad_clearance_m")
    return furthest._replace(came=1.0 + furthest.came)


def _configurations(poses: Array, T_flange_end: Array, arm: str) -> tuple[list[tuple[float, Array]], Failed]:
    """Joints (n, 6) of every configuration that follows all poses with its value, best first; how far others came."""
    found: list[tuple[float, Array]] = []
    furthest, reason = 0.0, f"the {arm} does not reach the first pose"
    solutions = inverse_all(np.ascontiguousarray(poses[0] @ inverse(T_flange_end)))
    for q in solutions[~np.isnan(solutions).any(axis=1)]:
        joints = _tracked(poses, T_flange_end, q)
        failure = failure_of(joints, False)
        if failure is None:
            value = joints.smallest_singular_value * min(1.0, limit_margin(joints.q) / COMFORTABLE)
            found.append((value, joints.q))
        elif failure.point / len(poses) >= furthest:
            furthest = failure.point / len(poses)
            reason = f"the {arm} gets {100.0 * furthest:.0f}% of the way, then {failure.reason}"
    return sorted(found, key=lambda way: -way[0]), Failed(furthest, reason, furthest)


def _tracked(poses: Array, T_flange_end: Array, q: Array) -> JointPath:
    """Joints along poses from near a configuration (6,), whole turns off where that suits their limits better."""
    joints = track(poses, T_flange_end, (q + np.pi) % (2.0 * np.pi) - np.pi)
    reached = joints.q[~np.isnan(joints.q[:, 0])]
    if not len(reached):
        return joints
    turns = np.round(0.5 * (reached.min(axis=0) + reached.max(axis=0)) / (2.0 * np.pi))
    return track(poses, T_flange_end, reached[0] - 2.0 * np.pi * turns) if turns.any() else joints


def _frame(up: Array, wanted: Array) -> Array:
    """A rotation that turns ``up`` of the part, roughly its z, to a direction [base of the master]."""
    z = wanted / np.linalg.norm(wanted)
    R_z = rotation_to_axis(z[None], np.eye(3)[int(np.abs(z).argmin())])[0]
    R_up = rotation_to_axis(up[None], np.eye(3)[int(np.abs(up).argmin())])[0]
    return np.asarray(R_z @ R_up.T)


__all__ = [
    "Collides",
    "PairReach",
    "Sampled",
    "Work",
    "default_poses",
    "find_pair_reach",
    "sampled",
    "tool_on_start",
]


# How the master's gripper holds a part: by its lowest point, seen along ``up``, or as a user says.

TOUCHING: Final = 1e-4
"""A part this close to the gripper is held by it [m]."""
_SPACING: Final = 0.002  # between the points of the gripper's face that are looked at [m]
_STEPS: Final = 2000


class Seat(NamedTuple):
    """A part in a gripper."""

    T_gripper_work: Array
    """The part's own frame on the gripper's face, whose z axis looks away from the flange, shape (4, 4)."""
    nose: float
    """How far the gripper goes on beyond its face, into an opening, until it meets the part [m]."""


def seat_part(surface: Surface, up: Array, pose: tuple[float, ...] = ()) -> Seat:
    """Hold a part with the side ``up`` away from the gripper, the middle of its box on the gripper's axis.

    Args:
        surface: The part.
        up: Side to be worked on, work frame, shape (3,).
        pose: Where the part's own frame is on the gripper instead [m], [rad], shape (6,); empty for none.

    Returns:
        Where the part sits.

    Raises:
        ReachError: Nothing of the part is before the gripper's face.
    """
    corners = surface.control.reshape(-1, 3)
    T_gripper_work = from_pose(pose) if pose else _on_lowest_point(corners, up)
    depth = float(apply(T_gripper_work, corners)[:, 2].max())
    nose = _way_to_part(surface, inverse(T_gripper_work), depth)
    if nose is None:
        raise ReachError(
            f"the gripper's face, {2e3 * GRIPPER_RADIUS:g} mm wide, would hold nothing: no part is before it when it "
            f"comes to {place_in_mm(inverse(T_gripper_work)[:3, 3])} of the part. Say where the part's own frame is on "
            "the gripper's face with --set dual.part_on_gripper=[x,y,z,rx,ry,rz] (m, rad)."
        )
    return Seat(T_gripper_work, nose)


def seat_text(T_gripper_work: Array) -> str:
    """Where the gripper takes a part, for the user."""
    T_work_gripper = inverse(T_gripper_work)
    axis = ", ".join(f"{number + 0.0:.3g}" for number in np.round(T_work_gripper[:3, 2], 4))
    return f"held by the gripper at {place_in_mm(T_work_gripper[:3, 3])} of its own frame, gripper's axis ({axis})"


def seat_notes(figures: Mapping[str, Any]) -> tuple[str, ...]:
    """How the part was held in a run, by its figures."""
    return (f"part: {seat_text(np.array(figures['T_gripper_work']))}",)


def _on_lowest_point(corners: Array, up: Array) -> Array:
    R = upright(up)
    turned = corners @ R.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    # To a tenth of a millimetre: facets make the box of what is round a little lopsided.
    middle = np.round(0.5 * (low + high), 4)
    return transform(R, -np.array([middle[0], middle[1], low[2]]))


def _way_to_part(surface: Surface, T_work_gripper: Array, depth: float) -> float | None:
    """How far the gripper's face goes along its axis until it meets the part [m]; None if there is nothing.

    It goes by the distance to what is nearest, which it can never overshoot.
    """
    face, way = _face(), 0.0
    for _ in range(_STEPS):
        gap = float(signed_distances(surface, apply(T_work_gripper, face)).min())
        if gap < TOUCHING:
            return way
        way += gap
        face[:, 2] += gap
        if way > depth:
            break
    return None


def _face() -> Array:
    """Points spread over the gripper's face, gripper's frame [m], shape (n, 3)."""
    line = np.arange(-GRIPPER_RADIUS, GRIPPER_RADIUS + 0.5 * _SPACING, _SPACING)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    inside = np.hypot(x, y) <= GRIPPER_RADIUS + 1e-12
    return np.stack([x[inside], y[inside], np.zeros(int(inside.sum()))], axis=1)
