"""What two robots must not touch: arm against arm and pad against gripper, beforehand and while they run."""

from functools import cache

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq
from scipy.spatial import KDTree

from polish_sim.arrays import Array
from polish_sim.config import Scenario
from polish_sim.dual.carrier import FIRST_JOINT, MasterRows
from polish_sim.dual.scene import GRIPPER_RADIUS, Clearances, Held, PairContacts, build_pair_scene
from polish_sim.geometry import PartMesh, part_from_arrays
from polish_sim.motion import forward
from polish_sim.spatial import from_pose, inverse
from tests.cell.cells import EVERY_STEP, along_tool, drawn_vertices, free_stroke, ideal, joints_at
from tests.dual.pairs import ON_GRIPPER, Q_MASTER, TOOL, pair_cell

CLEARANCES = Clearances(arms=0.03, pad=0.005)
SIDE = 0.02  # of the cube in the gripper [m]


@cache
def cube() -> PartMesh:
    box = trimesh.creation.box([SIDE] * 3)
    return part_from_arrays(box.vertices + [0.0, 0.0, 0.5 * SIDE], box.faces, up="z")


def scene(T_follower_master: Array, clearances: Clearances | None) -> mujoco.MjModel:
    return build_pair_scene(Scenario(), T_follower_master, Held(cube(), 2700.0, ON_GRIPPER, 0.0, clearances))


def gripper_before(gap: float, aside: float) -> Array:
    """The master's base for a gripper's face this far before the pad and an axis this far beside it [m]."""
    face = along_tool(TOOL, x=aside, z=gap) @ np.diag([1.0, -1.0, -1.0, 1.0])
    return np.asarray(face @ inverse(forward(Q_MASTER) @ ON_GRIPPER))


@pytest.mark.parametrize(("gap", "named"), [(-0.003, True), (0.0045, True), (0.0055, False)])
def test_the_pad_keeps_its_clearance_from_the_gripper(gap, named):
    # Beside the cube, which the pad may touch: only the gripper's face is before it.
    T_follower_master = gripper_before(gap, aside=GRIPPER_RADIUS)
    contacts = PairContacts(scene(T_follower_master, CLEARANCES), CLEARANCES)
    found = contacts.first(Q_MASTER[None], joints_at(TOOL)[None])
    assert set(found.split(" and ")) == ({"follower_head_pad", "master_gripper"} if named else {""})


def test_the_pad_may_come_to_the_part_and_the_housing_may_not():
    contacts = PairContacts(scene(gripper_before(SIDE, aside=0.0), CLEARANCES), CLEARANCES)
    assert contacts.first(Q_MASTER[None], joints_at(TOOL)[None]) == ""
    # The cube's middle beside the spindle, the gripper below it.
    T = along_tool(TOOL, x=0.075, z=-0.1) @ from_pose([0.0, 0.0, 0.0, 0.0, -0.5 * np.pi, 0.0])
    T_follower_master = T @ inverse(along_tool(forward(Q_MASTER) @ ON_GRIPPER, z=SIDE))
    contacts = PairContacts(scene(T_follower_master, CLEARANCES), CLEARANCES)
    found = contacts.first(Q_MASTER[None], joints_at(TOOL)[None])
    assert {name[:16] for name in found.split(" and ")} == {"follower_spindle", "master_part"}


ELBOW_AHEAD = np.array([0.0, -0.6, 2.2, -1.6, -1.57, 0.0])


def facing(distance: float) -> Array:
    """The master's base turned to the follower's, so far that their elbows, set aside, are in one line."""
    return from_pose([-distance, -0.27, 0.0, 0.0, 0.0, np.pi])


def drawn(model: mujoco.MjModel, data: mujoco.MjData, arm: str) -> Array:
    """Every vertex of what is drawn of an arm [m], shape (n, 3)."""
    meshes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    own = [geom for geom in meshes if model.geom(geom).name.startswith(arm)]
    return np.concatenate([drawn_vertices(model, data, geom) for geom in own])


def base_distance_for(apart: float) -> float:
    """Between the bases, so that the nearest drawn points of both arms are this far apart [m]."""
    model = scene(facing(1.5), None)
    data = mujoco.MjData(model)
    data.qpos[:6] = data.qpos[FIRST_JOINT:] = ELBOW_AHEAD
    mujoco.mj_kinematics(model, data)
    master, follower = drawn(model, data, "master_"), KDTree(drawn(model, data, "follower_"))

    def too_far(distance: float) -> float:
        return float(follower.query(master + [1.5 - distance, 0.0, 0.0])[0].min()) - apart

    return float(brentq(too_far, 0.8, 1.5, xtol=1e-4))


def test_arms_keep_their_clearance_as_they_are_drawn():
    near = base_distance_for(CLEARANCES.arms - 0.002)
    q = ELBOW_AHEAD[None]
    found = PairContacts(scene(facing(near), CLEARANCES), CLEARANCES).first(q, q)
    one, two = found.split(" and ")
    assert {one.partition("_link_")[0], two.partition("_link_")[0]} == {"follower", "master"}
    # Without a clearance nothing is said: they do not touch.
    touching = Clearances(0.0, 0.0)
    assert PairContacts(scene(facing(near), touching), touching).first(q, q) == ""
    assert PairContacts(scene(facing(near + 0.01), CLEARANCES), CLEARANCES).first(q, q) == ""


def test_the_run_stops_when_the_pad_is_driven_into_the_gripper():
    T_follower_master = gripper_before(0.01, aside=GRIPPER_RADIUS)
    T = T_follower_master @ forward(Q_MASTER) @ ON_GRIPPER
    rest = MasterRows(0.02, np.tile(Q_MASTER, (101, 1)), np.zeros((101, 6)), T, np.eye(4))
    down = free_stroke(TOOL, along_tool(TOOL, z=0.02), feed=0.02)
    cell = pair_cell(ideal("arc", EVERY_STEP), scene(T_follower_master, None), rest, down)
    run = cell.run()
    assert "follower_head_pad" in str(run.stop_reason)
    assert "master_gripper" in str(run.stop_reason)
    deepest = (run.log["tcp_position_m"].astype(float) @ TOOL[:3, 2]).max() - TOOL[:3, 3] @ TOOL[:3, 2]
    assert deepest == pytest.approx(0.01, abs=0.001)
