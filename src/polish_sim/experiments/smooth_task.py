"""What `run smooth` plays: a path before the robot and the limits of its motion (layer 9)."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell import tool_on_flange
from polish_sim.config import Scenario
from polish_sim.errors import ReachError, place_in_mm
from polish_sim.exchange import read_way_points
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.smoothing_place import place_path
from polish_sim.motion import inverse_near, track
from polish_sim.motion.rules.trial import TRIAL_LIMITS, trial_path
from polish_sim.motion.smoothing.arm import Arm, build_arm
from polish_sim.motion.smoothing.build import build_chain
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.limits import SmoothingLimits
from polish_sim.motion.smoothing.limits_file import load_limits
from polish_sim.planning.toolpath import PROCESS, ToolPath
from polish_sim.spatial import transform

Array = NDArray[np.float64]

_NEAR = np.array([2.6, -1.6, 1.8, -1.6, -1.4, -2.1])  # elbow up, the spindle clear of the arm [rad]


class SmoothTask(NamedTuple):
    """A path, the robot before it, and how fast both may move."""

    chain: Chain
    """Way points as they are given, in the frame ``arm`` says."""
    marks: Array
    """Arc length at the way points [m], shape (segments + 1,)."""
    arm: Arm
    limits: SmoothingLimits


def prepare_smooth(scenario: Scenario) -> SmoothTask:
    """Take the scenario's path, or that of the paper's trial, and lay it before the robot.

    Raises:
        PolishSimError: The path cannot be read, reached or smoothed.
    """
    file = scenario.smoothing.limits_file
    limits = load_limits(Path(file), TRIAL_LIMITS) if file else TRIAL_LIMITS
    chain, arm = _given(scenario) if scenario.plan.file else _trial()
    return SmoothTask(chain, marks_along(chain), arm, limits)


class TaskPath(NamedTuple):
    """A task's path and the way the arm does it, as the other experiments tell theirs."""

    path: ToolPath
    reach: Reach


def path_of_task(task: SmoothTask) -> TaskPath:
    """The path of a task, work frame, and its reach.

    Raises:
        ReachError: A way point cannot be reached.
    """
    chain, arm, n = task.chain, task.arm, len(task.chain.tips)
    joints = track(arm.T_base_work @ transform(chain.rotations, chain.tips), arm.T_flange_tool, arm.q_start)
    path = ToolPath(
        chain.tips, -chain.axes, task.marks, np.zeros(n, np.int64), np.full(n, PROCESS, np.int8), np.zeros(n)
    )
    if joints.first_unreachable is not None:
        place = place_in_mm(chain.tips[joints.first_unreachable])
        raise ReachError(f"the robot cannot be at {place} of the path. Move it with --part-pose.")
    return TaskPath(path, Reach(arm.T_base_work, 0.0, arm.q_start, joints.smallest_singular_value))


def marks_along(chain: Chain) -> Array:
    """Arc length of a chain's way points; a turn on the spot counts as a nanometre, so that marks rise."""
    return np.concatenate([[0.0], np.cumsum(np.maximum(chain.lengths, 1e-9))])


def _given(scenario: Scenario) -> tuple[Chain, Arm]:
    placed = place_path(read_way_points(Path(scenario.plan.file)), None, scenario.part.pose)
    assert placed.arm is not None  # place_path lays every path before the robot
    return placed.chain, placed.arm


def _trial() -> tuple[Chain, Arm]:
    path, T_flange_tool = trial_path(), tool_on_flange()
    first = transform(path.rotations[0], path.tips[0]) @ np.linalg.inv(T_flange_tool)
    return build_chain(path.tips, path.rotations), build_arm(np.eye(4), T_flange_tool, inverse_near(first, _NEAR))
