"""The part stands where the arm does the whole path, or a refusal says what fits; strokes, one a stretch."""

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import gettempdir
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest
import trimesh

from polish_sim.cell import SILENT, build_scene, no_part, tool_on_flange
from polish_sim.cell.scene import Drawn, robot_with_tool
from polish_sim.config import PartConfig, PlanConfig, Scenario, SmoothingConfig
from polish_sim.config.key import POSE
from polish_sim.errors import PolishSimError, ReachError
from polish_sim.experiments import check_experiment
from polish_sim.experiments.assembly import check
from polish_sim.experiments.part_pose import ArmCheck, PartPlacing
from polish_sim.experiments.part_setup import placed_strokes, placed_tool
from polish_sim.experiments.placement import LOWEST_JOINT, SPINS, Reach, find_reach, tool_rotations
from polish_sim.experiments.reach_map import DISTANCES, HEIGHTS
from polish_sim.experiments.setups import MOST_REFUSED, SetupSearch
from polish_sim.experiments.stroke_motion import STROKE_RULES, StrokePath, stroke_motion, within_noise
from polish_sim.geometry.repair.skin import NOISELESS, ScanNoise
from polish_sim.motion import inverse_all, jacobian, link_frames, track
from polish_sim.planning import plan_part
from polish_sim.planning.toolpath import arc_length
from polish_sim.scenario_file import merge
from polish_sim.spatial import apply, from_pose, inverse, rotation_to_axis, transform

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
    model = build_scene(scenario, Drawn(plan.mesh, part), path.axes_work)
    poses = transform(reach.rotations(path.axes_work), apply(reach.T_base_work, path.positions_work))
    joints = track(poses, tool_on_flange(), reach.q_start)
    assert joints.first_unreachable is joints.first_beyond_limit is None
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


def test_a_path_below_that_the_arm_does_nowhere_names_the_side_to_turn_up(monkeypatch):
    monkeypatch.setattr(PartPlacing, "_reach", Mock(side_effect=ReachError("nowhere.")))
    scenario, plan = planned("point:0,0,-40")
    around = replace(plan.path, axes_work=np.eye(3)[np.arange(len(plan.path.s)) % 3])  # on no one side
    for path, said in ((plan.path, r"nowhere\. .* --up -z\."), (around, r"nowhere\.$")):
        with pytest.raises(ReachError, match=said):
            reached(scenario, replace(plan, path=path))


def test_patches_are_setups_of_their_own_once_many_setups_could_not_be_done(monkeypatch):
    monkeypatch.setattr(PartPlacing, "on_map", Mock())
    search = SetupSearch(check(merge(planned("auto")[0], {"plan": {"region": "all"}}, "")), SILENT)
    while setup := search.next():
        search.refuse(setup, "it fails.", False)
    assert (len(search._refused), len(search.given_up)) == (MOST_REFUSED, 6)
    assert "it fails" in search.notes[0]


def test_a_path_not_pressed_in_is_followed_as_it_is_by_an_arm_that_is_not_in_the_part():
    scenario, plan = planned("auto")
    placed = scenario, plan.mesh, plan.surface, plan.path
    placings = [PartPlacing(*placed, pressed_in) for pressed_in in (False, True)]
    assert np.array_equal(placings[0].positions, plan.path.positions_work)
    deeper = np.linalg.norm(placings[1].positions - placings[0].positions, axis=1)
    assert deeper[plan.path.process] == pytest.approx(20.0 / 5000.0)  # D = F / k
    in_front = transform(np.eye(3), np.array([0.0, -0.5, 0.12]))
    np.testing.assert_allclose(placings[0].reach().T_base_work, in_front, atol=2e-3)
    pose = posed(scenario, "300,-300,200,17,11,29")
    placing = PartPlacing(pose, plan.mesh, plan.surface, plan.path)
    T = from_pose(pose.part.pose)
    blind = find_reach(placing.positions, placing.axes, iter([T]), above_table=True)
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


FEED = 0.06


def test_a_stroke_over_noisy_normals_keeps_the_feed_within_their_noise():
    """Normals that jitter by 1 deg every 2.4 mm: within 0.2 deg they cost speed, within their noise less."""
    rng, s = np.random.default_rng(1), np.linspace(0.0, 0.1, 201)
    knots = np.linspace(0.0, 0.1, 42)
    tilt = np.stack([np.interp(s, knots, math.radians(1.0) * rng.normal(size=42)) for _ in range(2)], axis=1)
    axes = -np.column_stack([tilt, np.ones(201)]) / np.sqrt(1.0 + np.sum(tilt**2, axis=1))[:, None]
    x = np.array([1.0, 0.0, 0.0])
    stroke = StrokePath(np.outer(s, x), rotation_to_axis(axes, x), s, np.full(201, 0.02))
    noises = NOISELESS, ScanNoise(5e-5, math.radians(1.0))
    asked = [within_noise(SmoothingConfig(), noise) for noise in noises]
    times = [stroke_motion(each, stroke, None).duration for each in asked]
    assert asked[0] == SmoothingConfig()
    assert times[1] - 0.1 / 0.02 < (times[0] - 0.1 / 0.02) / 3.0  # more than at the feed


