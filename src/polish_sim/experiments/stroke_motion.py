"""How a stroke on the part is followed: its way points smoothed to a motion at the feed."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.stroke import feed_pace
from polish_sim.config import SmoothingConfig
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.motion.rules.chain import Chain, build_chain, repeated_points
from polish_sim.motion.rules.limits import Arm, SmoothingLimits, load_limits, six
from polish_sim.motion.rules.schedule import RULES, Rule, SmoothMotion, check_rule
from polish_sim.motion.segment_rates import sampled_joints
from polish_sim.motion.trajectory import (
    TimedPath,
    build_path_table,
    row_times,
    time_path,
    time_schedule,
    with_feed,
    with_feed_share,
)

if TYPE_CHECKING:
    from polish_sim.cell import Stroke
    from polish_sim.geometry.repair.skin import ScanNoise
    from polish_sim.planning.toolpath import ToolPath


CELL_LIMITS = SmoothingLimits(
    tip_acceleration=0.6,
    tip_jerk=15.0,
    axis_speed=2.0,
    axis_acceleration=6.0,
    axis_jerk=300.0,
    joint_jerk=six(600.0),
)
"""The tip gets half of the acceleration of the robot's velocity interface (1.2 m/s^2 by default), built up in
40 ms: the other half is for the force loop. The axis, which that loop does not move, gets all of it
(6 rad/s^2), built up in 20 ms: half of it costs the spiral on the freeform part 3% of its time. The tip's
speed is the feed. The joints have the arm's defaults, their jerk (no maker publishes one) high enough that
the tool's limits decide at most corners."""

SPLINE = "spline"
AXIS_SHARES = (1.0, 0.5)  #: Shares of the axis's acceleration tried before the joints' own, cautious bounds


class StrokePath(NamedTuple):
    """A stretch of path in contact, n points, in the frame the robot is given in."""

    tips: Array  #: Tool points, pressed in [m], shape (n, 3)
    rotations: Array  #: Tool frames, shape (n, 3, 3)
    s: Array  #: Arc length on the part from the stroke's start [m], never falling, shape (n,)
    feed: Array  #: Wanted rate of it [m/s], shape (n,)
    limits: SmoothingLimits = CELL_LIMITS  #: Where the scenario's file sets no others

    @property
    def marks(self) -> Array:
        """Arc lengths at the way points of its chain [m]."""
        return self.s[~repeated_points(self.tips, self.rotations)]


def stroke_path(
    path: ToolPath,
    rows: slice,
    points: Array,
    rotations: Array,
    usual: float,
    limits: SmoothingLimits,
) -> StrokePath:
    """The stroke of some rows of a path whose tool points and frames are these, (n, 3), (n, 3, 3); ``usual``
    is its feed where the path has none [m/s]."""
    s = path.s[rows]
    return StrokePath(points[rows], rotations[rows], s - s[0], path.feeds(usual)[rows], limits)


def check_stroke_rule(asked: SmoothingConfig) -> None:
    """Refuse an unknown rule (InputError) and a file of limits that cannot be used (ConfigError) before
    planning."""
    check_rule("smoothing.rule", asked.rule, STROKE_RULES)
    cell_limits(asked, CELL_LIMITS)


_MOTIONS: dict[bytes, TimedPath | None] = {}
MOST_ROWS = 200_000
"""Rows of motions that are kept, 20 MB: a proof plays the same strokes again and again, and a run those of
its plan."""


def stroke_motion(asked: SmoothingConfig, stroke: StrokePath, arm: Arm | None) -> TimedPath | None:
    """Smooth a stroke with the rule that is ``asked`` for; None if the stroke stays at one place.

    Without an arm only the tool's limits count. See `check_stroke_rule`. A stroke that is the same to 1e-9
    [m, -] as one before gets its motion: of a path that is cut, those that stay are off by rounding alone.

    Raises:
        SmoothingError: There is no such motion; names the place.
    """
    stroke = stroke._replace(limits=cell_limits(asked, stroke.limits))
    settings = repr((asked, stroke.limits)).encode()
    columns = (*stroke[:4], *(arm or ()), NOMINAL)
    content = b"".join((np.round(column, 9) + 0.0).tobytes() for column in columns)
    key = hashlib.sha256(settings + content).digest()
    if key not in _MOTIONS:
        chain = build_chain(stroke.tips, stroke.rotations)
        _MOTIONS[key] = STROKE_RULES[asked.rule](asked, stroke, chain, arm) if len(chain.lengths) else None
    motion = _MOTIONS[key] = _MOTIONS.pop(key)  # the last one used is dropped last
    while sum(len(kept.places) for kept in _MOTIONS.values() if kept) > MOST_ROWS and len(_MOTIONS) > 1:
        del _MOTIONS[next(iter(_MOTIONS))]
    return motion


def within_noise(asked: SmoothingConfig, noise: ScanNoise) -> SmoothingConfig:
    """For a surface that is known within a noise only: strokes may be as far from the path as that."""
    tip, axis = max(asked.tolerance_m, noise.offset), max(asked.axis_tolerance_rad, noise.slope)
    return replace(asked, tolerance_m=tip, axis_tolerance_rad=axis)


