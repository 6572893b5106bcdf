"""What lies ahead on the path: at every half millimetre the statics of springs and pad on the drawing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Indices, joined, norms
from polish_sim.cell.contact import build_pad
from polish_sim.cell.linear_arm import arm_modes, joints_about
from polish_sim.cell.scene import tool_on_flange
from polish_sim.cell.stroke import Stroke
from polish_sim.config import Scenario
from polish_sim.control.signals import Course
from polish_sim.geometry.field_lookup import DistanceField, look_up
from polish_sim.kernel_cache import njit
from polish_sim.motion.kinematics import track
from polish_sim.motion.trajectory import PathTable, sample_column, sample_path
from polish_sim.spatial import rotation_from_quaternion, transform

SPACING = 0.0005  # of the rows [m]
REACH = 1.5  # step-overs within which a turn counts as neighbour
STRANDS_APART = 2.5  # times that reach along the path: nearer places are the same strand
ROUNDS = 30
CLOSE_N = 1e-4  # force to which the statics are solved [N]
POSE_SPACING, MOST_POSES = 0.01, 400  # at which the arm's vibration is worked out [m], and at most
LONGEST_STEP = 0.002  # of the search for the depth [m]
FURTHEST = 0.03  # the pad is sought this far from its planned place [m]


class _Poses(NamedTuple):
    """Planned, pressed-in tool poses at rows of the course, base frame."""

    positions: Array
    rotations: Array
    turning: Array
    bending: Array
    curvature: Array
    force: Array
    feed: Array


class _Press(NamedTuple):
    """What a disc pressed on the part feels; the sums over its points."""

    force: float  #: Along tool z [N]
    slope: float  #: Its change with depth [N/m]
    moment: tuple[float, float]  #: About tool x and y through the middle of the face [N m]
    tilt_stiffness: tuple[float, float]  #: Change of that moment with a tilt at the same force [N m/rad]
    buried: int  #: Points too deep for the field


def build_course(
    scenario: Scenario,
    strokes: Sequence[Stroke],
    drawn: DistanceField,
    T_base_work: Array,
    q_start: Array,
) -> Course:
    """Work out what force, springs, pad and the drawn part ask for along the whole path of all ``strokes``.

    ``drawn`` is the signed distance of the nominal part in the work frame, which lies at ``T_base_work``,
    shape (4, 4); the arm reaches the first pose with its joints near ``q_start`` (6,) [rad]. Rows between
    two strokes, in the air, repeat the nearest row in contact.
    """
    rows = math.floor(max(stroke.start_s + stroke.process.length for stroke in strokes) / SPACING) + 2
    s = np.arange(rows) * SPACING
    # Rows in the air belong to the nearer stroke.
    starts = np.array([stroke.start_s for stroke in strokes])
    ends = starts + [stroke.process.length for stroke in strokes]
    owner = np.searchsorted(0.5 * (ends[:-1] + starts[1:]), s)
    parts = [_poses(stroke, s[owner == k]) for k, stroke in enumerate(strokes)]
    poses = _Poses(*joined(parts))
    R, p = T_base_work[:3, :3], T_base_work[:3, 3]
    pad = build_pad(scenario.pad)
    surplus, stiffness, moment, tilt_stiffness = _solve(
        drawn, pad.x, pad.y, pad.material.stiffness, scenario.head.stiffness_n_m, (poses.positions - p) @ R,
        np.ascontiguousarray(R.T @ poses.rotations), poses.force,
    )  # fmt: skip
    springs = 1.0 / (1.0 / scenario.head.stiffness_n_m + 1.0 / scenario.pad.stiffness_n_m)
    pressed_in = poses.force / springs
    unpressed = poses.positions - pressed_in[:, None] * poses.rotations[:, :, 2]
    along = poses.curvature, poses.bending, poses.turning, poses.feed
    earlier = nearest_earlier(unpressed, SPACING, REACH * scenario.plan.stepover_m)
    few = np.linspace(0, rows - 1, min(math.ceil(s[-1] / POSE_SPACING) + 1, MOST_POSES)).astype(np.int64)
    modes = np.zeros(rows)
    if scenario.robot.elastic:
        tools = transform(poses.rotations[few], poses.positions[few])
        abouts = joints_about(scenario, track(tools, tool_on_flange(), q_start).q)
        modes = np.interp(np.arange(rows), few, arm_modes(abouts, springs))
    statics = pressed_in + surplus, surplus, stiffness, moment, tilt_stiffness
    return Course(SPACING, *statics, *along, earlier, modes)


def nearest_earlier(points: Array, spacing: float, reach: float) -> Indices:
    """Row of the nearest earlier point that is not of the same strand, -1 where there is none, shape (n,).

    ``points`` (n, 3) [m] lie at equal steps ``spacing`` [m] of arc length; a neighbour is no further than
    ``reach`` [m].
    """
    stride = max(1, int(reach / (6.0 * spacing)))
    few = np.arange(0, len(points), stride)
    gap = math.ceil(STRANDS_APART * reach / (spacing * stride))
    tree = cKDTree(points[few])
    found = tree.query(points[few], k=min(64, len(few)), distance_upper_bound=reach)[1].reshape(len(few), -1)
    earlier = found < np.arange(len(few))[:, None] - gap
    first = earlier.argmax(axis=1)
    coarse = np.where(earlier.any(axis=1), found[np.arange(len(few)), first] * stride, -1)
    return _refined(points, np.repeat(coarse, stride)[: len(points)], stride)


def _refined(points: Array, coarse: Indices, stride: int) -> Indices:
    """The nearest row within a stride of a guess, shape (n,)."""
    tried = np.clip(coarse[:, None] + np.arange(-2 * stride, 2 * stride + 1), 0, len(points) - 1)
    distance = norms(points[tried] - points[:, None])
    best = tried[np.arange(len(points)), distance.argmin(axis=1)]
    return np.asarray(np.where(coarse < 0, -1, best), dtype=np.int64)


def _poses(stroke: Stroke, s: Array) -> _Poses:
    """Poses of one stroke at arc lengths of the plan (n,) [m], held at its ends."""
    n = len(s)
    table = stroke.process
    tangents = np.gradient(table.tangents, table.spacing, axis=0)
    rows = np.clip(((s - stroke.start_s) / table.spacing).astype(np.int64), 0, len(tangents) - 1)
    feed = np.interp(s - stroke.start_s, stroke.motion.places, stroke.motion.speeds * stroke.motion.rates)
    poses = _Poses(
        np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3)), norms(tangents)[rows],
        table.curvature[rows], np.empty(n), feed,
    )  # fmt: skip
    _sample(table, stroke.force, s - stroke.start_s, poses)
    return poses


@njit
def _sample(table: PathTable, forces: Array, places: Array, poses: _Poses) -> None:
    tangent, quaternion = np.empty(3), np.empty(4)
    for i in range(len(places)):
        sample_path(table, places[i], poses.positions[i], tangent, quaternion, poses.turning[i])
        rotation_from_quaternion(quaternion, poses.rotations[i])
        poses.force[i] = sample_column(table, forces, places[i])


@njit
def _solve(field, x, y, k_point, k_head, positions, rotations, forces):  # type: ignore[no-untyped-def]
    """Depth beyond each pose at which head spring and pad press with the wanted ``forces`` (n,) [N].

    The pad's force grows convexly with its depth: Newton's method, begun from the row before. The disc's
    points ``x``, ``y`` (p,) [m] have stiffness ``k_point`` [N/m]; ``positions`` (n, 3) [m] and ``rotations``
    (n, 3, 3) are tool frames in the field's frame. Returns surplus (n,) [m], stiffness (n,) [N/m], moment (n,
    2) [N m], tilt stiffness (n, 2) [N m/rad].
    """
    count = len(positions)
    surplus, stiffness = np.empty(count), np.empty(count)
    moment, tilt_stiffness = np.empty((count, 2)), np.empty((count, 2))
    nodes = field.bricks.reshape(-1)
    u = -forces[0] / k_head  # on a flat part the pad is there
    for i in range(count):
        p, R = positions[i], rotations[i]
        for _ in range(ROUNDS):
            disc = _press_disc(field, nodes, x, y, k_point, p, R, u)
            short = forces[i] - disc.force
            if abs(short) < CLOSE_N:
                break
            step = short / disc.slope if disc.slope > 0.0 else LONGEST_STEP
            if disc.buried > 0:
                step = -LONGEST_STEP  # deeper than the field knows
            u = min(max(u + min(max(step, -LONGEST_STEP), LONGEST_STEP), -FURTHEST), FURTHEST)
        surplus[i] = u + forces[i] / k_head
        stiffness[i] = disc.slope * k_head / (disc.slope + k_head)
        for a in range(2):
            moment[i, a], tilt_stiffness[i, a] = disc.moment[a], disc.tilt_stiffness[a]
    return surplus, stiffness, moment, tilt_stiffness


@njit
def _press_disc(field, nodes, x, y, k, p, R, u):  # type: ignore[no-untyped-def]
    """Press the disc, its face ``u`` [m] beyond a pose, on the part."""
    force = slope = moment_x = moment_y = 0.0
    slope_x = slope_y = slope_xx = slope_yy = 0.0
    buried = 0
    per_metre = 1.0 / field.spacing
    for q in range(len(x)):
        a, b = x[q], y[q]
        distance, gx, gy, gz = look_up(
            field, nodes, per_metre,
            p[0] + a * R[0, 0] + b * R[0, 1] + u * R[0, 2],
            p[1] + a * R[1, 0] + b * R[1, 1] + u * R[1, 2],
            p[2] + a * R[2, 0] + b * R[2, 1] + u * R[2, 2],
        )  # fmt: skip
        size = math.sqrt(gx * gx + gy * gy + gz * gz)
        if distance >= 0.0:
            continue
        if size == 0.0:
            buried += 1
            continue
        # The part of its push on the part that goes along tool z.
        nz = -(R[0, 2] * gx + R[1, 2] * gy + R[2, 2] * gz) / size
        push, rise = -k * distance, k * nz * nz
        force += push * nz
        slope += rise
        moment_x, moment_y = moment_x + push * nz * b, moment_y - push * nz * a
        slope_x, slope_y = slope_x + rise * b, slope_y + rise * a
        slope_xx, slope_yy = slope_xx + rise * b * b, slope_yy + rise * a * a
    tilt_x = slope_xx - slope_x * slope_x / slope if slope > 0.0 else 0.0
    tilt_y = slope_yy - slope_y * slope_y / slope if slope > 0.0 else 0.0
    return _Press(force, slope, (moment_x, moment_y), (tilt_x, tilt_y), buried)
