"""Whether the settings of two robots fit each other, and both arms can do all of the work as fast as asked,
before anything moves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, norms
from polish_sim.calibration.arm import LEAST_POSES
from polish_sim.config import DualConfig, RobotConfig, Scenario
from polish_sim.dual.carrier import RAMP_PEAK, MasterRows
from polish_sim.dual.master import PartWay
from polish_sim.dual.placement import Collides, PairReach, PairWork, sampled
from polish_sim.dual.strokes import ON_THE_WAY, Visits
from polish_sim.errors import ConfigError, InputError, ReachError
from polish_sim.experiments.beliefs import TRACKER
from polish_sim.experiments.placement import failure_of
from polish_sim.motion import track
from polish_sim.motion.rules.limits import JOINT_ACCELERATION
from polish_sim.planning.toolpath import interpolate
from polish_sim.spatial import apply_each, vectors_from_rotations

DIFFERENCE_S = 0.01  # of the master's time, for derivatives [s]


BY_FILE = ("master_speed_m_s", "master_direction", "master_travel_m", "master_turn_rad_s")
"""Settings of section dual that say how the part moves where no file does."""


def check_pair_settings(scenario: Scenario) -> None:
    """Refuse settings beside a calibration of the arms, or a file of the master's motion, that say the same
    or do not hold with it, too few poses for a calibration, and a direction that is zero.

    Raises:
        ConfigError: Naming them and what to do.
    """
    dual = scenario.dual
    source, others = "dual.arm_poses", ["bases_file"]
    if dual.arms_file:
        source = "dual.arms_file"
        others = ["bases_file", "arm_poses", "arm_length_error_m", "arm_angle_error_rad"]
    if dual.arms_file or dual.arm_poses or scenario.robot.compensation == TRACKER:
        if given := [f"dual.{name}" for name in others if getattr(dual, name)]:
            raise ConfigError(
                f"{', '.join(given)} beside {source}: the calibration of the arms says how they are and "
                "where the follower's base stands. Give one of the two."
            )
        if dual.tool_file:
            raise ConfigError(
                f"dual.tool_file beside {source}: '{dual.tool_file}' was measured on the flange of an arm as "
                "the nominal table has it, not as the calibration of the arms has it. Leave the tool's file "
                "out: the run calibrates its tool with the arms' own tables."
            )
    if 0 < dual.arm_poses < LEAST_POSES:
        raise ConfigError(
            f"dual.arm_poses = {dual.arm_poses} cannot determine an arm's table: 0, or {LEAST_POSES} or more."
        )
    if not dual.master_path:
        if not any(dual.master_direction):
            raise ConfigError("'dual.master_direction' is no direction: give x, y, z, not all zero.")
        return
    idle = [f"dual.{name}" for name in BY_FILE if getattr(dual, name) != getattr(DualConfig(), name)]
    if idle:
        raise ConfigError(
            f"'{dual.master_path}' (dual.master_path) says how the part moves: leave {', '.join(idle)} out."
        )
    if scenario.part.pose:
        raise ConfigError(
            f"'{dual.master_path}' (dual.master_path) says where the part is held: leave part.pose "
            "(--part-pose) out."
        )


class MotionCheck(NamedTuple):
    """The planned motion of both arms, at close moments."""

    work: PairWork
    reach: PairReach
    visits: Visits  #: Closer together than those the work was planned with
    robot: RobotConfig  #: Limits of both arms


def check_length(visits: Visits, way: PartWay) -> None:
    """Refuse a motion that is over before the work; the InputError says by how much."""
    needed = visits.clock[-1]
    lasts = way.lasts
    if way.file and lasts < needed:
        raise InputError(
            f"'{way.file.columns.file}' lasts {lasts:.2f} s, the tool works on the part for {needed:.2f} "
            f"s: {needed - lasts:.2f} s are missing. Extend the file, raise --feed, or stop early with --set "
            "process.max_feed_s=..."
        )


def check_motion(check: MotionCheck, rows: MasterRows, collides: Collides) -> None:
    """Follow all of the work closely with both arms, the master along its rows.

    Raises ReachError if an arm would be too fast or cannot follow, or something would touch; names joint and
    moment.
    """
    check_master(check, rows)
    check_carried(check)
    q_master = interpolate(check.visits.clock, rows.times, rows.q)
    touching = collides(q_master, _follow(check))
    if touching:
        raise ReachError(
            f"{touching} would touch on the way, or come closer than dual.clearance_m or "
            "dual.pad_clearance_m. Hold the part elsewhere, or move it another way."
        )


def check_master(check: MotionCheck, rows: MasterRows) -> None:
    """Refuse a motion too fast for the master's joints; the ReachError names joint, moment and, of a file,
    the line."""
    times = rows.times
    speed = np.abs(rows.qd)
    change = np.abs(np.gradient(rows.qd, rows.spacing, axis=0))
    places = [_place(check, time) for time in times]
    _refuse(check, speed, places, check.robot.joint_speed_limit_rad_s, "master would turn at", "deg/s")
    _refuse(check, change, places, JOINT_ACCELERATION, "master would be accelerated by", "deg/s^2")
    # Where it is released or brakes, its time does not pass evenly.
    at = check.visits.clock[check.visits.rate < 1.0]
    together = RAMP_PEAK * speed + change
    ramps = interpolate(at, times, together)
    what = "master would be accelerated, from rest or to rest, by"
    _refuse(check, ramps, [_place(check, time) for time in at], JOINT_ACCELERATION, what, "deg/s^2")


def check_carried(check: MotionCheck) -> None:
    """Refuse a motion of the part that the follower's velocity interface cannot keep up with; names the
    moment."""
    at = check.visits
    way = check.work.way
    # A file's motion has an end on either side.
    clock = np.clip(at.clock, DIFFERENCE_S, max(way.lasts - DIFFERENCE_S, DIFFERENCE_S))
    before, now, after = (
        way(check.reach.T_master_work, clock + shift) for shift in (-DIFFERENCE_S, 0.0, DIFFERENCE_S)
    )
    places = [apply_each(P, at.points) for P in (before, now, after)]
    turns = [
        vectors_from_rotations(b[:, :3, :3] @ np.swapaxes(a[:, :3, :3], 1, 2)) / DIFFERENCE_S
        for a, b in ((before, now), (now, after))
    ]
    velocity = (places[2] - places[0]) / (2.0 * DIFFERENCE_S)
    ramping = np.where(at.rate < 1.0, RAMP_PEAK, 0.0)
    linear = norms(places[2] - 2.0 * places[1] + places[0]) / DIFFERENCE_S**2
    angular = norms(turns[1] - turns[0]) / DIFFERENCE_S
    linear += ramping * norms(velocity)
    angular += ramping * norms(0.5 * (turns[0] + turns[1]))
    for found, unit, scale, key in (
        (linear, "mm/s^2", 1e3, "linear_acceleration_m_s2"),
        (angular, "deg/s^2", np.degrees(1.0), "angular_acceleration_rad_s2"),
    ):
        most, row = getattr(check.robot, key), found.argmax()
        if found[row] > most:
            raise ReachError(
                f"the part would carry the tool with {scale * found[row]:.0f} "
                f"{unit}{_place(check, at.clock[row])}: the follower does {scale * most:.0f} "
                f"(robot.{key}). {_change(check)}"
            )


def _follow(check: MotionCheck) -> Array:
    """Joints of the follower at all visits, shape (n, 6); refused if it cannot follow or not as fast."""
    at = check.visits
    _, tools = sampled(check.work, check.reach.T_master_work, check.reach.spin, at)
    joints = track(tools, check.work.chain.T_flange_tool, check.reach.q_follower)
    if failure := failure_of(joints, False):
        raise ReachError(
            f"the follower cannot do this: at {1e3 * at.s[failure.point]:.1f} mm of the path "
            f"{failure.reason}."
        )
    moving = (at.stroke[1:] == at.stroke[:-1]) & (at.stroke[1:] != ON_THE_WAY) & (np.diff(at.time) > 0.0)
    speed = np.abs(np.diff(joints.q, axis=0)[moving]) / np.diff(at.time)[moving, None]
    places = [f" at {1e3 * s:.1f} mm of the path" for s in at.s[1:][moving]]
    _refuse(check, speed, places, check.robot.joint_speed_limit_rad_s, "follower would turn at", "deg/s")
    return joints.q


def _refuse(check: MotionCheck, found: Array, places: list[str], most: float, does: str, unit: str) -> None:
    """Refuse what is above a limit, (n, 6) at n places."""
    if not found.size or found.max() <= most:
        return
    row, joint = np.unravel_index(found.argmax(), found.shape)
    raise ReachError(
        f"joint {joint + 1} of the {does} {np.degrees(found.max()):.0f} {unit}{places[row]}: "
        f"{np.degrees(most):.0f} is its most. {_change(check)}"
    )


def _place(check: MotionCheck, clock: float) -> str:
    file = check.work.way.file
    return f" {clock:.2f} s into its motion" + (f" ({file.place(clock)})" if file else "")


def _change(check: MotionCheck) -> str:
    if check.work.way.file:
        return (
            "Give it more time. Rows of a robot's own log are noisy or dense, and the motion goes through "
            "all of them: smooth them or leave most of them out first; more time would not help there."
        )
    return (
        "Lower dual.master_speed_m_s or dual.master_turn_rad_s, or hold the part elsewhere with --part-pose."
    )
