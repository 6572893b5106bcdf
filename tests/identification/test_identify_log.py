"""A planted robot is recovered from its own log, in one step and in two; a log that cannot tell it is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from polish_sim.errors import IdentificationError
from polish_sim.identification.arm import LoggedRobot
from polish_sim.identification.identify import Identification, identify_from_log
from polish_sim.identification.log_file import read_robot_log, spline_states
from polish_sim.identification.regressor import States
from tests.identification.logs import first_axes_only, joined, played, slow_passes, write_log
from tests.identification.motions import SIGMA, known_robot

KNOWN = known_robot()
ROBOT = LoggedRobot(KNOWN.model, np.zeros((6, 10)))
PLANTED = KNOWN.model.truth() * np.repeat(np.linspace(0.85, 1.2, 14), [10] * 6 + [3] * 8)
MOTION = played(KNOWN.motion, 2)
PASSES = slow_passes(np.array([0.0, -1.5, 1.0, 0.5, -0.7, 0.3]), 40.0)


def _identified(folder: Path, states: States, method: str = "joint") -> Identification:
    log = read_robot_log(write_log(folder / "log.csv", KNOWN.model, states, SIGMA, PLANTED))
    return identify_from_log(ROBOT, log, spline_states(log), method)


@pytest.mark.parametrize(
    ("method", "states", "told_first"),
    [
        ("joint", MOTION, None),
        # Ten of gravity, and of each joint Coulomb and viscous friction and an offset.
        ("stepwise", joined(PASSES, MOTION), 28),
        # Fifteen rigid ones, three of each of friction, viscous friction and offsets, one rotor.
        ("stepwise-axes", joined(played(first_axes_only(KNOWN.motion), 1), MOTION), 25),
    ],
)
def test_a_planted_robot_is_recovered_from_its_log(
    method: str, states: States, told_first: int | None, tmp_path: Path
) -> None:
    found = _identified(tmp_path, states, method)
    off = (found.found.theta - KNOWN.base.combination @ PLANTED) / found.found.std
    # The rms of fifty-eight errors in their own standard deviations, plus what splines smooth away.
    assert float(np.sqrt(np.mean(off**2))) < 1.4
    # What is left of the part that was held out is its noise.
    assert max(found.figures["residual_over_noise_heldout"]) < 1.1
    assert found.figures.get("first_step_parameters") == told_first
    if told_first is not None:
        assert found.figures["stepwise_over_joint"] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("method", "said"),
    [("stepwise", "holds 0 samples in which a joint passes a pose slowly"), ("stepwise-axes", "joints 4 to 6 hold")],
)
def test_a_log_without_a_first_step_is_refused(method: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match=said):
        _identified(tmp_path, MOTION, method)


def test_a_joint_that_rests_at_the_end_of_the_log_is_named(tmp_path: Path) -> None:
    resting = KNOWN.motion.coefficients.copy()
    resting[2, 1:] = 0.0
    end = played(type(KNOWN.motion)(resting), 1)
    with pytest.raises(IdentificationError, match="no usable torque of elbow_joint"):
        _identified(tmp_path, joined(MOTION, end))
