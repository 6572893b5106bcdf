"""The part stands where the arm does the whole path; a pose asked for is checked, refusals say what fits."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import gettempdir

import mujoco
import numpy as np
import pytest
import trimesh

from polish_sim.cell import build_scene, no_part, tool_on_flange
from polish_sim.cell.scene import Drawn, robot_with_tool, works_below
from polish_sim.config import Scenario
from polish_sim.config.key import POSE
from polish_sim.errors import ReachError
from polish_sim.experiments.part_pose import ArmCheck, PartPlacing
from polish_sim.experiments.placement import LOWEST_JOINT, SPINS, find_reach, tool_rotations
from polish_sim.experiments.reach_map import DISTANCES, HEIGHTS
from polish_sim.motion import inverse_all, jacobian, link_frames, track
from polish_sim.planning import plan_part
from polish_sim.scenario_file import merge
from polish_sim.spatial import apply, from_pose, inverse, transform

SIDES = {"right": "60,0,0", "towards the robot": "0,50,0", "away from it": "0,-50,0", "below": "0,0,-40"}


@cache
def planned(region):
    file = Path(gettempdir()) / "polish_sim_test_block.stl"
    trimesh.creation.box((120.0, 100.0, 80.0)).export(file)
    asked = {"part": {"file": str(file), "up": "z"}, "plan": {"region": region, "stepover_m": 0.02}}
    scenario = merge(Scenario(experiment="surface"), asked, "")
    return scenario, plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad)


def reached(scenario, plan):
    return PartPlacing(scenario, plan.mesh, plan.surface, plan.path).reach()


@pytest.mark.parametrize("side", SIDES)
def test_faces_to_the_side_and_below_are_reached_and_nothing_touches_on_the_way(side):
    scenario, plan = planned(f"point:{SIDES[side]}")
    reach, path = reached(scenario, plan), plan.path
    part = no_part()._replace(position=reach.T_base_work[:3, 3], rotation=reach.T_base_work[:3, :3].copy())
    model = build_scene(scenario, Drawn(plan.mesh, part), works_below(reach.T_base_work, path.axes_work))
    turns = tool_rotations(path.axes_work @ reach.T_base_work[:3, :3].T, reach.spin)
    poses = transform(turns, apply(reach.T_base_work, path.positions_work))
    joints = track(poses, tool_on_flange(), reach.q_start)
    assert joints.first_unreachable is None
    assert joints.first_beyond_limit is None
    assert joints.smallest_singular_value > scenario.safety.singular_value_limit
    data = mujoco.MjData(model)
    for q in joints.q[::5]:
        data.qpos[:6] = q
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
    assert apply(reach.T_base_work, plan.mesh.vertices)[:, 2].min() > -1e-9


BAD = {
    "beside the table": "500,0,200,90,0,0", "inside the table": "0,-500,20,0,0,0",
    "pedestal": "0,-100,60,0,0,0", "floor": "0,-500,-800,0,0,0", "out of reach": "0,-900,400,0,0,0",
}  # fmt: skip


@pytest.mark.parametrize("fault", BAD)
def test_a_pose_that_is_refused_says_why_and_the_one_it_names_is_feasible(fault):
    scenario, plan = planned("auto")
    with pytest.raises(ReachError, match=fault) as raised:
        reached(posed(scenario, BAD[fault]), plan)
    fitting = re.search(r"It fits with --part-pose ([-\d.,e]+\d)", str(raised.value))
    assert reached(posed(scenario, fitting[1]), plan).smallest_singular_value > 0.08


def test_a_path_not_pressed_in_is_followed_as_it_is_by_an_arm_that_is_not_in_the_part():
    scenario, plan = planned("auto")
    placed = scenario, plan.mesh, plan.surface, plan.path
    placings = [PartPlacing(*placed, pressed_in) for pressed_in in (False, True)]
    assert np.array_equal(placings[0].positions, plan.path.positions_work)
    deeper = np.linalg.norm(placings[1].positions - placings[0].positions, axis=1)
    assert deeper[plan.path.process] == pytest.approx(20.0 / 5000.0)  # D = F / k
    # Reached in front of the robot the part stays there.
    in_front = transform(np.eye(3), np.array([0.0, -0.5, 0.12]))
    np.testing.assert_allclose(placings[0].reach().T_base_work, in_front, atol=2e-3)
    # An arm whose forearm would be in the part takes another configuration.
    pose = posed(scenario, "300,-300,200,17,11,29")
    placing = PartPlacing(pose, plan.mesh, plan.surface, plan.path)
    T = from_pose(pose.part.pose)
    blind = find_reach(placing.positions, placing.axes, iter([T]), tool_on_flange(), above_table=True)
    check = ArmCheck(robot_with_tool(pose), plan.mesh, plan.surface, placing.axes, False)
    assert check.first_touch(T, blind.q_start[None]).names == "wrist or forearm and the part"
    assert not np.allclose(reached(pose, plan).q_start, blind.q_start, atol=0.1)


def posed(scenario, text):
    numbers = (float(word) * unit.si for word, unit in zip(text.split(","), POSE, strict=True))
    return replace(scenario, part=replace(scenario.part, pose=tuple(numbers)))


def test_the_maps_value_is_the_least_determinant_along_the_path():
    scenario, plan = planned("point:0,50,0")
    placing = PartPlacing(scenario, plan.mesh, plan.surface, plan.path)
    found = placing.map()
    cells = np.random.default_rng(3).permutation(np.argwhere(found.values > 0.0))[:20]
    for height, distance, turn, spin in cells:
        T = found.pose(height, distance, turn)
        assert apply(T, plan.mesh.vertices)[:, 2].min() == pytest.approx(HEIGHTS[height], abs=1e-9)
        places = apply(T, placing.positions)
        middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
        assert middle[1] == pytest.approx(-DISTANCES[distance], abs=0.02)
        poses = transform(tool_rotations(placing.axes @ T[:3, :3].T, SPINS[spin]), places)
        poses = poses @ inverse(tool_on_flange())
        branches = np.array([inverse_all(np.ascontiguousarray(pose), 0.0) for pose in poses])
        angles = np.nan_to_num(branches)
        done = ~np.isnan(branches).any(axis=(0, 2))
        done &= link_frames(angles)[:, :, 1:6, 2, 3].min(axis=(0, 2)) >= LOWEST_JOINT
        best = np.abs(np.linalg.det(jacobian(angles, np.zeros(3)))).min(axis=0)[done].max()
        # The map looks at the outermost points and some of the path: it may miss a lower value between.
        assert best <= found.values[height, distance, turn, spin] * (1.0 + 1e-9)
        assert best > 0.8 * found.values[height, distance, turn, spin]
