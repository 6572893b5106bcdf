"""The arm of paper 4's trial path with a tool of 150 mm along the flange's axis: rules are compared on it."""

import numpy as np

from polish_sim.motion.kinematics import inverse_near
from polish_sim.motion.rules.limits import Arm
from polish_sim.smoothing.smooth import trial_path
from polish_sim.spatial import transform

_TOOL = transform(np.eye(3), np.array([0.0, 0.0, 0.15]))
_NEAR = np.array([0.0, -2.0, 2.0, -1.6, -1.6, 0.0])


def trial_arm() -> Arm:
    """The path is given in its base frame."""
    path = trial_path()
    first = transform(path.rotations[0], path.tips[0]) @ np.linalg.inv(_TOOL)
    return Arm(np.eye(4), _TOOL, inverse_near(first, _NEAR))
