"""Experiment ``smooth``: one path played with every smoothing rule on the servos (paper 4, fig. 10).

Without a file it is a stand-in for the trial of paper 4: a path of 24 segments and 535 mm, its limits, and
the arm that does it. The paper's own path, its robot's dimensions and its joint limits (table 1) are lost.
Known are the number of segments, their total length, the tool's limits (the defaults of `SmoothingLimits`)
and tolerances of 0.02 mm and 0.02 deg. The stand-in has four alike arms round a dome, with turns from 30 to
90 deg both ways and legs from 15 to 30 mm.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import (
    Array,
    Figures,
    chord_lengths,
    directions_at,
    into_plane,
    norms,
    running_sums,
    unit,
)
from polish_sim.cell import SILENT, Observer, tool_on_flange
from polish_sim.cell.playback import JointTargets, PlayedBack, play_joints
from polish_sim.cell.scene import build_scene
from polish_sim.config import Checked
from polish_sim.errors import ReachError, place_in_mm
from polish_sim.exchange import read_way_points
from polish_sim.experiments.free_space import ToolMotion, free_log
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.registry import CheckedPath
from polish_sim.experiments.result import RunResult, free_figures
from polish_sim.log import PROCESS_PHASE, Trace
from polish_sim.motion import forward, track, use_arm
from polish_sim.motion.kinematics import NOMINAL, inverse_near
from polish_sim.motion.rules.chain import Chain, build_chain
from polish_sim.motion.rules.limits import ORDERS, Arm, SmoothingLimits, load_limits, six
from polish_sim.motion.rules.schedule import RULES, SmoothMotion
from polish_sim.motion.segment_rates import JointRates, sampled_joints
from polish_sim.planning.toolpath import PROCESS, ToolPath
from polish_sim.smoothing.place import place_path
from polish_sim.smoothing.tracking import REFERENCE, PlayedRule, compare_tracking, measure_tracking
from polish_sim.spatial import rotation_to_axis, transform

TRIAL_LIMITS = SmoothingLimits(joint_acceleration=six(3.0))
"""The paper's limits of the tool; of the joints such as just bind on this path, as the lost ones did on the
paper's."""

LENGTH = 0.535  #: Of the whole path [m]
DOME = 0.3  #: Radius of the dome the tool stands square to [m]
TOP = (0.45, 0.0, 0.2)  #: Its highest point in the base frame [m]
_LEGS = (30.0, 15.0, 25.0, 20.0, 18.0, 25.75)  # of one arm, as drawn [mm]
_TURNS = (60.0, -45.0, 90.0, -60.0, 75.0, -30.0)  # after each leg, 90 in all [deg]


def trial_path() -> Chain:
    """The path in the base frame, closed, on the dome, scaled to its length."""
    headings = np.radians(running_sums(np.tile(_TURNS, 4)))[:-1]
    legs = np.tile(_LEGS, 4)[:, None] * directions_at(headings)
    flat = np.concatenate([np.zeros((1, 2)), legs.cumsum(axis=0)])
    flat -= flat[:-1].mean(axis=0)
    scale = 1e-3
    for _ in range(30):
        points = _on_dome(scale * flat)
        scale *= LENGTH / chord_lengths(points).sum()
    points = _on_dome(scale * flat)
    into = -unit(points + [0.0, 0.0, DOME])
    return build_chain(points + TOP, rotation_to_axis(into, np.array([1.0, 0.0, 0.0])))


def _on_dome(flat: Array) -> Array:
    """Lift points (n, 2) onto a sphere whose top is the origin."""
    return np.column_stack([flat, np.sqrt(DOME**2 - np.sum(flat**2, axis=1)) - DOME])


AFTER_S = 0.2  #: Time at the last point [s]
_NEAR = np.array([2.6, -1.6, 1.8, -1.6, -1.4, -2.1])  # elbow up, the spindle clear of the arm [rad]


