"""Coulomb friction of the pad: spinning, sliding, both, and the smooth start."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.cell import RealPart
from tests.cell.fields import part_at, plane
from tests.cell.pressing import DOWN, PAD, press

DEPTH = 0.001
FORCE = 20000.0 * DEPTH  # [N]
SPIN = 6000.0 * 2.0 * math.pi / 60.0  # [rad/s]
CENTER = np.array([0.0, 0.0, -DEPTH])
STILL = replace(PAD, damping_s_m=0.0)


@pytest.fixture(scope="module")
def flat() -> RealPart:
    return part_at(plane())


def test_a_pressed_spinning_disc_feels_two_thirds_of_mu_f_r_against_its_spin(flat: RealPart) -> None:
    found = press(flat, CENTER, config=STILL, spin=SPIN)
    expected = 2.0 / 3.0 * STILL.friction * FORCE * STILL.radius_m
    spin_axis = DOWN[:, 2]
    assert found.torque @ spin_axis == pytest.approx(-expected, rel=0.01)
    np.testing.assert_allclose(found.force, [0.0, 0.0, FORCE], atol=1e-3)
    assert press(flat, CENTER, config=STILL, spin=-SPIN).torque @ spin_axis == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("direction_deg", [0.0, 30.0, 90.0, 200.0])
def test_a_sliding_disc_is_held_back_by_mu_f(flat: RealPart, direction_deg: float) -> None:
    angle = math.radians(direction_deg)
    direction = np.array([math.cos(angle), math.sin(angle), 0.0])
    found = press(flat, CENTER, config=STILL, velocity=tuple(0.5 * direction))
    np.testing.assert_allclose(
        found.force, -STILL.friction * FORCE * direction + [0.0, 0.0, FORCE], rtol=1e-3, atol=2e-3
    )
    np.testing.assert_allclose(found.torque, 0.0, atol=1e-4)


@pytest.mark.parametrize("speed", [0.0, 1e-4, 0.005, 0.02, 1.0])
def test_friction_grows_smoothly_with_the_sliding_speed(flat: RealPart, speed: float) -> None:
    found = press(flat, CENTER, config=STILL, velocity=(speed, 0.0, 0.0))
    developed = speed / math.hypot(speed, STILL.friction_smoothing_m_s)
    assert found.force[0] == pytest.approx(-STILL.friction * FORCE * developed, rel=1e-4, abs=1e-4)


def test_spinning_fast_leaves_little_friction_against_the_feed(flat: RealPart) -> None:
    """Points slide round faster than along: the drag against a feed v is mu F v / (w R)."""
    feed = 0.2
    found = press(flat, CENTER, config=replace(STILL, points=2000), velocity=(feed, 0.0, 0.0), spin=SPIN)
    assert found.force[0] == pytest.approx(-STILL.friction * FORCE * feed / (SPIN * STILL.radius_m), rel=0.02)


def test_spinning_does_not_press_even_on_a_tilted_part(flat: RealPart) -> None:
    R = Rotation.from_rotvec([0.05, 0.02, 0.0]).as_matrix() @ DOWN
    smooth = replace(PAD, friction=0.0)
    for spin in (0.0, SPIN, -SPIN):
        found = press(flat, CENTER, R, smooth, spin=spin)
        np.testing.assert_array_equal(np.concatenate(found), np.concatenate(press(flat, CENTER, R, smooth)))


def test_friction_takes_energy_out_whatever_the_motion(flat: RealPart) -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        velocity, turning = np.array([*rng.normal(size=2), 0.0]), np.array([0.0, 0.0, rng.normal()])
        found = press(flat, CENTER, config=STILL, velocity=tuple(velocity), turning=tuple(turning))
        assert found.force @ velocity + found.torque @ turning < 0.0


def test_a_heads_own_turning_about_its_axis_rubs_like_the_spindle(flat: RealPart) -> None:
    turned = press(flat, CENTER, config=STILL, turning=tuple(50.0 * DOWN[:, 2]))
    spun = press(flat, CENTER, config=STILL, spin=50.0)
    np.testing.assert_allclose(turned.torque, spun.torque, rtol=1e-12, atol=1e-12)
