"""How the master moves the part while the follower works: along, about an axis, or as a file says (layer 9)."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import DualConfig, Scenario
from polish_sim.errors import ConfigError
from polish_sim.experiments.master_path import MasterPath, read_master_path
from polish_sim.motion.coordination import Chain2, PartWay, about_axis, along_arc, through_poses
from polish_sim.planning import ToolPath

Array = NDArray[np.float64]

WITHOUT_FILE: Final = (
    "master_speed_m_s", "master_direction", "master_arc_radius_m", "master_turn_rad_s", "master_axis", "master_center",
)  # fmt: skip
"""Settings of section dual that say how the part moves where no file does."""


class MasterMotion(NamedTuple):
    """What is asked of the master."""

    way: PartWay
    file: MasterPath | None = None
    """Where it comes from, if from a file."""
    T_start: Array = np.empty((0, 4, 4))
    """Where a file says the part is held at the start, base of the master, shape (1, 4, 4)."""


def master_motion(scenario: Scenario, path: ToolPath, up: Array, chain: Chain2) -> MasterMotion:
    """The motion a scenario asks for.

    Args:
        scenario: The scenario.
        path: What the follower does on the part.
        up: Side of the part that is worked on, work frame, shape (3,).
        chain: What the host believes of gripper and part.

    Raises:
        ConfigError: A direction is none, two settings say where the part is held, or how it moves.
        InputError: The file cannot be used.
    """
    config = scenario.dual
    if config.master_path:
        _refuse_beside_file(config)
        if scenario.part.pose:
            raise ConfigError(
                f"'{config.master_path}' (dual.master_path) says where the part is held: leave part.pose "
                "(--part-pose) out."
            )
        file = read_master_path(Path(config.master_path))
        poses = file.part_poses(chain)
        return MasterMotion(through_poses(file.times, poses), file, poses[:1])
    axis = _unit(config.master_axis, "dual.master_axis") if config.master_axis else up / np.linalg.norm(up)
    center = np.array(config.master_center) if config.master_center else middle_of(path)
    turn = about_axis(axis, center, config.master_turn_rad_s)
    return MasterMotion(PartWay(along_arc(*_speed_and_bend(config)), turn))


def _refuse_beside_file(config: DualConfig) -> None:
    """Refuse settings of a motion that a file says all of."""
    usual = DualConfig()
    idle = [name for name in WITHOUT_FILE if getattr(config, name) != getattr(usual, name)]
    if idle:
        raise ConfigError(
            f"'{config.master_path}' (dual.master_path) says how the part moves: leave "
            f"{', '.join(f'dual.{name}' for name in idle)} out."
        )


def middle_of(path: ToolPath) -> Array:
    """The middle of what is worked on, every millimetre of it counted alike, work frame [m], shape (3,)."""
    ends = path.process[1:] & path.process[:-1]
    between = 0.5 * (path.positions_work[1:] + path.positions_work[:-1])[ends]
    return np.asarray(np.average(between, axis=0, weights=np.diff(path.s)[ends]))


def _speed_and_bend(config: DualConfig) -> tuple[Array, float]:
    """Velocity at the start [m/s], (3,), and how fast its direction turns [rad/s]."""
    velocity = config.master_speed_m_s * _unit(config.master_direction, "dual.master_direction")
    level, radius = float(np.linalg.norm(velocity[:2])), config.master_arc_radius_m
    if radius != 0.0 and not level > 0.0:
        raise ConfigError(
            f"dual.master_arc_radius_m = {radius:g} bends a way that is level; dual.master_direction is vertical, or "
            "dual.master_speed_m_s is 0. Set them, or leave the radius out."
        )
    return velocity, level / radius if radius else 0.0


def _unit(direction: tuple[float, ...], name: str) -> Array:
    size = float(np.linalg.norm(direction)) if len(direction) else 0.0
    if not size > 0.0:
        raise ConfigError(f"'{name}' is no direction: give x, y, z, not all zero.")
    return np.asarray(np.array(direction) / size)