class SmoothTask(NamedTuple):
    """A path, the robot before it, and how fast both may move."""

    chain: Chain  #: Way points as given, in the arm's work frame
    marks: Array  #: Arc length at the way points [m], shape (segments + 1,)
    arm: Arm
    limits: SmoothingLimits


def prepare_smooth(scenario: Checked) -> SmoothTask:
    """Take the scenario's path, or that of the paper's trial, and lay it before the robot."""
    use_arm(scenario.robot.arm)
    file = scenario.smoothing.limits_file
    limits = load_limits(Path(file), TRIAL_LIMITS) if file else TRIAL_LIMITS
    if scenario.plan.file:
        placed = place_path(read_way_points(Path(scenario.plan.file)), scenario.part.pose)
        assert placed.arm is not None  # place_path lays every path before the robot
        chain, arm = placed.chain, placed.arm
    else:
        chain, T_flange_tool = trial_path(), tool_on_flange()
        first = transform(chain.rotations[0], chain.tips[0]) @ np.linalg.inv(T_flange_tool)
        arm = Arm(np.eye(4), T_flange_tool, inverse_near(first, _NEAR))
    # A turn on the spot counts as a nanometre, so that marks rise.
    return SmoothTask(chain, running_sums(np.maximum(chain.lengths, 1e-9)), arm, limits)


def check_smooth(scenario: Checked, observer: Observer = SILENT) -> CheckedPath:
    """The path of a run, work frame, and how the arm reaches all of it; PolishSimError if it does not."""
    task = prepare_smooth(scenario)
    chain = task.chain
    arm = task.arm
    n = len(task.chain.tips)
    joints = track(arm.T_base_work @ transform(chain.rotations, chain.tips), arm.T_flange_tool, arm.q_start)
    if joints.first_unreachable is not None:
        place = place_in_mm(chain.tips[joints.first_unreachable])
        raise ReachError(f"the robot cannot be at {place} of the path. Move it with --part-pose.")
    path = ToolPath(
        chain.tips, -chain.axes, task.marks, np.zeros(n, np.int64), np.full(n, PROCESS, np.int8), np.zeros(n)
    )
    return CheckedPath(
        path,
        Reach(
            arm.T_base_work,
            arm.T_base_work[:3, :3] @ chain.rotations[0, :, 0],
            arm.q_start,
            joints.smallest_singular_value,
        ),
    )


class RulePlay(NamedTuple):
    """A path played with one rule, one row a step of the simulation."""

    seen: PlayedRule  #: What rules are compared by
    targets: JointRates
    played: PlayedBack


def trace_of_rule(play: RulePlay) -> Trace:
    """The exact trace of one rule, with no contact."""
    tool = _motion(play, 1)
    time = play.seen.time
    off = tool.wanted - tool.tips
    axes = tool.wanted_frames[:, :, 2]
    across = into_plane(off, axes)
    return tool.trace(time, np.full(len(time), PROCESS_PHASE), play.seen.place, across)


def _columns(play: RulePlay, number: int, every: int, real: bool) -> dict[str, Array]:
    """Columns of the log."""
    time = play.seen.time[::every]
    played = play.played
    targets = play.targets
    read = {"encoder_q_rad": played.read[::every]} if real else {}
    return {
        "time_s": time,
        "q_rad": played.q[::every],
        "qd_rad_s": played.qd[::every],
        "torque_nm": played.torque[::every],
        **_motion(play, every).columns(),
        "path_s_m": play.seen.place[::every],
        "phase": np.full(len(time), float(PROCESS_PHASE)),
        "rule": np.full(len(time), float(number)),
        "target_q_rad": targets.q[::every],
        "target_qd_rad_s": targets.first[::every],
        "target_qdd_rad_s2": targets.second[::every],
        "target_qddd_rad_s3": targets.third[::every],
        **read,
    }


