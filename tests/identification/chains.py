"""Robots for the tests of identification: the cell's own arm, and chains with slides and odd axes."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.robot_model import ARM_JOINTS, read_chain
from polish_sim.models import robot_model_path
from polish_sim.motion.serial_chain import SerialChain

ODD = """<mujoco><option gravity="1 2 -9"/><worldbody><body pos="0.1 0.2 0.3" euler="20 30 40">
  <joint name="a" axis="1 2 3" pos="0.01 0.02 0.03" damping="2" armature="0.1"/>
  <joint name="b" type="slide" axis="0.3 -1 0.2"/>
  <inertial mass="2" pos="0.1 0 0.05" fullinertia="0.05 0.06 0.04 0.001 0.002 -0.003"/>
  <body pos="0.3 0 0.1" euler="-50 10 5"><joint name="c" axis="0 1 1" ref="30"/>
    <inertial mass="1.5" pos="0 0.1 0" diaginertia="0.01 0.02 0.015"/>
    <body pos="0 0 0.2" euler="0 90 0"><inertial mass="0.5" pos="0.02 0 0" diaginertia="0.001 0.002 0.0015"/>
      <body pos="0.1 0 0"><joint name="d" axis="0 0 1" pos="0 0.1 0"/>
        <inertial mass="0.7" pos="0 0 0.1" diaginertia="0.003 0.002 0.004"/></body></body></body>
</body></worldbody></mujoco>"""


def arm_model() -> mujoco.MjModel:
    """The cell's robot, its gravity not compensated, without contacts, stops and Coulomb friction."""
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    model.body_gravcomp[:] = 0.0
    return _bare(model)


def odd_model() -> mujoco.MjModel:
    """Two joints on one body, a slide, tilted axes, a welded body, a joint that does not start at zero."""
    return _bare(mujoco.MjModel.from_xml_string(ODD))


def _bare(model: mujoco.MjModel) -> mujoco.MjModel:
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= int(off.mjDSBL_FRICTIONLOSS | off.mjDSBL_CONTACT | off.mjDSBL_LIMIT)
    return model


@cache
def arm_chain() -> SerialChain:
    """The six axes of the cell's robot, tool and head part of the last link."""
    return read_chain(arm_model(), ARM_JOINTS)


def inverse_dynamics(
    model: mujoco.MjModel, q: NDArray[np.float64], qd: NDArray[np.float64], qdd: NDArray[np.float64]
) -> NDArray[np.float64]:
    """MuJoCo's torques of the first joints; further joints stand still."""
    data, n = mujoco.MjData(model), q.shape[1]
    torques = np.empty_like(q)
    for row in range(len(q)):
        data.qpos[:n], data.qvel[:n], data.qacc[:n] = q[row], qd[row], qdd[row]
        mujoco.mj_inverse(model, data)
        torques[row] = data.qfrc_inverse[:n]
    return torques
