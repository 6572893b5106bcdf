"""The robot a log is from: the cell's own arm, or any serial chain of a MJCF (layer 9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.identified_model import read_robot_model
from polish_sim.cell.serial_chain import own_parameters, read_chain
from polish_sim.errors import InputError
from polish_sim.experiments.identified_arm import build_arm
from polish_sim.identification.torque_model import FULL, TorqueModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LoggedRobot:
    """What is known of a robot beforehand."""

    model: TorqueModel
    """With the parameters of its drawing."""
    carried: Array
    """Part of the links that is known and stays: what is welded to them, shape (n, 10)."""
    file: Path | None = None
    """Its MJCF; None for the cell's arm."""


def cell_arm(terms: tuple[str, ...] = FULL) -> LoggedRobot:
    """The cell's UR5e with sensor, spindle and head."""
    arm = build_arm(terms)
    return LoggedRobot(arm.truth, arm.carried)


def robot_of_file(file: Path, joints: Sequence[str] | None = None, terms: tuple[str, ...] = FULL) -> LoggedRobot:
    """A robot of a user's own MJCF.

    Args:
        file: The model.
        joints: Joints of the chain in their order; others are held where the model starts. All joints if None.
        terms: Terms of the torque model.

    Raises:
        InputError: The file is no model, or what it holds is no serial chain of hinges and slides; names the joint.
    """
    compiled = read_robot_model(file)
    try:
        chain = read_chain(compiled, joints)
        own = own_parameters(compiled, chain.joints)
    except InputError as error:
        raise InputError(f"'{file}': {error}") from None
    return LoggedRobot(TorqueModel(chain, terms), chain.parameters - own, file)