def _motion(play: RulePlay, every: int) -> ToolMotion:
    tips, frames = _tool(play.played.q[::every], play.played.table)
    speed = norms(np.gradient(tips, play.seen.time[::every], axis=0))
    return ToolMotion(tips, frames, speed, *_tool(play.targets.q[::every]))


def _tool(q: Array, table: Array = NOMINAL) -> tuple[Array, Array]:
    """Tool points (n, 3) [m] and frames (n, 3, 3) of joint angles (n, 6)."""
    T_base_tool = forward(q, table) @ tool_on_flange()
    return T_base_tool[:, :3, 3], T_base_tool[:, :3, :3]


def run_smooth(scenario: Checked, observer: Observer = SILENT) -> RunResult:
    """Play a path with every rule on the robot's joint servos, in free space, and compare how far the joints
    lag.

    Returns a log of all rules at their own cycle times, figures at these and at the slowest rule's cycle
    time. Controller, part, pad and sensor play no role. Raises PolishSimError if the path cannot be read,
    reached or smoothed.
    """
    task = prepare_smooth(scenario)
    observer.stage("smooth with every rule")
    asked = scenario.smoothing
    made = {
        name: plan(task.chain, task.limits, asked.tolerance_m, asked.axis_tolerance_rad, task.arm, None)
        for name, plan in RULES.items()
    }
    observer.stage("simulate")
    started = time.perf_counter()

    def by_rule(rule: str, motion: SmoothMotion) -> RulePlay:
        """Joint angles and speeds to the servos, one pair a step."""
        clock = np.arange(0.0, motion.end + AFTER_S, scenario.simulation.timestep_s)
        targets = sampled_joints(motion.sample(clock), task.arm)
        played = play_joints(
            build_scene(scenario), scenario.robot, scenario.seed, JointTargets(targets.q, targets.first)
        )
        return RulePlay(
            PlayedRule(
                rule, clock, motion.places_at(task.marks, clock)[0], targets.q - played.read, targets.third
            ),
            targets,
            played,
        )

    own = [by_rule(name, motion) for name, motion in made.items()]
    slowest = max(motion.end for motion in made.values())
    even = [by_rule(name, motion.stretched(slowest / motion.end)) for name, motion in made.items()]
    figures: Figures = {}
    for play, (name, motion) in zip(own, made.items(), strict=True):
        peaks = {
            f"joint_{order}_ratio_max": (np.abs(rate) / limit).max()
            for order, rate, limit in zip(ORDERS, play.targets[1:], task.limits.table[:, 2:], strict=True)
        }
        figures |= _named(name, "", {"cycle_time_s": motion.end} | peaks)
    for plays, when in ((own, ""), (even, "_at_equal_time")):
        figures |= _compared({play.seen.rule: play.seen for play in plays}, task.limits, when)
    figures |= {
        "rules": list(made),
        "joint_jerk_limits_rad_s3": list(task.limits.joint_jerk),
        "equal_time_s": slowest,
    }
    plays = own + even
    wall = time.perf_counter() - started
    simulated = sum(play.seen.time[-1] for play in plays)
    steps = sum(len(play.seen.time) for play in plays)
    figures |= free_figures(scenario.seed, task.arm.T_base_work, steps, simulated, wall)
    return RunResult(scenario, free_log(scenario, own, _columns), trace_of_rule(own[-1]), figures)


def _compared(known: dict[str, PlayedRule], limits: SmoothingLimits, when: str) -> Figures:
    """Tracking of all rules, and of all but the reference against it."""
    figures: Figures = {}
    for rule, play in known.items():
        figures |= _named(rule, when, measure_tracking(play))
        if rule != REFERENCE:
            figures |= _named(
                rule, when, compare_tracking(play, known[REFERENCE], np.array(limits.joint_jerk))
            )
    return figures


def _named(rule: str, when: str, figures: Figures) -> Figures:
    """Figures under names that begin with their rule's."""
    return {f"{rule.replace('-', '_')}_{name}{when}": value for name, value in figures.items()}
