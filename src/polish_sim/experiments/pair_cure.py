"""Where two robots may hold a part, and what would do where they cannot do their work (layer 9)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import Scenario
from polish_sim.errors import ReachError
from polish_sim.experiments.master_motion import MasterMotion, master_motion
from polish_sim.experiments.pair_placement import Collides, Work, default_poses, find_pair_reach
from polish_sim.experiments.placement import given_placement
from polish_sim.planning import ToolPath
from polish_sim.spatial import from_pose

Array = NDArray[np.float64]

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