def along_a_curve(asked: SmoothingConfig, stroke: StrokePath, chain: Chain, arm: Arm | None) -> TimedPath:
    """Follow a smooth curve within the tolerances; the contact on the part keeps the feed wherever limits
    allow it."""
    from polish_sim.motion.spline.motion import Feed, plan_spline  # slow to import

    marks = stroke.marks
    tolerances = asked.tolerance_m, asked.axis_tolerance_rad
    return time_schedule(
        plan_spline(chain, marks, Feed(stroke.s, stroke.feed), stroke.limits, tolerances, arm), marks
    )


def by_rule(
    plan: Rule, asked: SmoothingConfig, stroke: StrokePath, chain: Chain, arm: Arm | None
) -> TimedPath:
    """Follow the way points by a rule of `smooth`.

    Limits of the tool are planned for; where a row of the motion would break one of a joint, the axis is
    turned more gently, and if that does not help, joints are planned for as well.
    The feed is that of the contact on the part: pressed in on a bend the tool point is faster or slower.
    """
    marks = stroke.marks
    top = stroke.feed.max()
    # At one speed short chords may be joined; the motion's clock then keeps the contact at the feed.
    stretch = np.percentile(chain.lengths / np.maximum(np.diff(marks), 1e-9), 99)
    limits = replace(stroke.limits, tip_speed=top * stretch)
    for share in AXIS_SHARES:
        tool = replace(
            limits, axis_acceleration=share * limits.axis_acceleration, axis_jerk=share**2 * limits.axis_jerk
        )
        smooth = plan(chain, tool, asked.tolerance_m, asked.axis_tolerance_rad, None, None)
        if arm is None or joints_keep(limits, smooth, arm):
            break
    else:
        smooth = plan(chain, limits, asked.tolerance_m, asked.axis_tolerance_rad, arm, None)
    motion = time_schedule(smooth, marks)
    feed = np.interp(motion.places, stroke.s, stroke.feed)
    return with_feed(motion, feed, feed_pace(top).acceleration / top)


def at_the_feed(asked: SmoothingConfig, stroke: StrokePath, chain: Chain, arm: Arm | None) -> TimedPath:
    """Follow the way points' chords at the feed, whatever acceleration that takes: no time law, to compare
    with."""
    top = stroke.feed.max()
    table = build_path_table(stroke.tips, stroke.rotations, stroke.s)
    return time_path(with_feed_share(table, stroke.s, stroke.feed / top), feed_pace(top))


StrokeRule = Callable[[SmoothingConfig, StrokePath, Chain, Arm | None], TimedPath]
STROKE_RULES: Mapping[str, StrokeRule] = {
    **{name: partial(by_rule, plan) for name, plan in RULES.items()},
    SPLINE: along_a_curve,
    "none": at_the_feed,
}
"""How a stroke may be followed, by name."""


def joints_keep(limits: SmoothingLimits, motion: SmoothMotion, arm: Arm) -> bool:
    """Whether all joints are within their limits at every row of a motion; between rows nothing is looked
    at."""
    joints = sampled_joints(motion.sample(row_times(motion.end)), arm)
    return bool(np.all(np.abs(joints[1:]) <= limits.table[:, None, 2:]))


def cell_limits(asked: SmoothingConfig, otherwise: SmoothingLimits) -> SmoothingLimits:
    """Limits of a stroke: those of the file asked for, else the given ones; the tip's speed is the rule's."""
    limits = load_limits(Path(asked.limits_file), otherwise) if asked.limits_file else otherwise
    return replace(limits, tip_speed=math.inf)


# How long the smoothed motion along a path takes and where it is slower than the feed.

KEPT = 0.99  #: Share of the feed from which it counts as kept [-]
SAME = 1.0 + 1e-6  # feeds within this ratio are equal
#: So far from the ends of a stroke, where the tool is at rest, the least feed is not looked for [m]
END_M = 0.001


def feed_figures(strokes: Sequence[Stroke]) -> dict[str, float]:
    """Figures of the time law of all strokes, in order.

    motion_time_s: of the strokes in contact; feed_kept: share of the way at ``KEPT`` of the feed or more;
    feed_least_m_s and feed_least_at_m: least feed away from the strokes' ends, and the first place on the
    path with it.
    """
    times = 0.0
    lengths = 0.0
    kept = 0.0
    slowest = (math.nan, math.nan)
    for stroke in strokes:
        motion, feed = stroke.motion, stroke.feed
        fed = motion.speeds * motion.rates
        steps = np.diff(motion.places)
        times += motion.playing_time
        lengths += steps.sum()
        kept += steps[np.minimum(fed[1:], fed[:-1]) >= KEPT * feed].sum()
        inner = np.flatnonzero((motion.places > END_M) & (motion.places < motion.places[-1] - END_M))
        if len(inner):
            row = inner[np.argmax(fed[inner] <= SAME * fed[inner].min())]
            if not fed[row] >= slowest[0] / SAME:
                slowest = (fed[row], stroke.start_s + motion.places[row])
    return {
        "motion_time_s": times,
        "feed_kept": kept / lengths if lengths > 0.0 else math.nan,
        "feed_least_m_s": slowest[0],
        "feed_least_at_m": slowest[1],
    }
