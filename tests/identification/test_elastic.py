"""Elastic arms identified as they are: planted gears, friction by load and links come back."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.config import RobotConfig
from polish_sim.identification.elastic import SprungHead, filtered
from polish_sim.identification.identify import Identification, run_identification
from polish_sim.identification.regressor import States
from polish_sim.identification.settings import IdentifySettings


@pytest.fixture(scope="module")
def identified() -> Identification:
    return run_identification(
        IdentifySettings(periods=2, iterations=15, robot=RobotConfig(arm="ur5e"), seed=540)
    )


def test_torques_of_an_elastic_arm_are_predicted_from_both_sides_of_its_gears(
    identified: Identification,
) -> None:
    assert identified.figures["nrms_heldout_mean"] < 0.006
    assert identified.figures["nrms_heldout_drawing_mean"] > 4.0 * identified.figures["nrms_heldout_mean"]


def test_links_are_not_taken_for_friction(identified: Identification) -> None:
    assert float(np.mean(identified.figures["nrms_rigid"])) < 0.01


def test_friction_by_load_is_found_driving_and_driven(identified: Identification) -> None:
    assert identified.gears is not None
    loads, std = (np.array(identified.figures[key]) for key in ("friction_by_load", "friction_by_load_std"))
    off = loads - identified.gears.true_loads()
    assert np.all(np.abs(off[:5]) < 0.03)
    assert np.sqrt(np.mean((off / std) ** 2)) < 3.0


def test_most_intervals_hold(identified: Identification) -> None:
    assert identified.figures["interval_coverage"] > 0.85


def test_a_head_on_its_spring_follows_a_slow_arm_and_leaves_a_quick_one() -> None:
    head, dt = SprungHead(0.3, 20_000 / 3, 60.0, np.array([0.0, 0.0, 0.175])), 1e-3
    t = np.arange(4000) * dt
    torques = {}
    for hz in (0.5, 150.0):
        q = np.tile([0.3, -1.2, 1.0, -1.4, -1.5, 0.2], (len(t), 1))
        q[:, 1] += 1e-4 * np.sin(2.0 * np.pi * hz * t)
        states = States(q, filtered(q, dt, 400.0, 1), filtered(q, dt, 400.0, 2))
        torques[hz] = head.torques(states, dt, 400.0)[:, 1] / np.ptp(states.qdd[:, 1])
    assert np.ptp(torques[0.5]) < 1e-3 * np.ptp(torques[150.0])
    # Far above its resonance the head stands still, but for its damper: what a rigid link would push is taken
    # off.
    w = 2.0 * np.pi * 150.0
    lag = np.angle(w**2 - head.stiffness / head.mass - 1j * w * head.damping / head.mass)
    assert np.corrcoef(torques[150.0], -states.qdd[:, 1])[0, 1] == pytest.approx(np.cos(lag), abs=2e-3)
