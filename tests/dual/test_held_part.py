"""Where two robots hold a part: chain, gripper, marks, rim; what arms, pad and gripper must not touch."""

from functools import cache

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from shapely.geometry import Polygon
from trimesh.creation import extrude_polygon

from polish_sim import geometry
from polish_sim.config import Scenario
from polish_sim.dual.arms import ClosedChain
from polish_sim.dual.carrier import FIRST_JOINT, MasterRows
from polish_sim.dual.frames import spread_marks
from polish_sim.dual.scene import GRIPPER_RADIUS, Clearances, Held, build_pair_scene, pair_contacts, seat_part
from polish_sim.dual.task import fit_closed_spline, length_of
from polish_sim.errors import PlanError, ReachError, SmoothingError
from polish_sim.experiments import default_scenario
from polish_sim.experiments.placement import check_shaft
from polish_sim.geometry import part_from_arrays
from polish_sim.models import part_path
from polish_sim.motion import forward
from polish_sim.spatial import apply, from_pose, inverse, transform
from tests.cell.cells import EVERY_STEP, along_tool, drawn_vertices, free_stroke, ideal, joints_at
from tests.dual.test_pair import ON_GRIPPER, Q_MASTER, TOOL, hub, pair_cell
from tests.geometry.shapes import prism
from tests.planning.shapes import UP, circle, path_through

ANGLE = default_scenario("dual").plan.feature_angle_rad
CLEARANCES = Clearances(arms=0.03, pad=0.005)
SIDE = 0.02  # of the cube in the gripper [m]
ELBOW_AHEAD = np.array([0.0, -0.6, 2.2, -1.6, -1.57, 0.0])


def test_a_wrong_chain_shows_as_it_is():
    chain = ClosedChain(
        from_pose([-1.15, 0.0, 0.0, 0.0, 0.0, np.pi]),
        from_pose([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]),
        from_pose([0.0, 0.0, 0.05, 0.0, 0.0, 0.3]),
        from_pose([0.0, 0.0, 0.18, 0.02, -0.01, 0.4]),
    )
    turns, places = Rotation.random(10, random_state=0), np.random.default_rng(0).normal(size=(10, 3))
    T_master_work, T_work_tool = transform(turns.as_matrix(), places).reshape(2, 5, 4, 4)
    first, second = chain.master_flange(T_master_work), chain.follower_flange(T_master_work, T_work_tool)
    moved = chain._replace(T_flange_tool=chain.T_flange_tool @ from_pose([0.0, 0.0, 1e-3, 0.0, 2e-3, 0.0]))
    np.testing.assert_allclose(chain.residual(first, second, T_work_tool), 0.0, atol=1e-12)
    off = moved.residual(first, second, T_work_tool)
    np.testing.assert_allclose(off, np.tile([0, 0, 1e-3, 0, 2e-3, 0], (5, 1)), atol=1e-12)


def fitted(mesh):
    return geometry.fit_surface(geometry.part_from_arrays(mesh.vertices, mesh.faces), ANGLE)


@pytest.mark.parametrize("pose", [[0.0] * 6, [0.01, 0.3, 0.0, 0.0, 1.2, 0.4]])
def test_a_hub_sits_on_its_ring_wherever_its_file_has_its_origin(pose):
    T_file_hub = from_pose(pose)
    moved = geometry.part_from_arrays(apply(T_file_hub, hub().vertices), hub().faces)
    seat = seat_part(geometry.fit_surface(moved, ANGLE), T_file_hub[:3, 2])
    on_gripper = apply(seat.T_gripper_work, moved.vertices)
    np.testing.assert_allclose(on_gripper[:, 2], hub().vertices[:, 2], atol=1e-6)
    np.testing.assert_allclose(on_gripper[:, :2].max(axis=0) + on_gripper[:, :2].min(axis=0), 0.0, atol=3e-4)
    assert seat.nose == pytest.approx(0.008, abs=2e-4)  # the gripper reaches to the hub's web


def test_a_part_the_gripper_would_not_meet_is_refused_and_can_be_put_on_it():
    ring = fitted(trimesh.creation.annulus(0.06, 0.09, 0.03))
    with pytest.raises(ReachError, match=r"\(0, 0, -15\) mm .*part_on_gripper"):
        seat_part(ring, UP)
    on_wall = (0.075, 0.0, 0.015, 0.0, 0.0, 0.0)
    seat = seat_part(ring, UP, on_wall)
    np.testing.assert_allclose(seat.T_gripper_work, from_pose(on_wall))
    assert seat.nose == 0.0


