"""What falls or springs back on the pad has no more energy after the contact than before it."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.cell import build_pad, press_pad
from polish_sim.config import PadConfig
from tests.cell.fields import part_at, plane
from tests.cell.pressing import PAD

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


def drop(config: PadConfig, text: str, seconds: float) -> Motion:
    """Let a weight with a pad beneath move under gravity and contact."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data, pad, part = mujoco.MjData(model), build_pad(config), part_at(plane())
    force, torque, rows = np.zeros(3), np.zeros(3), []
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step1(model, data)
        center, velocity = data.site("pad").xpos.copy(), np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, 0, velocity, 0)
        turning, linear = velocity[:3].copy(), velocity[3:].copy()
        R_base_pad = np.ascontiguousarray(data.site("pad").xmat.reshape(3, 3))
        press_pad(pad, part, 0.0, R_base_pad, center, linear, turning, force, torque)
        lever = center - data.body("weight").xipos
        data.body("weight").xfrc_applied = np.concatenate([force, torque + np.cross(lever, force)])
        rows.append((center[2], data.energy.sum(), force[2]))
        mujoco.mj_step2(model, data)
    return Motion(*np.array(rows).T)


def energy_at_tops(motion: Motion) -> Array:
    """Energy each time the weight stops rising, above that of rest on the surface [J].

    Only there is it free of the integrator's own O(dt v) ripple.
    """
    h = motion.height
    tops = np.flatnonzero((h[1:-1] >= h[:-2]) & (h[1:-1] > h[2:]) & (motion.force[1:-1] == 0.0)) + 1
    return motion.energy[np.concatenate([[0], tops])]


def falling(mass: float, height: float) -> str:
    return WEIGHT.format(height=height, mass=mass, joint=FREE)


@pytest.mark.parametrize(("mass", "height"), [(0.3, 0.002), (0.3, 0.02), (2.0, 0.01)])
def test_a_dropped_weight_never_bounces_with_more_energy_than_it_had(mass: float, height: float) -> None:
    motion = drop(PAD, falling(mass, height), 1.5)
    energy = energy_at_tops(motion) - mass * 9.81 * 0.02  # of rest: the centre of mass above the face
    assert np.all(energy[1:] <= 1.001 * energy[:-1])
    assert motion.force[-1] == pytest.approx(mass * 9.81, rel=1e-3)  # it came to rest, and is carried


@pytest.mark.parametrize("preload", [-0.001, 0.003])
def test_a_sprung_head_let_go_presses_and_releases_with_ever_less_energy(preload: float) -> None:
    """Weightless, released 4 mm above the part, its spring at rest ``preload`` [m] below the surface."""
    text = WEIGHT.format(
        height='0.004" gravcomp="1', mass=0.3, joint=SPRUNG.format(reference=-0.004 - preload)
    )
    motion = drop(PAD, text, 1.0)
    energy = energy_at_tops(motion)
    assert motion.force.max() > 10.0
    assert np.all(energy[1:] <= 1.001 * energy[:-1])
    rest = 20000.0 * 6666.67 / 26666.67 * max(preload, 0.0)  # head spring and pad in series
    assert motion.force[-1] == pytest.approx(rest, abs=0.02 * rest + 0.01)
