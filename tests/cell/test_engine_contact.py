"""The engine's own contact in place of ours: does the chain of arm, head spring and sensor press with k D?"""

from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.cell.guards import NO_STOP
from polish_sim.cell.loop import advance
from polish_sim.cell.recorder import build_recorder
from polish_sim.models import robot_model_path
from tests.cell.cells import TOUCH, along_tool, cell_for, free_stroke, ideal, tool_pose

STIFFNESS = 5000.0  # of the head's spring, all there is [N/m]
HARD = [-500000.0, -1000.0]  # of the engine's contact: stiffness and damping [N/m], [N s/m]
LEANING = tool_pose(0.12, -0.45, 0.15, tilt=(0.3, -0.2, 0.5))


def scene(T_base_touch: Array, shape: str) -> mujoco.MjModel:
    """The robot with a colliding pad, over a plane or a ball touched at a tool pose."""
    spec = mujoco.MjSpec.from_file(str(robot_model_path()))
    spec.joint("head_slide").stiffness[0] = STIFFNESS
    pad = spec.geom("head_pad")
    pad.contype, pad.conaffinity, pad.solref = 2, 2, HARD
    outward = Rotation.from_matrix(T_base_touch[:3, :3] @ np.diag([1.0, -1.0, -1.0])).as_quat(
        scalar_first=True
    )
    sizes = {"plane": [0.2, 0.2, 0.01], "sphere": [0.06, 0.0, 0.0]}
    kinds = {"plane": mujoco.mjtGeom.mjGEOM_PLANE, "sphere": mujoco.mjtGeom.mjGEOM_SPHERE}
    middle = T_base_touch if shape == "plane" else along_tool(T_base_touch, z=0.06)
    spec.worldbody.add_geom(
        name="part", type=kinds[shape], size=sizes[shape], pos=middle[:3, 3], quat=outward,
        contype=2, conaffinity=2, solref=HARD,
    )  # fmt: skip
    return spec.compile()


def contact_on_part(model: Any, data: Any) -> Array:
    """Force of the pad on the part, base frame [N]."""
    total, part = np.zeros(3), model.geom("part").id
    for i, contact in enumerate(data.contact):
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, wrench)
        on_second = contact.frame.reshape(3, 3).T @ wrench[:3]
        total += on_second if contact.geom[1] == part else -on_second
    return total


@pytest.mark.parametrize(("T_base_touch", "shape"), [(TOUCH, "plane"), (LEANING, "sphere")])
def test_a_tool_moved_d_into_an_engine_primitive_presses_with_k_d(T_base_touch, shape):
    model, depth = scene(T_base_touch, shape), 0.004
    stroke = free_stroke(
        along_tool(T_base_touch, z=-0.005), along_tool(T_base_touch, z=depth), feed=0.01, hold=2.5
    )
    cell = cell_for(ideal("force", "controller.name=position"), stroke, model=model)
    steps = 3000
    advance(cell.kernel, cell.real_arm, build_recorder(steps, 4), cell.law, np.zeros((steps, 12)), steps)
    mujoco.mj_forward(model, cell.data)
    assert cell.state.status.stop == NO_STOP
    pushed = T_base_touch[:3, :3].T @ contact_on_part(model, cell.data)
    assert pushed[2] == pytest.approx(STIFFNESS * depth, rel=0.02)
    assert np.linalg.norm(pushed[:2]) < 0.02 * pushed[2]
    measured = cell.state.measurement.wrench
    np.testing.assert_allclose(measured[:3], pushed, atol=0.05)