def test_the_shaft_keeps_its_clearance_from_what_stands_beside_the_pad():
    """The shaft's radius is 9 mm: beside a wall it keeps its distance less that."""
    profile = np.array([[-20, -10], [60, -10], [60, 0], [0, 0], [0, 80], [-20, 80]]) * 1e-3
    wall = fitted(prism(profile, 0.1))
    along = np.linspace([0.0, 0.03, 0.0], [0.0, 0.07, 0.0], 41)
    check_shaft(path_through(along + [0.0145, 0.0, 0.0]), wall, 0.005)
    with pytest.raises(PlanError, match=r"shaft .* 4\.[0-9] mm .* \(13"):
        check_shaft(path_through(along + [0.0135, 0.0, 0.0]), wall, 0.005)


@cache
def part(name, choice="auto"):
    mesh = geometry.load_part(part_path(name))
    surface = geometry.fit_surface(mesh)
    return geometry.select_region(surface, mesh, choice), surface


@pytest.mark.parametrize("name", ["wheel_hub_rim", "plate", "freeform"])
def test_marks_lie_on_the_region_with_the_tool_into_the_part_and_span_much_of_it(name):
    region, surface = part(name)
    for count in (3, 7):
        T = spread_marks(region, surface, count)
        there = region.surface.closest(T[:, :3, 3])
        np.testing.assert_allclose(there.positions, T[:, :3, 3], atol=1e-9)
        np.testing.assert_allclose(T[:, :3, 2], -there.normals, atol=1e-6)
        turned = np.swapaxes(T[:, :3, :3], 1, 2) @ T[:, :3, :3]
        np.testing.assert_allclose(turned, np.tile(np.eye(3), (count, 1, 1)), atol=1e-12)
    points = spread_marks(region, surface, 3)[:, :3, 3]
    size = np.ptp(region.surface.vertices[np.unique(region.surface.faces)], axis=0).max()
    assert np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).min() > 0.4 * size
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    assert spread[1] > 0.3 * spread[0]
    if name == "wheel_hub_rim":  # a third of a turn apart
        angles = np.sort(np.degrees(np.arctan2(points[:, 1], points[:, 0])))
        np.testing.assert_allclose(np.diff([*angles, angles[0] + 360.0]), 120.0, atol=4.0)


def test_marks_span_a_narrow_strip_s_part_and_a_long_slanted_one(tmp_path):
    points = spread_marks(*part("plate", "box:-100,-2,-50,100,2,50"), 3)[:, :3, 3]
    assert np.ptp(points[:, 1]) > 0.03
    outline = Polygon([(0, 0), (158, 0), (252, 57), (0, 59)]).buffer(2)
    extrude_polygon(outline.difference(outline.buffer(-30.4)), 45).export(tmp_path / "slanted.stl")
    points = spread_marks(*part(str(tmp_path / "slanted.stl")), 3)[:, :3, 3]
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    assert spread[1] > 0.1 * spread[0]


def test_a_rim_of_twelve_points_is_a_circle_to_a_third_of_a_micrometre_and_smooth_where_it_closes():
    radius = 0.2
    rim = circle(radius, count=12)
    spline = fit_closed_spline(rim)
    u = np.linspace(0.0, length_of(spline), 4001)
    assert np.abs(np.linalg.norm(spline(u), axis=1) - radius).max() <= 3.2e-7
    with pytest.raises(SmoothingError, match="points 4 and 5 are in one place"):
        fit_closed_spline(rim[[0, 1, 2, 3, 3, *range(5, 12)]])
    spline = fit_closed_spline(rim + np.random.default_rng(1).normal(0.0, 0.01, (12, 3)))
    knots = np.unique(spline.t[5:-5])
    for derivative in range(5):
        before, behind = spline(knots - 1e-9, derivative), spline(knots + 1e-9, derivative)
        scale = np.abs(spline(np.linspace(0.0, length_of(spline), 500), derivative)).max()
        np.testing.assert_allclose(before, behind, atol=1e-5 * scale)


@cache
def cube():
    box = trimesh.creation.box([SIDE] * 3)
    return part_from_arrays(box.vertices + [0.0, 0.0, 0.5 * SIDE], box.faces, up="z")


def scene(T_follower_master, clearances):
    return build_pair_scene(Scenario(), T_follower_master, Held(cube(), 2700.0, ON_GRIPPER, 0.0, clearances))


