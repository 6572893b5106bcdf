"""Turn part, path and arm about the robot's own axis: everything happens the same."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.cell import CellRun
from polish_sim.control import CONTROLLERS
from polish_sim.spatial import transform
from tests.cell.cells import EVERY_STEP, TOUCH, along_tool, cell_for, ideal, joints_at, part_under, pressing_stroke
from tests.cell.fields import sphere


def run_turned(angle: float, controller: str) -> CellRun:
    """Press on a ball that lies 2 mm aside and 1 mm low, and slide over it, with noise and spindle on."""
    turn = transform(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix(), np.zeros(3))
    stroke = pressing_stroke(turn @ TOUCH, slide=0.01, lift=0.005)
    part = part_under(sphere(0.1), turn @ along_tool(TOUCH, x=0.002, y=0.001, z=0.001))
    noise = ["sensor.force_noise_n=0.5", "sensor.force_bias_n=3", "spindle.speed_rpm=6000"]
    cell = cell_for(ideal("force", EVERY_STEP, f"controller.name={controller}", *noise), stroke, part=part)
    straight = joints_at(along_tool(TOUCH, z=-0.005))
    np.testing.assert_allclose(cell.data.qpos[:6] - straight, [angle, 0, 0, 0, 0, 0], atol=1e-9)
    return cell.run()


@pytest.mark.parametrize("controller", [*CONTROLLERS])
@pytest.mark.parametrize("angle", [-1.0, 0.3])
def test_every_quantity_in_tool_and_joint_space_is_the_same(controller: str, angle: float) -> None:
    here, there = run_turned(0.0, controller), run_turned(angle, controller)
    assert here.stop_reason is None
    assert here.steps == there.steps
    np.testing.assert_array_equal(here.trace.phase, there.trace.phase)
    np.testing.assert_allclose(here.trace.normal_force_n, there.trace.normal_force_n, atol=1e-6)
    np.testing.assert_allclose(here.trace.tangential_error_m, there.trace.tangential_error_m, atol=1e-9)
    np.testing.assert_allclose(here.log["wrench_true_tool"], there.log["wrench_true_tool"], atol=1e-5)
    np.testing.assert_allclose(here.log["q_rad"][:, 1:], there.log["q_rad"][:, 1:], atol=1e-6)


def test_the_path_turns_with_the_world() -> None:
    here, there = run_turned(0.0, "hybrid-pi"), run_turned(-0.7, "hybrid-pi")
    turned = Rotation.from_rotvec([0.0, 0.0, -0.7]).apply(here.trace.tcp_position_m)
    np.testing.assert_allclose(there.trace.tcp_position_m, turned, atol=1e-9)
