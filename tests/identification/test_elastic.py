"""The head of an elastic arm, as its identification knows it."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.identification.elastic import SprungHead, filtered
from polish_sim.identification.regressor import States


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
