"""The trial of paper 4, as far as it is known: a path of 24 segments and 535 mm, its limits, and the arm that
does it.

The paper's own path, its robot's dimensions and its joint limits (table 1) are lost. Known are the number of
segments, their total length, the tool's limits (the defaults of `SmoothingLimits`) and tolerances of 0.02 mm
and 0.02 deg. This path stands in for it: four alike arms round a dome, with turns from 30 to 90 deg both ways
and legs from 15 to 30 mm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.motion.kinematics import inverse_near
from polish_sim.motion.rules.limits import Arm, SmoothingLimits, build_arm, six
from polish_sim.spatial import rotation_to_axis, transform, unit

TRIAL_LIMITS = SmoothingLimits(joint_acceleration=six(3.0))
"""The paper's limits of the tool; of the joints such as just bind on this path, as the lost ones did on the
paper's."""

LENGTH = 0.535  #: Of the whole path [m]
DOME = 0.3  #: Radius of the dome the tool stands square to [m]
TOP = (0.45, 0.0, 0.2)  #: Its highest point in the base frame [m]
_LEGS = (30.0, 15.0, 25.0, 20.0, 18.0, 25.75)  # of one arm, as drawn [mm]
_TURNS = (60.0, -45.0, 90.0, -60.0, 75.0, -30.0)  # after each leg, 90 in all [deg]
_TOOL = transform(np.eye(3), np.array([0.0, 0.0, 0.15]))
_HOME = np.array([0.0, -2.0, 2.0, -1.6, -1.6, 0.0])


class TrialPath(NamedTuple):
    """Way points in the base frame."""

    tips: Array  #: [m], shape (25, 3)
    rotations: Array  #: R_base_tool, z into the part, shape (25, 3, 3)


def trial_path() -> TrialPath:
    """The path, closed, on the dome, scaled to its length."""
    headings = np.radians(np.cumsum(np.concatenate([[0.0], np.tile(_TURNS, 4)])))[:-1]
    legs = np.tile(_LEGS, 4)[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    flat = np.concatenate([np.zeros((1, 2)), np.cumsum(legs, axis=0)])
    flat -= flat[:-1].mean(axis=0)
    scale = 1e-3
    for _ in range(30):
        points = _on_dome(scale * flat)
        scale *= LENGTH / float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    points = _on_dome(scale * flat)
    into = -unit(points + [0.0, 0.0, DOME])
    return TrialPath(points + TOP, rotation_to_axis(into, np.array([1.0, 0.0, 0.0])))


def _on_dome(flat: Array) -> Array:
    """Lift points (n, 2) onto a sphere whose top is the origin."""
    return np.column_stack([flat, np.sqrt(DOME**2 - np.sum(flat**2, axis=1)) - DOME])


def trial_arm(T_flange_tool: Array = _TOOL, q_near: Array = _HOME) -> Arm:
    """An arm with a tool, by default of 150 mm along the flange's axis, the path given in its base frame.

    ``q_near`` (6,) [rad] says the configuration it begins in.
    """
    path = trial_path()
    first = transform(path.rotations[0], path.tips[0]) @ np.linalg.inv(T_flange_tool)
    return build_arm(np.eye(4), T_flange_tool, inverse_near(first, q_near))
