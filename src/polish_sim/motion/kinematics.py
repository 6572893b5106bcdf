"""Kinematics of the arm: from joint angles to poses and velocities of the tool, and back.

The arm is its table of standard Denavit-Hartenberg parameters, T_i = Rz(q_i + offset_i) Tz(d_i) Tx(a_i)
Rx(alpha_i). The nominal table is that of the maker of the arm in use (``arms.py``); an arm as built has its
own, which every function of forward kinematics takes as an argument. The flange frame is DH frame 6. The
inverse is in closed form for the nominal table, and by Newton's method from there for another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from polish_sim.arms import ARMS, FIRST, ArmTable, arm_table
from polish_sim.arrays import Array, Bools, crosses
from polish_sim.errors import ReachError
from polish_sim.kernel_cache import njit
from polish_sim.kernels import kernel, part
from polish_sim.spatial import inverse, place_of, vectors_from_rotations

NOMINAL = np.stack([np.zeros((6,))] * 3 + [np.pi / 2 * np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0])])
"""Table of the arm in use: joint offsets [rad], d [m], a [m], alpha [rad], shape (4, 6); set by `use_arm`."""
_used = [ARMS[FIRST]]


def use_arm(name: str) -> ArmTable:
    """Make the arm that a word of ``robot.arm`` names the one this process computes with.

    A process works with one make at a time: everything that begins with a scenario calls this first.
    """
    _used[0] = arm = arm_table(name)
    NOMINAL.setflags(write=True)
    NOMINAL[1], NOMINAL[2] = arm.d, arm.a
    NOMINAL.setflags(write=False)
    return arm


def used_arm() -> ArmTable:
    """The make of the arm in use."""
    return _used[0]


use_arm(FIRST)
JOINT_LIMITS = (
    np.array([[-2.0, 2.0], [-2.0, 2.0], [-1.0, 1.0], [-2.0, 2.0], [-2.0, 2.0], [-2.0, 2.0]]) * np.pi
)
"""Lowest and highest joint angle [rad], shape (6, 2)."""


def beyond_range(q: Array) -> Bools:
    """Which joints are outside their range at angles (..., 6) [rad]."""
    return (q < JOINT_LIMITS[:, 0]) | (q > JOINT_LIMITS[:, 1])


CLOSE = 1e-12  #: Newton's method ends when the flange pose is reached to this [m] and [rad]
_MOST_ROUNDS = 10


# Forward: one step of the chain, written once for every kernel.


def joint_rows(table: Array) -> Array:
    """A table as kernels take it: offset [rad], d [m], a [m], cosine and sine of alpha of each joint, shape
    (6, 5)."""
    offset, d, a, alpha = table
    # The cosine of pi/2 in floating point would tilt the nominal axes by 6e-17.
    cosine = np.where(np.abs(np.cos(alpha)) < 1e-16, 0.0, np.cos(alpha))
    return np.ascontiguousarray(np.stack([offset, d, a, cosine, np.sin(alpha)], axis=1))


@kernel
def advance_frame(T: Array, row: Array, angle: float) -> None:
    """Carry frame i - 1, (3, 4) or (4, 4), over one joint at an ``angle`` [rad], in place; ``row`` of
    `joint_rows`."""
    c, s = math.cos(angle + row[0]), math.sin(angle + row[0])
    for i in range(3):
        x, y, z = T[i, 0], T[i, 1], T[i, 2]
        x_turned, y_turned = c * x + s * y, c * y - s * x
        T[i, 0] = x_turned
        T[i, 1] = row[3] * y_turned + row[4] * z
        T[i, 2] = row[3] * z - row[4] * y_turned
        T[i, 3] = T[i, 3] + row[1] * z + row[2] * x_turned


@njit
def fill_frames(rows: Array, q: Array, frames: Array) -> None:
    """Frames of n configurations: all seven, shape (n, 7, 4, 4), or the flange's alone; they begin as the
    identity."""
    last = frames.shape[1] - 1
    for i in range(q.shape[0]):
        for k in range(6):
            if last:
                for row in range(3):
                    # assigned as a slice, numba would compile a page of strings for its error
                    for column in range(4):
                        frames[i, k + 1, row, column] = frames[i, k, row, column]
            advance_frame(frames[i, min(k + 1, last)], rows[k], q[i, k])


def _frames(q: Array, table: Array, count: int) -> Array:
    angles = np.array(q, dtype=float, order="C")
    frames = np.tile(np.eye(4), (angles.size // 6, count, 1, 1))
    fill_frames(joint_rows(table), angles.reshape(-1, 6), frames)
    return frames.reshape(*angles.shape[:-1], count, 4, 4)


def link_frames(q: Array, table: Array = NOMINAL) -> Array:
    """Poses of DH frames 0 (base) to 6 (flange) in the base, (..., 7, 4, 4), at joint angles ``q`` (..., 6)
    [rad]."""
    return _frames(q, table, 7)


def forward(q: Array, table: Array = NOMINAL) -> Array:
    """Pose of the flange T_base_flange, (..., 4, 4), at angles ``q`` (..., 6) [rad] of an arm with a table
    (4, 6)."""
    return _frames(q, table, 1)[..., 0, :, :]


def jacobian(q: Array, point_flange: Array) -> Array:
    """Geometric Jacobian (..., 6, 6), base frame, of a point fixed in the flange, ``point_flange`` (3,) [m].

    It maps joint speeds [rad/s] at angles ``q`` (..., 6) [rad] to the point's velocity [m/s] (rows 0-2) and
    the flange's angular velocity [rad/s] (rows 3-5).
    """
    return _jacobian_of(link_frames(q), point_flange)


def _jacobian_of(frames: Array, point_flange: Array) -> Array:
    points = place_of(frames[..., 6, :, :], point_flange)
    axes = frames[..., :6, :3, 2]
    linear = crosses(axes, points[..., None, :] - frames[..., :6, :3, 3])
    return np.ascontiguousarray(np.concatenate([linear, axes], axis=-1).swapaxes(-1, -2))


def smallest_singular_values(q: Array, point_flange: Array) -> Array:
    """Smallest singular value (n,) of the Jacobian, in its mixed units of metres and radians: 0 at a
    singularity.

    At angles ``q`` (n, 6) [rad] and the tool point ``point_flange`` (3,) [m]. A tool twist of size v can need
    joint speeds of v divided by it.
    """
    return np.asarray(np.linalg.svd(jacobian(q, point_flange), compute_uv=False)[:, 5])


def is_nominal(table: Array) -> bool:
    """Whether a table is the nominal one, number by number."""
    return bool(np.array_equal(table, NOMINAL))


def link_poses(table: Array) -> Array:
    """Pose of each link's frame in the one before with the joints at zero, shape (6, 4, 4)."""
    frames = link_frames(np.zeros(6), table)
    return inverse(frames[:6]) @ frames[1:]