def bend(radius):
    """A straight line, half a circle and a straight line, sampled every half millimetre."""
    line, arc = np.arange(0.0, 0.05, 5e-4), np.linspace(0.0, math.pi, int(math.pi * radius / 5e-4))
    x = np.concatenate([line - 0.05, radius * np.sin(arc), -line - 5e-4])
    y = np.concatenate([0.0 * line, radius * (1.0 - np.cos(arc)), 0.0 * line + 2.0 * radius])
    tips = np.stack([x, y, 0.0 * x], axis=1)
    return StrokePath(tips, np.tile(np.eye(3), (len(x), 1, 1)), arc_length(tips), np.full(len(x), FEED))


def follow(rule, radius, **smoothing):
    return stroke_motion(SmoothingConfig(rule=rule, **smoothing), bend(radius), None)


def test_by_a_spline_a_bend_is_passed_at_the_feed_or_as_its_acceleration_allows():
    gentle = follow("spline", 0.025)
    inner = (gentle.places > 0.01) & (gentle.places < gentle.places[-1] - 0.01)
    np.testing.assert_allclose(gentle.speeds[inner], FEED, rtol=1e-3)
    sharp, fed, best = follow("spline", 0.003), follow("none", 0.003), math.sqrt(0.6 * 0.003)
    slowest = sharp.speeds[(sharp.places > 0.045) & (sharp.places < 0.065)].min()
    assert 0.85 * best <= slowest <= 1.05 * best  # the tolerance lets the bend be a little wider than 3 mm
    accelerations = (np.gradient(one.velocities, one.spacing, axis=0) for one in (sharp, fed))
    most = [np.linalg.norm(each, axis=1).max() for each in accelerations]
    assert most[0] <= 0.6 * 1.01
    assert most[1] == pytest.approx(FEED**2 / 0.003, rel=0.2)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"rule": "splines"}, "smoothing.*" + ".*".join(sorted(STROKE_RULES))),
        ({"rule": "certified"}, "smoothing.rule.*spline"), ({"limits_file": "none.toml"}, "limits"),
    ],
)  # fmt: skip
def test_bad_settings_are_refused_before_the_part_is_looked_at(wrong, said):
    with pytest.raises(PolishSimError, match=said):
        check_experiment(merge(Scenario(), {"part": {"file": "none.stl"}, "smoothing": wrong}, ""))


LIFT = PlanConfig().clearance_m
PLACE = np.array([0.0, -0.5, 0.08])
REACH = Reach(transform(np.eye(3), PLACE), np.eye(3)[0], np.array([1.2, -1.6, 1.9, -1.9, -1.6, 0.0]), 1.0)


def planned_islands(file):
    """Two square islands 120 mm apart on a base, covered by a spiral each."""
    moved = trimesh.transformations.translation_matrix
    base = trimesh.creation.box((200.0, 100.0, 10.0), moved([0, 0, -5]))
    pads = [trimesh.creation.box((60.0, 60.0, 20.0), moved([x, 0, 5])) for x in (-60.0, 60.0)]
    trimesh.boolean.union([base, *pads], engine="manifold").export(file)
    plan = PlanConfig(region="box:-100,-50,14,100,50,16", stepover_m=0.02, bridge_m=0.0)
    return plan_part(PartConfig(str(file), up="z"), plan)


def strokes(plan, force=None, feed_s=0.0):
    path, asked = replace(plan.path, force=force), replace(Scenario().process, max_feed_s=feed_s)
    return placed_strokes(Scenario(process=asked), path, placed_tool(path, REACH), 0.0, LIFT)


def test_each_island_is_a_stroke_lifted_to_the_same_height_and_travel_joins_it_to_the_next(tmp_path):
    islands = planned_islands(tmp_path / "islands.stl")
    first, second = strokes(islands)
    assert first.travel.duration == 0.0
    assert second.travel.places[-1] > 0.1
    assert [stroke.lead_in.length for stroke in (first, second)] == pytest.approx(2 * [LIFT], abs=1e-3)
    # The feed's time adds up from stroke to stroke; what lies beyond its limit is not planned.
    assert [len(strokes(islands, feed_s=first.motion.playing_time + more)) for more in (-1.0, 1.0)] == [1, 2]
    lifted = first.process.positions[-1] + [0.0, 0.0, LIFT + first.depth]
    assert second.travel.positions[0] == pytest.approx(lifted, abs=1e-9)
    assert second.travel.positions[-1] == pytest.approx(second.lead_in.positions[0], abs=1e-9)
    assert second.travel.positions[:, 2].min() >= PLACE[2] + 0.015 + 0.7 * LIFT
    force = np.interp(islands.path.s, [0.0, islands.path.s[-1]], [10.0, 60.0])
    ends = [one.process.positions[-1, 2] + one.lift + one.depth for one in strokes(islands, force)]
    assert ends == pytest.approx(2 * [PLACE[2] + 0.015 + LIFT], abs=1e-6)
