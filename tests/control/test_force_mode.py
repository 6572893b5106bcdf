"""The law of force-mode has the response its equation has; everything but tool z is as in hybrid-pi."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.control.signals import Measurement, Target
from tests.control.signals import (
    CONFIG,
    controller,
    measurement_at_rest,
    measurement_from,
    target_near,
    target_to_press,
)


def pressing(force: float = 0.0, speed: float = 0.0) -> tuple[Measurement, Target]:
    """A tool at rest on its target, z along base z, wanted to press with 20 N."""
    m = measurement_at_rest()
    m.wrench[2], m.twist[2] = force, speed
    return m, target_to_press(contact=1.0)


def speeds(damping: float, force: float, speed: float, count: int = 20) -> Array:
    """Speed along tool z at every step while the reading stays at a force [N] and the tool is held in
    place, no speed limit in the way."""
    baselines = replace(CONFIG.baselines, mode_damping=damping)
    law = controller("force-mode", replace(CONFIG, force_limit_m_s=1.0, baselines=baselines))
    m, t = pressing(force, speed)
    return np.array([law.step(m, t)[2] for _ in range(count)])


def test_force_mode_answers_every_second_millisecond_and_loses_the_damping_s_share_of_its_speed() -> None:
    answer = speeds(0.0, force=15.0, speed=0.0)
    np.testing.assert_array_equal(answer[1::2][:-1], answer[2::2])
    mass = CONFIG.baselines.mode_mass_kg / CONFIG.baselines.mode_gain_scaling
    np.testing.assert_allclose(np.diff(answer[1::2]), 5.0 / mass * 0.002)
    np.testing.assert_allclose(speeds(0.0, force=20.0, speed=0.01), 0.01)
    slower = speeds(0.3, force=20.0, speed=0.01)
    np.testing.assert_allclose(slower[1::2], 0.01 * 0.7 ** np.arange(1, 11))


@pytest.mark.parametrize("speed", [-0.02, 0.02])
def test_force_control_begins_at_the_speed_the_tool_has(speed: float) -> None:
    law, (m, t) = controller("force-mode"), pressing(20.0, speed)
    assert law.step(m, t)[2] == pytest.approx(speed, rel=0.08)


def test_the_speed_stays_within_its_limit_and_does_not_wind_up() -> None:
    law, (m, t) = controller("force-mode"), pressing(-500.0)
    pushed = [law.step(m, t)[2] for _ in range(500)]
    assert max(pushed) == pytest.approx(CONFIG.force_limit_m_s)
    m.wrench[2] = 520.0
    back = np.array([law.step(m, t)[2] for _ in range(100)])
    assert (back < 0.0).argmax() < 20


def test_everything_but_tool_z_is_as_in_hybrid_pi() -> None:
    rng = np.random.default_rng(0)
    m = measurement_from(rng)
    for contact in (0.0, 1.0):
        t = target_near(m, rng, contact)
        ours, hybrid = controller("force-mode").step(m, t), controller("hybrid-pi").step(m, t)
        across = np.eye(3) - np.outer(m.rotation[:, 2], m.rotation[:, 2]) * contact
        np.testing.assert_allclose(across @ ours[:3], across @ hybrid[:3], atol=1e-12)
        np.testing.assert_array_equal(ours[3:], hybrid[3:])


def test_a_second_contact_begins_afresh() -> None:
    law, (m, t) = controller("force-mode"), pressing(0.0)
    first = [law.step(m, t)[2] for _ in range(100)]
    t.contact = False
    law.step(m, t)
    t.contact = True
    np.testing.assert_allclose([law.step(m, t)[2] for _ in range(100)], first, atol=1e-12)
