"""Whether both arms can do the work all the way and as fast as asked, before anything moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.cell.carrier import RAMP_PEAK, MasterRows
from polish_sim.config import RobotConfig, Scenario
from polish_sim.dual.master import MasterMotion, master_motion
from polish_sim.dual.placement import Collides, PairReach, Sampled, Work, default_poses, find_pair_reach, sampled
from polish_sim.dual.strokes import ON_THE_WAY, Visits
from polish_sim.errors import InputError, ReachError
from polish_sim.experiments.placement import failure_of, given_placement
from polish_sim.motion import track
from polish_sim.motion.rules.limits import JOINT_ACCELERATION
from polish_sim.planning import ToolPath
from polish_sim.spatial import from_pose

Array = NDArray[np.float64]

DIFFERENCE_S: Final = 0.01  # of the master's time, for derivatives [s]


class Check(NamedTuple):
    """What is looked at, closely."""

    work: Work
    reach: PairReach
    motion: MasterMotion
    visits: Visits
    """More of them than the work was planned with."""
    robot: RobotConfig
    """Limits of both arms."""


def check_length(visits: Visits, motion: MasterMotion) -> None:
    """Refuse a motion that is over before the work.

    Raises:
        InputError: Says by how much.
    """
    needed, lasts = float(visits.clock[-1]), motion.way.lasts
    if motion.file is not None and lasts < needed:
        raise InputError(
            f"'{motion.file.columns.file}' lasts {lasts:.2f} s, the tool works on the part for {needed:.2f} s: "
            f"{needed - lasts:.2f} s are missing. Go on with it, raise --feed, or stop early with "
            "--set process.max_feed_s=..."
        )


def check_motion(check: Check, rows: MasterRows, collides: Collides) -> None:
    """Follow all of the work closely with both arms.

    Args:
        check: What is looked at.
        rows: What the master's joints do.
        collides: Looks for arms that touch.

    Raises:
        ReachError: An arm would be too fast or cannot follow, or something would touch; names joint and moment.
    """
    check_master(check, rows)
    check_carried(check)
    now = sampled(check.work, check.reach.T_master_work, check.reach.spin, check.visits)
    q_follower = _follow(check, now)
    times = rows.spacing * np.arange(len(rows.q), dtype=np.float64)
    q_master = np.stack([np.interp(check.visits.clock, times, rows.q[:, j]) for j in range(6)], axis=1)
    touching = collides(q_master, q_follower)
    if touching:
        raise ReachError(
            f"{touching} would touch on the way, or come closer than dual.clearance_m or dual.pad_clearance_m. "
            "Hold the part elsewhere, or move it another way."
        )


def check_master(check: Check, rows: MasterRows) -> None:
    """Refuse a motion too fast for the master's joints.

    Raises:
        ReachError: Names the joint, the moment and, of a file, the line.
    """
    times = rows.spacing * np.arange(len(rows.q), dtype=np.float64)
    speed, change = np.abs(rows.qd), np.abs(np.gradient(rows.qd, rows.spacing, axis=0))
    _refuse(check, speed, times, check.robot.joint_speed_limit_rad_s, "turn at", "deg/s")
    _refuse(check, change, times, JOINT_ACCELERATION, "be accelerated by", "deg/s^2")
    # Where it is let go or brakes, its time does not pass evenly.
    at = check.visits.clock[check.visits.rate < 1.0]
    together = RAMP_PEAK * speed + change
    ramps = np.stack([np.interp(at, times, together[:, j]) for j in range(6)], axis=1)
    _refuse(check, ramps, at, JOINT_ACCELERATION, "be accelerated, from rest or to rest, by", "deg/s^2")


def check_carried(check: Check) -> None:
    """Refuse a motion of the part that the follower's velocity interface cannot keep up with.

    Raises:
        ReachError: Names the moment and both accelerations.
    """
    at, way, T = check.visits, check.work.way, check.reach.T_master_work
    # A file's motion has an end on either side.
    clock = np.clip(at.clock, DIFFERENCE_S, max(way.lasts - DIFFERENCE_S, DIFFERENCE_S))
    before, now, after = (way(T, clock + shift) for shift in (-DIFFERENCE_S, 0.0, DIFFERENCE_S))
    places = [np.einsum("nij,nj->ni", P[:, :3, :3], at.points) + P[:, :3, 3] for P in (before, now, after)]
    turns = [
        Rotation.from_matrix(b[:, :3, :3] @ np.swapaxes(a[:, :3, :3], 1, 2)).as_rotvec() / DIFFERENCE_S
        for a, b in ((before, now), (now, after))
    ]
    velocity = (places[2] - places[0]) / (2.0 * DIFFERENCE_S)
    ramping = np.where(at.rate < 1.0, RAMP_PEAK, 0.0)
    linear = np.linalg.norm(places[2] - 2.0 * places[1] + places[0], axis=1) / DIFFERENCE_S**2
    angular = np.linalg.norm(turns[1] - turns[0], axis=1) / DIFFERENCE_S
    linear += ramping * np.linalg.norm(velocity, axis=1)
    angular += ramping * np.linalg.norm(0.5 * (turns[0] + turns[1]), axis=1)
    robot = check.robot
    for found, most, unit, scale, key in (
        (linear, robot.linear_acceleration_m_s2, "mm/s^2", 1e3, "robot.linear_acceleration_m_s2"),
        (angular, robot.angular_acceleration_rad_s2, "deg/s^2", np.degrees(1.0), "robot.angular_acceleration_rad_s2"),
    ):
        row = int(found.argmax())
        if found[row] > most:
            raise ReachError(
                f"the part would carry the tool with {scale * found[row]:.0f} {unit}"
                f"{_place(check, float(at.clock[row]))}: the follower does {scale * most:.0f} ({key}). {_cure(check)}"
            )


def _follow(check: Check, now: Sampled) -> Array:
    """Joints of the follower at all visits, shape (n, 6); refused if it cannot follow or not as fast."""
    at = check.visits
    joints = track(now.tools, check.work.chain.T_flange_tool, check.reach.q_follower)
    failure = failure_of(joints, False)
    if failure is not None:
        raise ReachError(
            f"the follower cannot do this: at {1e3 * at.s[failure.point]:.1f} mm of the path {failure.reason}."
        )
    moving = (at.stroke[1:] == at.stroke[:-1]) & (at.stroke[1:] != ON_THE_WAY) & (np.diff(at.time) > 0.0)
    speed = np.abs(np.diff(joints.q, axis=0)[moving]) / np.diff(at.time)[moving, None]
    most = check.robot.joint_speed_limit_rad_s
    if len(speed) and speed.max() > most:
        row, joint = np.unravel_index(int(speed.argmax()), speed.shape)
        raise ReachError(
            f"joint {joint + 1} of the follower would turn at {np.degrees(speed.max()):.0f} deg/s at "
            f"{1e3 * at.s[1:][moving][row]:.1f} mm of the path: {np.degrees(most):.0f} is its most. {_cure(check)}"
        )
    return joints.q


def _refuse(check: Check, found: Array, times: Array, most: float, doing: str, unit: str) -> None:
    """Refuse what is above a limit, (n, 6) at times of the master's motion (n,)."""
    if not found.size or found.max() <= most:
        return
    row, joint = np.unravel_index(int(found.argmax()), found.shape)
    raise ReachError(
        f"joint {joint + 1} of the master would {doing} {np.degrees(found.max()):.0f} {unit}"
        f"{_place(check, float(times[row]))}: {np.degrees(most):.0f} is its most. {_cure(check)}"
    )


