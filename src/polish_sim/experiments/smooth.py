"""Experiment ``smooth``: one path played with every smoothing rule on the servos (paper 4, fig. 10; layer 9)."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.tracking import REFERENCE, PlayedRule, compare_tracking, measure_tracking
from polish_sim.cell import Observer, Silent
from polish_sim.cell.playback import JointTargets, Played, play_joints
from polish_sim.config import Scenario
from polish_sim.experiments.result import RunResult
from polish_sim.experiments.smooth_log import RulePlay, log_of_rules, trace_of_rule
from polish_sim.experiments.smooth_task import SmoothTask, prepare_smooth
from polish_sim.motion.joint_motion import joint_motion
from polish_sim.motion.rules.registry import RULES
from polish_sim.motion.rules.rule import Smoothed
from polish_sim.motion.smoothing.limits import SmoothingLimits
from polish_sim.motion.smoothing.sampling import sample_schedule
from polish_sim.motion.smoothing.stretch import stretched
from polish_sim.motion.timed_schedule import marks_on, places_at

Array = NDArray[np.float64]

AFTER_S = 0.2  # at the last point [s]


def run_smooth(scenario: Scenario, observer: Observer | None = None) -> RunResult:
    """Play a path with every rule on the robot's joint servos, in free space, and compare how far the joints lag.

    Args:
        scenario: Path, tolerances and limits; controller, part, pad and sensor play no role.
        observer: Told of the progress.

    Returns:
        Log of all rules at their own cycle times, figures at these and at the slowest rule's cycle time.

    Raises:
        PolishSimError: The path cannot be read, reached or smoothed.
    """
    observer = observer or Silent()
    task = prepare_smooth(scenario)
    observer.stage("smooth with every rule")
    asked = scenario.smoothing
    made = {
        name: Smoothed(*plan(task.chain, task.limits, asked.tolerance_m, asked.axis_tolerance_rad, task.arm, None))
        for name, plan in RULES.items()
    }
    observer.stage("simulate")
    started = time.perf_counter()
    own = [play_rule(scenario, task, name, smoothed) for name, smoothed in made.items()]
    slowest = max(smoothed.schedule.end for smoothed in made.values())
    even = [
        play_rule(scenario, task, name, Smoothed(chain, stretched(schedule, slowest / schedule.end)))
        for name, (chain, schedule) in made.items()
    ]
    figures: dict[str, Any] = {}
    for play, (name, smoothed) in zip(own, made.items(), strict=True):
        figures |= _named(name, "", {"cycle_time_s": smoothed.schedule.end} | _peaks_over_limits(play, task.limits))
    figures |= _compared(own, task.limits, "") | _compared(even, task.limits, "_at_equal_time")
    figures |= {"rules": list(made), "joint_jerk_limits_rad_s3": list(task.limits.joint_jerk), "equal_time_s": slowest}
    figures |= _of_run(own + even, scenario, task, time.perf_counter() - started)
    return RunResult(scenario, log_of_rules(own, scenario), trace_of_rule(own[-1]), figures, None, False)


def play_rule(scenario: Scenario, task: SmoothTask, rule: str, smoothed: Smoothed) -> RulePlay:
    """Play one rule's motion: joint angles and speeds to the servos, one pair a step.

    Args:
        scenario: The robot and its time step.
        task: The path and the robot before it.
        rule: The rule's name.
        smoothed: What it made of the path.

    Returns:
        Targets and what the joints did.
    """
    chain, schedule = smoothed
    clock = np.arange(0.0, schedule.end + AFTER_S, scenario.simulation.timestep_s)
    tool = sample_schedule(chain, schedule, clock)
    targets = joint_motion(
        tool.tips[:, 0], tool.rotations, tool.tips[:, 1:].swapaxes(0, 1), tool.spins.swapaxes(0, 1), task.arm
    )
    played: Played = play_joints(scenario, JointTargets(targets.q, targets.first))
    marks = marks_on(chain, task.chain.tips, task.chain.rotations, task.marks)
    return RulePlay(rule, clock, places_at(chain, schedule, marks, clock), targets, played)


def _peaks_over_limits(play: RulePlay, limits: SmoothingLimits) -> dict[str, float]:
    """Largest joint speed, acceleration and jerk by their limits."""
    asked = play.targets
    return {
        "joint_speed_ratio_max": float((np.abs(asked.first) / limits.joint_speed).max()),
        "joint_acceleration_ratio_max": float((np.abs(asked.second) / limits.joint_acceleration).max()),
        "joint_jerk_ratio_max": float((np.abs(asked.third) / limits.joint_jerk).max()),
    }


def _compared(plays: list[RulePlay], limits: SmoothingLimits, when: str) -> dict[str, Any]:
    """Tracking of all rules, and of all but the reference against it."""
    known = {play.rule: PlayedRule(play.rule, play.time, play.place, play.error, play.targets.third) for play in plays}
    figures: dict[str, Any] = {}
    for rule, play in known.items():
        figures |= _named(rule, when, measure_tracking(play))
        if rule != REFERENCE:
            figures |= _named(rule, when, compare_tracking(play, known[REFERENCE], np.array(limits.joint_jerk)))
    return figures


def _of_run(plays: list[RulePlay], scenario: Scenario, task: SmoothTask, wall: float) -> dict[str, Any]:
    """The figures every experiment reports."""
    simulated = sum(float(play.time[-1]) for play in plays)
    return {
        "path_done": 1.0,
        "protective_stop": None,
        "faults_missed": [],
        "T_base_work": task.arm.T_base_work.tolist(),
        "simulated_s": simulated,
        "wall_s": wall,
        "real_time_factor": simulated / wall,
        "steps": sum(len(play.time) for play in plays),
        "seed": scenario.seed,
    }


def _named(rule: str, when: str, figures: dict[str, Any]) -> dict[str, Any]:
    """Figures under names that begin with their rule's."""
    return {f"{rule.replace('-', '_')}_{name}{when}": value for name, value in figures.items()}