def gripper_before(gap, aside):
    """The master's base for a gripper's face this far before the pad and an axis this far beside it [m]."""
    face = along_tool(TOOL, x=aside, z=gap) @ np.diag([1.0, -1.0, -1.0, 1.0])
    return np.asarray(face @ inverse(forward(Q_MASTER) @ ON_GRIPPER))


@pytest.mark.parametrize(("gap", "named"), [(-0.003, True), (0.0045, True), (0.0055, False)])
def test_the_pad_keeps_its_clearance_from_the_gripper(gap, named):
    # Beside the cube, which the pad may touch: only the gripper's face is before it.
    T_follower_master = gripper_before(gap, aside=GRIPPER_RADIUS)
    contacts = pair_contacts(scene(T_follower_master, CLEARANCES), CLEARANCES)
    found = contacts(Q_MASTER[None], joints_at(TOOL)[None])
    assert set(found.split(" and ")) == ({"follower_head_pad", "master_gripper"} if named else {""})


def facing(distance):
    """The master's base turned to the follower's, so far that their elbows, set aside, are in one line."""
    return from_pose([-distance, -0.27, 0.0, 0.0, 0.0, np.pi])


def drawn(model, data, arm):
    """Every vertex of what is drawn of an arm [m], shape (n, 3)."""
    meshes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    own = [geom for geom in meshes if model.geom(geom).name.startswith(arm)]
    return np.concatenate([drawn_vertices(model, data, geom) for geom in own])


def base_distance_for(apart):
    """Between the bases, so that the nearest drawn points of both arms are this far apart [m]."""
    model = scene(facing(1.5), None)
    data = mujoco.MjData(model)
    data.qpos[:6] = data.qpos[FIRST_JOINT:] = ELBOW_AHEAD
    mujoco.mj_kinematics(model, data)
    master, follower = drawn(model, data, "master_"), KDTree(drawn(model, data, "follower_"))

    def too_far(distance):
        return float(follower.query(master + [1.5 - distance, 0.0, 0.0])[0].min()) - apart

    return float(brentq(too_far, 0.8, 1.5, xtol=1e-4))


def test_pad_and_part_may_touch_housing_and_part_not_and_arms_keep_their_drawn_clearance():
    contacts = pair_contacts(scene(gripper_before(SIDE, aside=0.0), CLEARANCES), CLEARANCES)
    assert contacts(Q_MASTER[None], joints_at(TOOL)[None]) == ""
    # The cube's middle beside the spindle, the gripper below it.
    T = along_tool(TOOL, x=0.075, z=-0.1) @ from_pose([0.0, 0.0, 0.0, 0.0, -0.5 * np.pi, 0.0])
    T_follower_master = T @ inverse(along_tool(forward(Q_MASTER) @ ON_GRIPPER, z=SIDE))
    contacts = pair_contacts(scene(T_follower_master, CLEARANCES), CLEARANCES)
    found = contacts(Q_MASTER[None], joints_at(TOOL)[None])
    assert {name[:16] for name in found.split(" and ")} == {"follower_spindle", "master_part"}
    near = base_distance_for(CLEARANCES.arms - 0.002)
    q = ELBOW_AHEAD[None]
    one, two = pair_contacts(scene(facing(near), CLEARANCES), CLEARANCES)(q, q).split(" and ")
    assert {one.partition("_link_")[0], two.partition("_link_")[0]} == {"follower", "master"}
    touching = Clearances(0.0, 0.0)
    assert pair_contacts(scene(facing(near), touching), touching)(q, q) == ""
    assert pair_contacts(scene(facing(near + 0.01), CLEARANCES), CLEARANCES)(q, q) == ""


def test_the_run_stops_when_the_pad_is_driven_into_the_gripper():
    T_follower_master = gripper_before(0.01, aside=GRIPPER_RADIUS)
    T = T_follower_master @ forward(Q_MASTER) @ ON_GRIPPER
    rest = MasterRows(0.02, np.tile(Q_MASTER, (101, 1)), np.zeros((101, 6)), T, np.eye(4))
    down = free_stroke(TOOL, along_tool(TOOL, z=0.02), feed=0.02)
    run = pair_cell(ideal("arc", EVERY_STEP), scene(T_follower_master, None), rest, down).run()
    assert "follower_head_pad" in str(run.stop_reason)
    assert "master_gripper" in str(run.stop_reason)
    deepest = (run.log["tcp_position_m"].astype(float) @ TOOL[:3, 2]).max() - TOOL[:3, 3] @ TOOL[:3, 2]
    assert deepest == pytest.approx(0.01, abs=0.001)
