"""What a writer must know beside the plan: process, robot tool, place of the part (configuration -> writers)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from polish_sim.arrays import Array
from polish_sim.config import ProcessConfig, SpindleConfig
from polish_sim.errors import InputError
from polish_sim.planning.toolpath import LEAD_IN, LEAD_OUT, ToolPath


@dataclass(frozen=True)
class RobotTool:
    """The tool as a robot controller needs it; the defaults are the shipped cell's (models/README.md)."""

    tcp_pose: tuple[float, ...] = (0.0, 0.0, 0.22, 0.0, 0.0, 0.0)
    """Middle of the pad's face in the flange: x, y, z [m], rotation vector [rad]; z points into the part."""
    payload_kg: float = 2.0  #: Mass of everything behind the flange [kg]
    payload_center_m: tuple[float, float, float] = (0.002, 0.0, 0.0974)  #: Its centre in the flange frame [m]
    spindle_output: int = 0  #: Standard digital output that switches the spindle
    spindle_wait_s: float = 2.0  #: Time the spindle takes to come up to speed [s]


@dataclass(frozen=True)
class ExportSetup:
    """What the writers take beside the plan."""

    process: ProcessConfig = field(default_factory=ProcessConfig)
    spindle: SpindleConfig = field(default_factory=SpindleConfig)
    tool: RobotTool = field(default_factory=RobotTool)
    part_pose: tuple[float, ...] = ()
    """Pose of the work frame in the robot's base: x, y, z [m], rotation vector [rad]; empty = not known yet."""
    frame_id: str = "work"  #: Name of the work frame in ROS

    def __post_init__(self) -> None:
        for name, pose in (("part_pose", self.part_pose), ("tool.tcp_pose", self.tool.tcp_pose)):
            if len(pose) not in ((0, 6) if name == "part_pose" else (6,)) or not np.isfinite(pose).all():
                raise InputError(f"{name} {tuple(pose)} is no pose: wanted x, y, z [m] and a rotation vector [rad].")


def feeds_of(path: ToolPath, setup: ExportSetup) -> Array:
    """Feed at every point [m/s], shape (n,): the path's own, else the process's, at leads the approach speed."""
    if path.feed is not None:
        return path.feed
    leads = (path.segment == LEAD_IN) | (path.segment == LEAD_OUT)
    return np.where(leads, setup.process.approach_speed_m_s, setup.process.feed_m_s)


def forces_of(path: ToolPath, setup: ExportSetup) -> Array:
    """Contact force at every point [N], shape (n,): the path's own, else the process's."""
    return path.force if path.force is not None else np.full(len(path.s), setup.process.contact_force_n)
