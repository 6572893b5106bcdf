"""What falls or springs back on the pad has no more energy after the contact than before it."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
import pytest

from polish_sim.cell import RealPart, build_pad, press_pad
from polish_sim.config import PadConfig
from tests.cell.fields import part_at, plane
from tests.cell.pressing import ELASTIC, PAD, Array

WEIGHT = """
<mujoco>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="weight" pos="0 0 {height}">
      {joint}
      <inertial pos="0 0 0.02" mass="{mass}" diaginertia="0.002 0.002 0.003"/>
      <site name="pad" euler="180 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""
FREE = "<freejoint/>"
SPRUNG = '<joint type="slide" axis="0 0 1" stiffness="6666.67" springref="{reference}"/>'


class Motion(NamedTuple):
    """What happened to the weight."""

    height: Array  #: Of the pad's face above the part [m], shape (n,)
    energy: Array  #: Kinetic, of weight and of the joint's spring, not the pad's [J], shape (n,)
    force: Array  #: Of contact along z [N], shape (n,)


@pytest.fixture(scope="module")
def flat() -> RealPart:
    return part_at(plane())


def drop(part: RealPart, config: PadConfig, text: str, seconds: float, stale: bool = False) -> Motion:
    """Let a weight with a pad beneath move under gravity and contact.

    ``stale``: contact is taken after a whole step, when poses are a step older than velocities.
    """
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data, pad = mujoco.MjData(model), build_pad(config)
    force, torque, rows = np.zeros(3), np.zeros(3), []
    for _ in range(round(seconds / model.opt.timestep)):
        if stale:
            mujoco.mj_step(model, data)
        else:
            mujoco.mj_step1(model, data)
        center, velocity = data.site("pad").xpos, np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, 0, velocity, 0)
        linear = data.qvel[:3].copy() if stale else velocity[3:].copy()
        R_base_pad = np.ascontiguousarray(data.site("pad").xmat.reshape(3, 3))
        press_pad(pad, part, 0.0, R_base_pad, center.copy(), linear, velocity[:3].copy(), force, torque)
        lever = center - data.body("weight").xipos
        data.body("weight").xfrc_applied = np.concatenate([force, torque + np.cross(lever, force)])
        rows.append((center[2], data.energy.sum(), force[2]))
        if not stale:
            mujoco.mj_step2(model, data)
    return Motion(*np.array(rows).T)


def energy_at_tops(motion: Motion) -> Array:
    """Energy each time the weight stops rising, above that of rest on the surface [J].

    Only there is it free of the integrator's own O(dt v) ripple.
    """
    h = motion.height
    tops = np.flatnonzero((h[1:-1] >= h[:-2]) & (h[1:-1] > h[2:]) & (motion.force[1:-1] == 0.0)) + 1
    return motion.energy[np.concatenate([[0], tops])]


@pytest.mark.parametrize("mass", [0.5, 2.0, 5.0])
def test_a_weight_at_rest_on_the_pad_is_carried_by_a_force_equal_to_it(flat: RealPart, mass: float) -> None:
    text = WEIGHT.format(height=0.0, mass=mass, joint=FREE)
    motion = drop(flat, PAD, text, 1.5)
    assert motion.force[-1] == pytest.approx(mass * 9.81, rel=1e-3)
    assert motion.height[-1] == pytest.approx(-mass * 9.81 / 20000.0, rel=1e-3)


def falling(mass: float, height: float) -> str:
    return WEIGHT.format(height=height, mass=mass, joint=FREE)


def rest_energy(mass: float) -> float:
    return mass * 9.81 * 0.02  # of the centre of mass above the face


@pytest.mark.parametrize("height", [0.002, 0.01, 0.02])
@pytest.mark.parametrize("mass", [0.3, 2.0])
def test_a_dropped_weight_never_bounces_with_more_energy_than_it_had(
    flat: RealPart, mass: float, height: float
) -> None:
    motion = drop(flat, PAD, falling(mass, height), 1.0)
    energy = energy_at_tops(motion) - rest_energy(mass)
    assert np.all(energy[1:] <= 1.001 * energy[:-1])
    assert motion.force[-100:] == pytest.approx(mass * 9.81, rel=0.05)  # it came to rest


@pytest.mark.parametrize("mass", [0.3, 2.0])
def test_without_damping_and_friction_the_pad_gives_back_what_it_took(flat: RealPart, mass: float) -> None:
    motion = drop(flat, ELASTIC, falling(mass, 0.01), 1.5)
    energy = energy_at_tops(motion) - rest_energy(mass)
    assert len(energy) > 4
    np.testing.assert_allclose(energy, mass * 9.81 * 0.01, rtol=0.03)


def test_contact_from_poses_a_step_old_would_feed_energy_in(flat: RealPart) -> None:
    """Why the loop steps in two halves: after a whole step poses are older than velocities."""
    motion = drop(flat, ELASTIC, falling(0.3, 0.002), 1.0, stale=True)
    energy = energy_at_tops(motion) - rest_energy(0.3)
    assert energy[3] > 3.0 * energy[0]


@pytest.mark.parametrize("preload", [-0.001, 0.0, 0.001, 0.003])
def test_a_sprung_head_let_go_presses_and_releases_with_ever_less_energy(flat: RealPart, preload: float) -> None:
    """Weightless, let go 4 mm above the part, its spring at rest ``preload`` [m] below the surface."""
    text = WEIGHT.format(height='0.004" gravcomp="1', mass=0.3, joint=SPRUNG.format(reference=-0.004 - preload))
    motion = drop(flat, PAD, text, 1.0)
    energy = energy_at_tops(motion)
    assert motion.force.max() > 10.0
    assert np.all(energy[1:] <= 1.001 * energy[:-1])
    rest = 20000.0 * 6666.67 / 26666.67 * max(preload, 0.0)  # head spring and pad in series
    assert motion.force[-1] == pytest.approx(rest, abs=0.02 * rest + 0.01)
