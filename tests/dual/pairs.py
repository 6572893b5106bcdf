"""Two robots for tests: the follower presses or stands still where the master carries a part."""

import mujoco
import numpy as np

from polish_sim.cell import no_part, tool_on_flange
from polish_sim.cell.gears import build_host_arm
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.dual.carrier import MasterRows
from polish_sim.dual.cell import PairCell
from polish_sim.dual.scene import GRIPPER_LENGTH
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.spatial import transform
from tests.cell.cells import joints_at, start_of, tool_pose

Q_MASTER = np.array([0.19, -0.75, 1.86, -2.68, 1.57, 1.38])
ON_GRIPPER = transform(np.eye(3), np.array([0.0, 0.0, GRIPPER_LENGTH]))
TOOL = tool_pose(0.0, -0.5, 0.3)


def pair_cell(scenario: Scenario, model: mujoco.MjModel, master: MasterRows, stroke, part=None) -> PairCell:
    """A pair at the start of the follower's stroke; the host believes in the nominal table."""
    T, host = master.T_base_work, build_host_arm(NOMINAL, np.eye(4), tool_on_flange())
    nothing = no_part()._replace(rotation=np.ascontiguousarray(T[:3, :3]), position=T[:3, 3].copy())
    return PairCell(
        master, host, scenario, model, part or nothing, [stroke], joints_at(start_of(stroke)),
        build_controller(scenario.controller), np.random.default_rng(0),
    )  # fmt: skip
