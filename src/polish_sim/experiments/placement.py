"""Where the part stands and how the arm reaches it, decided and checked before anything moves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from polish_sim.arrays import Array, box_middle, norms
from polish_sim.cell.guards import shaft_points
from polish_sim.cell.scene import tool_on_flange
from polish_sim.errors import PlanError, ReachError, place_in_mm
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.motion import JointPath, inverse_all, link_frames, smallest_singular_values, track
from polish_sim.planning.toolpath import rows_apart
from polish_sim.spatial import apply, rotation_to_axis, rotations_from_vectors, transform

if TYPE_CHECKING:
    from polish_sim.geometry import Surface
    from polish_sim.planning import ToolPath


DISTANCES = (0.5, 0.45, 0.55, 0.4, 0.6, 0.65)  # of the region's middle from the base axis [m]
HEIGHTS = (0.08, 0.16, 0.03)  # of the part's lowest point above the table [m]
SPINS = tuple(math.radians(a) for a in range(0, 360, 45))  # of the tool about its axis [rad]
GOOD_SINGULAR_VALUE = 0.08  # a placement this far from singularities is taken without looking further [-]
_ALL_ROUND = 1e-6  # axes with a mean this short have no main direction [-]
_CLEARLY_BETTER = 1e-6  # the tool's spin alone changes nothing: rounding must not choose among the spins [-]
_SAMPLES = 250
_LARGEST_JUMP = 0.6  # between samples of the path [rad]
LOWEST_JOINT = 0.09  # z of elbow and wrist above the table [m]


class Reach(NamedTuple):
    """A way to do a path."""

    T_base_work: Array  #: Pose of the part's work frame, shape (4, 4)
    x_base: Array  #: Where tool x points but for what lies along the tool axis, shape (3,)
    q_start: Array  #: Joint positions at the first pose [rad], shape (6,)
    smallest_singular_value: float  #: Over the path [-]

    def rotations(self, axes: Array) -> Array:
        """Tool frames R_base_tool (n, 3, 3) for axes from the part to the tool, work frame, (n, 3)."""
        return rotations_towards(axes @ self.T_base_work[:3, :3].T, self.x_base)

    def follow(self, positions: Array, axes: Array) -> JointPath:
        """The joints along tool points [m] with these axes, work frame, both (n, 3)."""
        poses = transform(self.rotations(axes), apply(self.T_base_work, positions))
        return track(poses, tool_on_flange(), self.q_start)


class ReachFailure(NamedTuple):
    """The furthest a tried way got."""

    point: int  #: The first pose it does not do
    reason: str


def tool_rotations(axes_base: Array, spin: float) -> Array:
    """Tool frames R_base_tool (n, 3, 3) with z against unit axes (n, 3) from the part to the tool.

    ``spin`` turns tool x about the tool axis, from the base's x direction [rad]. It follows no turn of the
    path: a spin along the feed would wind the last joint up, turn after turn.
    """
    return rotations_towards(axes_base, spin_direction(axes_base, spin))


def spin_direction(axes_base: Array, spin: float) -> Array:
    """Where tool x points for a spin, but for what lies along the tool axis: base frame, shape (3,)."""
    main = -axes_base.mean(axis=0)
    size = np.linalg.norm(main)
    if size < _ALL_ROUND:
        raise ReachError(
            "the tool axes of this path point all around: no fixed tool spin fits. Choose a region that one "
            "side of the part shows, or --region all, which makes setups."
        )
    main /= size
    start = rotation_to_axis(main[None], np.eye(3)[0 if abs(main[0]) < 0.8 else 1])[0]
    return start @ np.array([math.cos(spin), math.sin(spin), 0.0])


def rotations_towards(axes_base: Array, direction: Array) -> Array:
    """Tool frames with z against axes (n, 3) and x as near a direction (3,) as that allows, shape (n, 3,
    3)."""
    z_axes = -axes_base
    if norms(np.cross(z_axes, direction)).min() < 0.05:
        raise ReachError(
            "the tool axes of this path turn through more than a right angle: no fixed tool spin fits. "
            "Choose a region that one side of the part shows, or --region all, which makes setups."
        )
    return rotation_to_axis(z_axes, direction)


def any_turn_about(z: Array) -> Array:
    """A rotation with this z axis, a unit vector (3,), whatever its turn about it, shape (3, 3)."""
    return rotation_to_axis(z[None], np.eye(3)[np.abs(z).argmin()])[0]


def find_reach(
    positions: Array,
    axes: Array,
    placements: Iterable[Array],
    above_table: bool,
    otherwise: str = "or polish a smaller --region",
    spins: Sequence[float] = SPINS,
    hindrance: Callable[[Array, JointPath], ReachFailure | None] | None = None,
) -> Reach:
    """Find a placement, tool spin and arm configuration that do a whole path.

    Args:
        positions: Tool points in the work frame [m], shape (n, 3), everything the tool will visit.
        axes: Tool axes from the part to the tool, work frame, shape (n, 3).
        placements: Candidate poses of the work frame in base, each (4, 4), best first.
        above_table: Whether elbow and wrist must stay above the table.
        otherwise: What a user can do besides moving the part.
        spins: Of the tool, to be tried [rad].
        hindrance: Says for a pose of the part (4, 4) and a motion within the joints' ranges what forbids it,
            if any.

    Returns:
        The first way that keeps well away from singularities, else the best there is.

    Raises:
        ReachError: If no way does the whole path; names the first bad point of the one that came furthest.
    """
    best: Reach | None = None
    bar, T_flange_tool = -math.inf, tool_on_flange()
    furthest = ReachFailure(-1, "")
    unturnable = None
    samples = np.unique(np.linspace(0, len(positions) - 1, _SAMPLES).astype(int))
    for T_base_work in placements:
        for spin in spins:
            try:
                rotations = tool_rotations(axes[samples] @ T_base_work[:3, :3].T, spin)
            except ReachError as error:
                unturnable = error
                continue
            poses = transform(rotations, apply(T_base_work, positions[samples]))
            for q in starts_at(poses[0] @ np.linalg.inv(T_flange_tool)):
                joints = track(poses, T_flange_tool, q)
                failure = failure_of(joints, above_table)
                if failure is None:
                    # Most ways are no better than the best at a few points already.
                    some = smallest_singular_values(joints.q[::8], joints.point_flange)
                    if some.min() <= bar or joints.smallest_singular_value <= bar:
                        continue
                    if hindrance:
                        failure = hindrance(T_base_work, joints)
                if failure is None:
                    best = Reach(
                        T_base_work,
                        spin_direction(axes @ T_base_work[:3, :3].T, spin),
                        np.array(joints.q[0]),
                        joints.smallest_singular_value,
                    )
                    bar = best.smallest_singular_value + _CLEARLY_BETTER
                elif failure.point > furthest.point:
                    furthest = failure
        if best and best.smallest_singular_value > GOOD_SINGULAR_VALUE:
            break
    if best:
        return best
    if furthest.point < 0 and unturnable:
        raise unturnable
    raise ReachError(
        f"the robot cannot do this path: at {place_in_mm(positions[samples[max(furthest.point, 0)]])} of "
        f"the part {furthest.reason or 'the pose is out of reach'}. Move the part with --part-pose "
        f"X,Y,Z,RX,RY,RZ (mm, deg) {otherwise}."
    )


def check_whole_path(reach: Reach, positions: Array, axes: Array) -> JointPath:
    """Follow every point of the path with the joints.

    Raises:
        ReachError: If a point between the samples of ``find_reach`` is out of reach or beyond a joint's
            range.
    """
    joints = reach.follow(positions, axes)
    if failure := failure_of(joints, False):
        raise ReachError(
            f"point {failure.point} of the path, {place_in_mm(positions[failure.point])} of the part: "
            f"{failure.reason}. Move the part with --part-pose."
        )
    return joints


def default_placements(positions: Array, up: Array, lowest: float) -> Iterator[Array]:
    """Candidate poses T_base_work (4, 4) of a part in front of the robot: its side ``up`` turned up, on a
    fixture.

    The middle of the path (n, 3) [m], work frame, is put in front of the robot; ``lowest`` [m] is the extent
    of the part along ``up`` at its lowest.
    """
    R = upright(up)
    middle = R @ box_middle(positions)
    for height in HEIGHTS:
        for distance in DISTANCES:
            yield transform(R, np.array([-middle[0], -distance - middle[1], height - lowest]))


def upright(up: Array) -> Array:
    """Least rotation that turns ``up`` to base z."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    size = np.linalg.norm(axis)
    if size < 1e-9:
        return np.eye(3) if up[2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    return rotations_from_vectors(axis / size * math.atan2(size, up[2]))


def starts_at(T_base_flange: Array) -> Array:
    """All configurations of a pose, turned near the middle of the joints' ranges, shape (k, 6)."""
    found = inverse_all(np.ascontiguousarray(T_base_flange), 0.0)
    found = found[~np.isnan(found).any(axis=1)]
    return (found + np.pi) % (2.0 * np.pi) - np.pi


def failure_of(joints: JointPath, above_table: bool) -> ReachFailure | None:
    """Why the arm does not do a sequence of poses; None if it does."""
    if joints.first_unreachable is not None:
        return ReachFailure(joints.first_unreachable, "the pose is out of reach")
    if joints.first_beyond_limit is not None:
        return ReachFailure(
            joints.first_beyond_limit, f"joint {(joints.limit_joint or 0) + 1} is beyond its range"
        )
    if joints.largest_step > _LARGEST_JUMP:
        return ReachFailure(joints.largest_step_index, "the arm would have to jump between configurations")
    if above_table:
        frames = link_frames(joints.q[:: max(1, len(joints.q) // 10)])
        if frames[:, 1:6, 2, 3].min() < LOWEST_JOINT:
            return ReachFailure(0, "elbow or wrist would touch the table")
    return None


# Whether the pad's shaft has room on a path, before anything moves.

EVERY = 0.002  #: Along the path, between places that are looked at [m]


def check_shaft(path: ToolPath, surface: Surface, clearance: float) -> None:
    """Refuse a path on which the shaft comes closer than a clearance [m] to the part the pad works on.

    Raises:
        PlanError: Says where.
    """
    rows = rows_apart(path.s, EVERY)
    points = path.positions_work[rows]
    tools = -path.axes_work[rows]
    R_work_tool = np.stack([any_turn_about(z) for z in tools])  # the shaft is round
    shaft = np.einsum("nij,kj->nki", R_work_tool, shaft_points()) + points[:, None]
    gaps = signed_distances(surface, shaft.reshape(-1, 3)).reshape(len(rows), -1).min(axis=1)
    if gaps.min() < clearance:
        worst = gaps.argmin()
        raise PlanError(
            f"the pad's shaft comes within {1e3 * gaps[worst]:.1f} mm of the part where the pad is at "
            f"{place_in_mm(points[worst])} of it, less than {1e3 * clearance:g} mm (dual.pad_clearance_m). "
            "Tilt the tool away from what stands there, or leave that place out of the path."
        )
