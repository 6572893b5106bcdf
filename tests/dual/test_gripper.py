"""How a part sits in the gripper, wherever its file has its origin, and whether the pad's shaft has room on it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.dual.gripper import seat_part, seat_text
from polish_sim.errors import PlanError, ReachError
from polish_sim.experiments import default_scenario
from polish_sim.experiments.placement import check_shaft
from polish_sim.geometry import PartMesh, Surface, fit_surface, load_part, part_from_arrays
from polish_sim.models import workpiece_path
from polish_sim.planning.toolpath import PROCESS, ToolPath
from polish_sim.spatial import apply, from_pose, transform

Array = NDArray[np.float64]

UP = np.array([0.0, 0.0, 1.0])
ANGLE = default_scenario("dual").plan.feature_angle_rad


@cache
def hub() -> PartMesh:
    return load_part(workpiece_path("wheel_hub_rim"))


def fitted(mesh: trimesh.Trimesh) -> Surface:
    return fit_surface(part_from_arrays(mesh.vertices, mesh.faces), ANGLE)


def test_the_hub_sits_on_its_ring_and_the_gripper_goes_on_to_its_web() -> None:
    seat = seat_part(fit_surface(hub(), ANGLE), UP)
    np.testing.assert_array_equal(seat.T_gripper_work, np.eye(4))
    assert seat.nose == pytest.approx(0.008, abs=2e-4)
    assert (
        seat_text(seat.T_gripper_work)
        == "held by the gripper at (0, 0, 0) mm of its own frame, gripper's axis (0, 0, 1)"
    )


@pytest.mark.parametrize("pose", [[0.2, -0.1, 0.05, 0.0, 0.0, 0.0], [0.01, 0.3, 0.0, 0.0, 1.2, 0.4]])
def test_a_part_sits_the_same_wherever_its_file_has_its_origin(pose: list[float]) -> None:
    T_file_hub = from_pose(pose)
    moved = part_from_arrays(apply(T_file_hub, hub().vertices), hub().faces)
    seat = seat_part(fit_surface(moved, ANGLE), T_file_hub[:3, 2])
    on_gripper = apply(seat.T_gripper_work, moved.vertices)
    np.testing.assert_allclose(on_gripper[:, 2], hub().vertices[:, 2], atol=1e-6)
    np.testing.assert_allclose(on_gripper[:, :2].max(axis=0) + on_gripper[:, :2].min(axis=0), 0.0, atol=3e-4)
    assert seat.nose == pytest.approx(0.008, abs=2e-4)


def test_a_part_the_gripper_would_not_meet_is_refused_and_can_be_put_on_it() -> None:
    ring = fitted(trimesh.creation.annulus(0.06, 0.09, 0.03))
    with pytest.raises(
        ReachError, match=r"80 mm wide, would hold nothing: .* \(0, 0, -15\) mm of the part.*part_on_gripper"
    ):
        seat_part(ring, UP)
    on_wall = (0.075, 0.0, 0.015, 0.0, 0.0, 0.0)
    seat = seat_part(ring, UP, on_wall)
    np.testing.assert_allclose(seat.T_gripper_work, from_pose(on_wall))
    assert seat.nose == 0.0
    with pytest.raises(ReachError, match="would hold nothing"):
        seat_part(ring, UP, (0.3, 0.0, 0.015, 0.0, 0.0, 0.0))


def beside_wall(distance: float) -> ToolPath:
    """A path along a wall at x = 0, on a floor at z = 0."""
    y = np.linspace(-0.02, 0.02, 41)
    points = np.stack([np.full(41, distance), y, np.zeros(41)], axis=1)
    kind = np.full(41, PROCESS, dtype=np.int8)
    return ToolPath(points, np.tile(UP, (41, 1)), y - y[0], np.zeros(41, dtype=np.int64), kind, np.zeros(41))


def test_the_shaft_keeps_its_clearance_from_what_stands_beside_the_pad() -> None:
    """The shaft's radius is 9 mm: beside a wall it keeps its distance less that."""
    profile = np.array([[-20, -10], [60, -10], [60, 0], [0, 0], [0, 80], [-20, 80]]) * 1e-3
    solid = trimesh.creation.extrude_polygon(trimesh.path.polygons.Polygon(profile), 0.1)
    turn = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    solid.apply_transform(transform(turn, np.array([0.0, 0.05, 0.0])))
    wall = fitted(solid)
    check_shaft(beside_wall(0.0145), wall, 0.005)
    with pytest.raises(PlanError, match=r"shaft comes within 4\.[0-9] mm of the part where the pad is at \(13"):
        check_shaft(beside_wall(0.0135), wall, 0.005)
