"""What writers are told beside the plan is true of the shipped cell, or refused."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from polish_sim.errors import InputError
from polish_sim.exchange import ExportSetup, RobotTool
from polish_sim.models import robot_model_path


def test_the_default_tool_is_that_of_the_shipped_cell():
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = [model.body(name).id for name in ("tool_mount", "head")]
    mass = model.body_mass[bodies]
    flange = data.site("flange")
    middle = flange.xmat.reshape(3, 3).T @ ((mass @ data.xipos[bodies]) / mass.sum() - flange.xpos)
    tcp = flange.xmat.reshape(3, 3).T @ (data.site("tool").xpos - flange.xpos)
    tool = RobotTool()
    assert tool.payload_kg == pytest.approx(mass.sum())
    assert tool.payload_center_m == pytest.approx(middle, abs=1e-4)
    assert tool.tcp_pose == pytest.approx([*tcp, 0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("pose", [(0.1, 0.2, 0.3), (0.0,) * 5 + (np.nan,)])
def test_half_a_pose_is_refused(pose):
    with pytest.raises(InputError, match=r"part_pose .* is no pose"):
        ExportSetup(part_pose=pose)
    with pytest.raises(InputError, match=r"tool\.tcp_pose .* is no pose"):
        ExportSetup(tool=RobotTool(tcp_pose=pose))