def table_slopes(frames: Array, points: Array) -> Array:
    """Derivative (n, 3, 24) of points (n, 3) [m] that move with the flange with respect to the table's 24
    numbers.

    The table is taken row by row. Offset and d act about and along z of the frame before, a and alpha along
    and about x of the frame behind. ``frames`` are those of `link_frames`, (n, 7, 4, 4), in the points'
    frame.
    """
    z, x = frames[:, :6, :3, 2], frames[:, 1:, :3, 0]
    about_z = crosses(z, points[:, None] - frames[:, :6, :3, 3])
    about_x = crosses(x, points[:, None] - frames[:, 1:, :3, 3])
    return np.concatenate([about_z, z, x, about_x], axis=1).transpose(0, 2, 1)


# Inverse in closed form. The up to eight solutions differ in three signs: the side of the pan axis the wrist
# is on, and the signs of the angles of wrist 2 and elbow. A continuous motion changes a sign only at a
# singularity, so along a path one solution is enough. Angles come from atan2 of two exact terms, not from
# acos: accurate near singularities.

_TURN = 2.0 * math.pi
#: How far a squared sine may be negative by rounding before a pose counts as out of reach [-]
_REACH_SLACK = 1e-9
_WRIST_ALIGNED = 1e-9  #: Sine of wrist 2 below which only the sum of wrist 1 and wrist 3 is given [-]