def _place(check: Check, clock: float) -> str:
    file = check.motion.file
    return f" {clock:.2f} s into its motion" + (f" ({file.place(clock)})" if file is not None else "")


def _cure(check: Check) -> str:
    if check.motion.file is not None:
        return (
            "Give it more time. Rows of a robot's own log are noisy or dense, and the motion goes through all of them: "
            "smooth them or leave most of them out first; more time would not help there."
        )
    return "Lower dual.master_speed_m_s or dual.master_turn_rad_s, or hold the part elsewhere with --part-pose."


__all__ = ["Check", "check_carried", "check_length", "check_master", "check_motion"]


# Where two robots may hold a part, and what would do where they cannot do their work.

BASE_DISTANCES: Final = (1.1, 1.0, 1.2, 0.9, 1.3)
"""Between the bases, when another place for the follower's is looked for [m]."""
WAYS: Final = (0.6, 0.4, 0.2, 0.1)
"""Lengths of the part's way, when a slower master is looked for [m]."""
POSES: Final = 18
"""Poses of the part that are tried each time."""


class Trial(NamedTuple):
    """Work that cannot be done as asked."""

    scenario: Scenario
    work: Work
    motion: MasterMotion
    path: ToolPath
    up: Array
    """Side of the part to be worked on, work frame, shape (3,)."""
    collides: Collides
    """Looks for arms that touch."""
    contacts: Callable[[Array], Collides]
    """Makes such a check for a base of the follower in the master's, (4, 4)."""


