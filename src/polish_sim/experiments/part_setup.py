"""From a part in a scenario to a part in the cell (layer 9)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell import Job, tool_on_flange
from polish_sim.config import Scenario
from polish_sim.experiments.placement import (
    Reach,
    check_whole_path,
    default_placements,
    find_reach,
    given_placement,
    tool_rotations,
)
from polish_sim.geometry import PartMesh
from polish_sim.models import workpiece_names, workpiece_path
from polish_sim.motion.trajectory import build_path_table
from polish_sim.planning.toolpath import ToolPath, pressed
from polish_sim.spatial import apply

Array = NDArray[np.float64]

SENSOR_STREAM, PART_STREAM = 0, 1


def random_streams(seed: int) -> list[np.random.Generator]:
    """Independent generators for the sensor and for the part's errors, from one seed."""
    return [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2)]


def part_file(name: str) -> Path:
    """The STL a scenario names: a shipped part by its name, anything else as a path."""
    return workpiece_path(name) if name in workpiece_names() else Path(name)


def pressing_depth(scenario: Scenario) -> float:
    """D = F / k with head spring and pad in series [m] (paper 1, section 1.5)."""
    stiffness = 1.0 / (1.0 / scenario.head.stiffness_n_m + 1.0 / scenario.pad.stiffness_n_m)
    return scenario.process.contact_force_n / stiffness


def reach_path(scenario: Scenario, mesh: PartMesh, path: ToolPath) -> Reach:
    """Place the part and check that the arm does the whole path, pressed in and lifted off.

    Raises:
        ReachError: Naming the first point that cannot be done.
    """
    positions = pressed(path, pressing_depth(scenario)).positions_work
    placements = (
        given_placement(scenario.part.pose)
        if scenario.part.pose
        else default_placements(positions, mesh.up, float((mesh.vertices @ mesh.up).min()))
    )
    T_flange_tool = tool_on_flange()
    reach = find_reach(positions, path.axes_work, placements, T_flange_tool, above_table=True)
    joints = check_whole_path(reach, positions, path.axes_work, T_flange_tool)
    return reach._replace(q_start=np.array(joints.q[0]))


def polishing_job(scenario: Scenario, path: ToolPath, reach: Reach, hold: float, lift: float) -> Job:
    """The job of pressing along a path: lead-in down to the surface, then the process path pressed in.

    Args:
        scenario: Force, feed, approach.
        path: The path, work frame, not pressed.
        reach: Placement and tool spin.
        hold: Time to stay at the end [s].
        lift: Height of the retract [m]; 0 for none.

    Returns:
        The job, in the base frame.
    """
    depth, process = pressing_depth(scenario), scenario.process
    R_base_work = reach.T_base_work[:3, :3]
    rotations = tool_rotations(path.axes_work @ R_base_work.T, reach.spin)
    first = int(np.argmax(path.process))
    on_part = np.flatnonzero(path.process)
    before = slice(0, first + 1)
    lead_in = build_path_table(apply(reach.T_base_work, path.positions_work[before]), rotations[before])
    pressed_in = apply(reach.T_base_work, pressed(path, depth).positions_work[on_part])
    table = build_path_table(
        pressed_in, rotations[on_part], path.s[on_part], path.curvature[on_part], path.pass_index[on_part]
    )
    return Job(
        lead_in=lead_in,
        process=table,
        depth=depth,
        force=process.contact_force_n,
        contact=1.0,
        approach_speed=process.approach_speed_m_s,
        feed=process.feed_m_s,
        threshold=process.contact_threshold_n,
        search_depth=process.search_depth_m,
        hold=hold,
        feed_time=process.max_feed_s or math.inf,
        lift=lift,
        start_s=float(path.s[first]),
    )