@part
def _solve_branch(
    lengths: Array, T: Array, side: float, wrist: float, elbow: float, q6_if_aligned: float
) -> tuple[bool, tuple[float, float, float, float, float, float]]:
    """Whether there is a solution with these signs, and its angles up to full turns [rad]."""
    d1, d4, d5, d6, a2, a3 = lengths[0], lengths[1], lengths[2], lengths[3], lengths[4], lengths[5]
    none = (math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)
    # Pan: the wrist's centre seen from above is d4 beside the arm's plane.
    x, y, z = T[0, 3] - d6 * T[0, 2], T[1, 3] - d6 * T[1, 2], T[2, 3] - d6 * T[2, 2]
    square = x * x + y * y
    if square - d4 * d4 < -_REACH_SLACK:
        return False, none
    out = math.copysign(math.sqrt(max(square - d4 * d4, 0.0)), side)
    c1, s1 = (out * x - d4 * y) / square, (out * y + d4 * x) / square
    # Wrist 2 and 3: the normal of the arm's plane seen from the flange is (s5 c6, -s5 s6, c5).
    nx = s1 * T[0, 0] - c1 * T[1, 0]
    ny = s1 * T[0, 1] - c1 * T[1, 1]
    c5 = s1 * T[0, 2] - c1 * T[1, 2]
    s5 = math.copysign(math.sqrt(nx * nx + ny * ny), wrist)
    if abs(s5) < _WRIST_ALIGNED:
        c6, s6 = math.cos(q6_if_aligned), math.sin(q6_if_aligned)
    else:
        c6, s6 = nx / s5, -ny / s5
    # Wrist 2's axis and the x axis of frame 4, seen from the flange, leave a planar arm with two links.
    a, b = c5 * c6, c5 * s6
    ux = a * T[0, 0] - b * T[0, 1] - s5 * T[0, 2]
    uy = a * T[1, 0] - b * T[1, 1] - s5 * T[1, 2]
    uz = a * T[2, 0] - b * T[2, 1] - s5 * T[2, 2]
    q234 = math.atan2(uz, c1 * ux + s1 * uy)
    px = x + d5 * (T[0, 0] * s6 + T[0, 1] * c6)
    py = y + d5 * (T[1, 0] * s6 + T[1, 1] * c6)
    height = z + d5 * (T[2, 0] * s6 + T[2, 1] * c6) - d1
    radius = c1 * px + s1 * py
    c3 = (radius * radius + height * height - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
    if 1.0 - c3 * c3 < -_REACH_SLACK:
        return False, none
    s3 = math.copysign(math.sqrt(max(1.0 - c3 * c3, 0.0)), elbow)
    q2, q3 = math.atan2(height, radius) - math.atan2(a3 * s3, a2 + a3 * c3), math.atan2(s3, c3)
    q6 = q6_if_aligned if abs(s5) < _WRIST_ALIGNED else math.atan2(s6, c6)
    return True, (math.atan2(s1, c1), q2, q3, q234 - q2 - q3, math.atan2(s5, c5), q6)


@kernel
def _near(angle: float, reference: float) -> float:
    """The angle, full turns added, within half a turn of the reference."""
    return angle + _TURN * math.floor((reference - angle) / _TURN + 0.5)


@njit(_nrt=False)
def solve_on_branch(lengths: Array, T: Array, q_near: Array, q: Array) -> bool:
    """Write joint angles ``q`` (6,) [rad] that bring the flange to ``T`` (4, 4), closed form; False if there
    are none.

    ``q_near`` (6,) [rad], which may be ``q`` itself, says which branch and which full turns; ``lengths`` is
    the arm's, of `arm_lengths`.
    """
    side = lengths[4] * math.cos(q_near[1]) + lengths[5] * math.cos(q_near[1] + q_near[2])
    side += lengths[2] * math.sin(q_near[1] + q_near[2] + q_near[3])
    reached, angles = _solve_branch(lengths, T, side, math.sin(q_near[4]), math.sin(q_near[2]), q_near[5])
    if reached:
        for j in range(6):
            q[j] = _near(angles[j], q_near[j])
    return reached


@njit
def solve_all(lengths: Array, T_base_flange: Array, q6_if_aligned: float) -> Array:
    """All joint angles (8, 6) of a flange pose (4, 4); see `inverse_all`."""
    solutions = np.empty((8, 6))
    for row in range(8):
        solve_row(lengths, T_base_flange, row, q6_if_aligned, solutions[row])
    return solutions


@part
def solve_row(lengths: Array, T_base_flange: Array, row: int, q6_if_aligned: float, q: Array) -> None:
    """Write one row (6,) of the solutions of `solve_all`."""
    side, wrist, elbow = 2.0 * (row // 4) - 1.0, 1.0 - row // 2 % 2 * 2.0, 1.0 - row % 2 * 2.0
    angles = _solve_branch(lengths, T_base_flange, side, wrist, elbow, q6_if_aligned)[1]
    for j in range(6):
        q[j] = _near(angles[j], 0.0)


@njit
def _nearest_solution(lengths: Array, T_base_flange: Array, q_near: Array, within_limits: bool) -> Array:
    best = np.full(6, np.nan)
    best_distance = np.inf
    solutions = solve_all(lengths, T_base_flange, q_near[5])
    for row in range(8):
        candidate = solutions[row]
        distance = 0.0
        for j in range(6):
            candidate[j] = _near(candidate[j], q_near[j])
            if within_limits:
                candidate[j] = _into_limits(candidate[j], JOINT_LIMITS[j, 0], JOINT_LIMITS[j, 1])
            distance += (candidate[j] - q_near[j]) ** 2
        if distance < best_distance:
            best, best_distance = candidate, distance
    return best


def arm_lengths() -> Array:
    """d1, d4, d5, d6, a2, a3 of the arm in use [m], shape (6,), as the inverse takes them."""
    return NOMINAL[(1, 1, 1, 1, 2, 2), (0, 3, 4, 5, 1, 2)]


def inverse_on_branch(T: Array, q_near: Array, q: Array) -> bool:
    """`solve_on_branch` of the arm in use."""
    return bool(solve_on_branch(arm_lengths(), T, q_near, q))


def inverse_all(T_base_flange: Array, q6_if_aligned: float) -> Array:
    """All joint angles (8, 6), in [-pi, pi], that bring the flange to a pose (4, 4), in closed form; NaN
    where none.

    Rows 0-3 and 4-7 have the two pan angles, within them rows 0-1 and 2-3 the two signs of wrist 2, even and
    odd rows those of the elbow. ``q6_if_aligned`` is wrist 3 where the pose leaves it free (wrist 2 at 0 or
    180 deg) [rad].
    """
    return solve_all(arm_lengths(), T_base_flange, q6_if_aligned)


def nearest_solution(T_base_flange: Array, q_near: Array, within_limits: bool) -> Array:
    """The solution (6,) [rad] closest to ``q_near`` (6,) [rad] in the sum of squared differences; NaN if
    there is none.

    Only those inside the joint limits count if ``within_limits``.
    """
    return _nearest_solution(arm_lengths(), T_base_flange, q_near, within_limits)


@kernel
def _into_limits(angle: float, lowest: float, highest: float) -> float:
    """The angle brought into its range by full turns; NaN where that is impossible."""
    if angle > highest:
        angle -= _TURN * math.ceil((angle - highest) / _TURN)
    if angle < lowest:
        angle += _TURN * math.ceil((lowest - angle) / _TURN)
    return angle if angle <= highest else math.nan


def inverse_near(T_base_flange: Array, q_near: Array) -> Array:
    """Joint angles (6,) [rad] inside the limits that bring the flange to T_base_flange (4, 4), closest to
    ``q_near``.

    Raises:
        ReachError: The flange cannot be brought there.
    """
    q = nearest_solution(
        np.ascontiguousarray(T_base_flange, dtype=float), np.asarray(q_near, dtype=float), True
    )
    if np.isnan(q).any():
        x, y, z = 1e3 * np.asarray(T_base_flange)[:3, 3]
        d4, d5, a2, a3 = 1e3 * np.abs(arm_lengths()[[1, 2, 4, 5]])
        raise ReachError(
            f"the {used_arm().label} cannot bring its flange to ({x:.1f}, {y:.1f}, {z:.1f}) mm in the base "
            f"frame with the wanted direction: its wrist reaches {a2 + a3 + d5:.0f} mm from the shoulder and "
            f"not closer than {d4:.0f} mm to its own axis. Move the part or turn the tool."
        )
    return q


def inverse_with_table(table: Array, T_base_flange: Array, q: Array) -> Array:
    """Joint angles (n, 6) [rad] that bring the flange of an arm as built to poses (n, 4, 4).

    Newton's method from ``q`` (n, 6) [rad], the nominal solutions of the configuration wanted.

    Raises:
        ReachError: A pose is not reached: near a singularity, or the start was not close.
    """
    q = q.copy()
    for _ in range(_MOST_ROUNDS):
        frames = link_frames(q, table)
        off = _pose_errors(frames[:, 6], T_base_flange)
        if np.abs(off).max() < CLOSE:
            return q
        q += (np.linalg.pinv(_jacobian_of(frames, np.zeros(3))) @ off[:, :, None])[:, :, 0]
    worst = int(np.abs(off).max(axis=1).argmax())
    raise ReachError(
        f"an arm with this table cannot bring its flange to pose {worst + 1} of {len(q)}: "
        f"{np.abs(off[worst]).max():.1g} m or rad are left. It is near a singularity: move the part or turn "
        "the tool."
    )


def _pose_errors(T: Array, T_wanted: Array) -> Array:
    """Displacement [m] and rotation vector [rad] from poses (n, 4, 4) to others, base axes, shape (n, 6)."""
    turn = vectors_from_rotations(T_wanted[:, :3, :3] @ T[:, :3, :3].transpose(0, 2, 1))
    return np.concatenate([T_wanted[:, :3, 3] - T[:, :3, 3], turn], axis=1)


# A sequence of tool poses followed with the joints.


@dataclass(frozen=True, eq=False)
class JointPath:
    """A pose sequence followed by the joints, without jumping between the arm's configurations."""

    q: Array  #: Joint angles [rad], shape (n, 6); NaN from the first unreachable pose on
    first_unreachable: int | None  #: Index of the first pose out of reach, or None
    first_beyond_limit: int | None  #: Index of the first pose at which a joint is outside its limits, or None
    limit_joint: int | None  #: The joint (0-5) that is outside its limits there, or None
    #: Largest change of a joint between neighbouring poses [rad]; large near a singularity
    largest_step: float
    largest_step_index: int  #: Index of the pose that this step ends at (0: `q_start` to the first pose)
    point_flange: Array  #: The tool point on the flange [m], shape (3,)

    @cached_property
    def singular_values(self) -> Array:
        """Smallest singular value of the Jacobian at the tool point up to the first pose out of reach, mixed
        units."""
        return smallest_singular_values(self.q[: self.first_unreachable], self.point_flange)

    @property
    def smallest_singular_value(self) -> float:
        """Least of them."""
        return float(self.singular_values.min(initial=np.inf))

    @property
    def smallest_singular_index(self) -> int:
        """Index of the pose closest to a singularity."""
        return int(self.singular_values.argmin()) if len(self.singular_values) else 0


@njit
def _follow(lengths: Array, T_base_flange: Array, q_start: Array, q: Array) -> None:
    """Write joint angles (n, 6) along the poses, each the solution closest to the last one, up to one out of
    reach."""
    last = q_start
    for i in range(q.shape[0]):
        last = _nearest_solution(lengths, T_base_flange[i], last, False)
        if math.isnan(last[0]):
            break
        for j in range(6):
            q[i, j] = last[j]


def _first(mask: Bools) -> int | None:
    """Index of the first true value, or None."""
    return int(mask.argmax()) if mask.any() else None


def track(T_base_tool: Array, T_flange_tool: Array, q_start: Array) -> JointPath:
    """Follow tool poses (n, 4, 4), staying in the arm configuration nearest to ``q_start`` (6,) [rad].

    Joint limits are reported, not enforced, so that a path that leaves them shows where.
    """
    T_tool_flange: Array = np.linalg.inv(np.asarray(T_flange_tool, dtype=float))
    start: Array = np.array(q_start, dtype=float)
    q = np.full((len(T_base_tool), 6), np.nan)
    _follow(arm_lengths(), np.asarray(T_base_tool, dtype=float) @ T_tool_flange, start, q)
    q.flags.writeable = False
    reached = ~np.isnan(q[:, 0])
    beyond = beyond_range(q)
    first_beyond = _first(np.any(beyond, axis=1))
    steps = np.abs(np.diff(q, axis=0, prepend=start[None])).max(axis=1)[reached]
    return JointPath(
        q=q,
        first_unreachable=_first(~reached),
        first_beyond_limit=first_beyond,
        limit_joint=None if first_beyond is None else int(beyond[first_beyond].argmax()),
        largest_step=float(steps.max(initial=0.0)),
        largest_step_index=int(steps.argmax()) if steps.size else 0,
        point_flange=np.ascontiguousarray(T_flange_tool[:3, 3], dtype=float),
    )