def held_poses(scenario: Scenario, work: Work, motion: MasterMotion, up: Array) -> Iterator[Array]:
    """Where the part may be held at the start, base of the master, each (4, 4): as told, else candidates."""
    if scenario.part.pose:
        return (work.chain.T_master_follower @ T for T in given_placement(scenario.part.pose))
    return default_poses(work.chain, up, work.middle) if motion.file is None else iter(motion.T_start)


def what_would_do(trial: Trial) -> str:
    """What to change so that it can be done: where the part is held, how fast it goes, or where the follower stands."""
    for look in (_held_elsewhere, _slower, _base_elsewhere):
        text = look(trial)
        if text:
            return text
    return "No other place of the follower's base that was tried would do either."


def _held_elsewhere(trial: Trial) -> str:
    if not trial.scenario.part.pose or not _can(trial, trial.collides):
        return ""
    return "It can be done where the part is put by itself: leave --part-pose (part.pose) out."


def _slower(trial: Trial) -> str:
    """A speed of the master that fits, and how far the part then goes."""
    dual = trial.scenario.dual
    if trial.motion.file is not None or dual.master_speed_m_s == 0.0:
        return ""
    far = _way(trial.work)
    for short in (way for way in WAYS if way < far):
        speed = short / far * dual.master_speed_m_s
        slower = replace(trial.scenario, dual=replace(dual, master_speed_m_s=speed))
        motion = master_motion(slower, trial.path, trial.up, trial.work.chain)
        tried = trial._replace(scenario=slower, motion=motion, work=trial.work._replace(way=motion.way))
        if _can(tried, trial.collides):
            held = " and without --part-pose" if trial.scenario.part.pose else ""
            return (
                f"The master would carry the part along {1e3 * far:.0f} mm. With --master-speed {1e3 * speed:.3g}"
                f"{held} it is {1e3 * short:.0f} mm, and it can be done."
            )
    return ""


def _base_elsewhere(trial: Trial) -> str:
    """Another place of the follower's base, the bases facing each other."""
    for distance in BASE_DISTANCES:
        T = from_pose([-distance, 0.0, 0.0, 0.0, 0.0, np.pi])
        chain = trial.work.chain._replace(T_master_follower=T)
        if _can(trial._replace(work=trial.work._replace(chain=chain)), trial.contacts(T)):
            held = "" if trial.motion.file else " and the part where it is put by itself"
            return (
                f"It can be done with the follower's base elsewhere{held}: "
                f"--set dual.follower_pose=[{-distance:g},0,0,0,0,{np.pi:.9g}]."
            )
    return ""


def _can(trial: Trial, collides: Collides) -> bool:
    """Whether the work can be done with the part held anywhere."""
    free = replace(trial.scenario, part=replace(trial.scenario.part, pose=()))
    try:
        find_pair_reach(trial.work, islice(held_poses(free, trial.work, trial.motion, trial.up), POSES), collides)
    except ReachError:
        return False
    return True


def _way(work: Work) -> float:
    """Length of the way of the part's origin [m]."""
    shifts = work.way.shift(np.linspace(0.0, float(work.visits.clock[-1]), 200))
    return float(np.linalg.norm(np.diff(shifts, axis=0), axis=1).sum())
