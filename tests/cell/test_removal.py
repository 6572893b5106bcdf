"""Material removal and its rates against closed forms, and the nodes it is mapped on."""

import math
from typing import NamedTuple

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from polish_sim.cell import Touch, build_real_part, removal
from polish_sim.cell.dwell import PadPoses, exposure_rates
from polish_sim.cell.real_part import build_part_fields
from polish_sim.config import PartConfig
from polish_sim.geometry import Region, Surface, field_distance, part_from_arrays, select_region
from polish_sim.geometry.fit import fit_triangles
from polish_sim.log import RunLog
from tests.analysis.synthetic import log_of, trace_of
from tests.cell.cells import part_at, plane

R = 0.025
STIFFNESS = 20000.0
SPIN = 628.3
FINE = 0.00125  #: Distance between nodes a run with this pad has [m]
DOWN = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))  #: The tool of a pass
UP = np.array([0.0, 0.0, 1.0])
R_NODES = 0.02
FORCE = 20.0


def level_nodes(spacing, half=0.055):
    """A skewed grid of nodes on the plane z = 0, so that no row of them runs along an axis."""
    count = math.ceil(1.5 * half / spacing)
    i, j = np.meshgrid(np.arange(-count, count + 1), np.arange(-count, count + 1), indexing="ij")
    x, y = spacing * (i + 0.37), spacing * (j + 0.11)
    c, s = math.cos(0.4), math.sin(0.4)
    places = np.stack([c * x - s * y, s * x + c * y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    places = places[np.abs(places[:, :2]).max(axis=1) < half]
    areas = np.full(len(places), spacing**2)
    return removal.PressedNodes(places, np.tile([0.0, 0.0, 1.0], (len(places), 1)), areas)


def steps(centers, velocity, dt, force=20.0, spin=SPIN):
    """A pad pressed flat from above, moved at a constant velocity, for dt at each of its places."""
    n = len(centers)
    axes = np.tile([0.0, 0.0, 1.0], (n, 1))
    return removal.PadMotion(
        dt * np.arange(1, n + 1), centers, axes, np.tile(velocity, (n, 1)), -spin * axes, np.full(n, dt),
        np.full(n, force * dt),
    )  # fmt: skip


@pytest.mark.parametrize("spin", [SPIN, 1.5])
def test_a_straight_pass_leaves_the_profile_of_the_chords(spin):
    feed, nodes = 0.02, level_nodes(FINE)
    x = np.arange(-0.026, 0.026, 0.0005) + 0.00025
    centers = np.stack([x, np.zeros_like(x), np.full_like(x, -0.001)], axis=1)
    motion = steps(centers, np.array([feed, 0.0, 0.0]), 0.0005 / feed, 20.0, spin)
    passed = np.abs(nodes.positions[:, 0]) < 0.0009
    y = nodes.positions[passed, 1]
    found = removal.expose_nodes(nodes, motion, R, STIFFNESS).exposure[passed]
    # Along a chord the speed is sqrt(u^2 + spin^2 x^2) with u across it: its integral in closed form.
    chord, across = np.sqrt(np.maximum(R**2 - y**2, 0.0)), np.abs(feed + spin * y)
    long = np.hypot(across, spin * chord)
    integral = chord * long + across**2 / spin * np.arcsinh(spin * chord / across)
    expected = 20.0 / (math.pi * R**2) * integral / feed
    inside = np.abs(y) < 0.95 * R
    np.testing.assert_allclose(found[inside], expected[inside], rtol=0.03)
    assert found[inside].mean() == pytest.approx(expected[inside].mean(), rel=0.01)
    assert found[np.abs(y) > R].max(initial=0.0) == 0.0


def test_on_a_ball_the_pressure_falls_from_the_middle_as_the_gap_to_the_face():
    radius, depth = 0.1, 0.0015
    grid = level_nodes(FINE, 0.03).positions[:, :2]
    places = np.column_stack([grid, np.sqrt(radius**2 - (grid**2).sum(axis=1)) - radius])
    normals = (places + [0.0, 0.0, radius]) / radius
    nodes = removal.PressedNodes(places, normals, FINE**2 / normals[:, 2])
    motion = steps(np.array([[0.0, 0.0, -depth]]), np.zeros(3), 1.0, 1.0)
    removed = removal.expose_nodes(nodes, motion, R, STIFFNESS)
    # The spring under a place at r is as deep as the ball reaches beyond it, and leans with the ball.
    r = np.hypot(*grid.T)
    away = np.hypot(r, radius - depth)
    bedding = STIFFNESS / (math.pi * R**2)
    deep = bedding * np.maximum(radius - away, 0.0) * (r < R)
    rim = math.sqrt(radius**2 - (radius - depth) ** 2)
    ring = np.linspace(0.0, rim, 4001)
    reach = np.hypot(ring, radius - depth)
    carried = np.trapezoid(bedding * (radius - reach) * (radius - depth) / reach * 2.0 * math.pi * ring, ring)
    assert removed.carried[0] == pytest.approx(carried, rel=0.005)
    # Per area of the ball, and scaled from what the field carries to the force of 1 N.
    pressure = deep * normals[:, 2] / carried
    # The face turns about z; what points into the part does not slide.
    moved = SPIN * np.column_stack([grid[:, 1], -grid[:, 0], np.zeros(len(grid))])
    sliding = np.linalg.norm(moved - (moved * normals).sum(axis=1)[:, None] * normals, axis=1)
    near = (r > 0.002) & (r < 0.9 * rim)
    np.testing.assert_allclose(removed.exposure[near], sliding[near] * pressure[near], rtol=0.03)
    assert removed.exposure[r > rim + 0.001].max() == 0.0


def pass_over_plane():
    """A pass of 30 mm in 1.5 s."""
    time, one = np.arange(0.0, 1.5, 1e-3), np.ones(1500)
    tip = np.stack([0.02 * time - 0.015, 0.0 * one, -0.004 * one], axis=1)
    return trace_of(
        np.full(1500, 2, np.int8), normal_force_n=20.0 * one, tcp_position_m=tip,
        tcp_speed_m_s=0.02 * one, pad_travel_m=0.003 * one, spindle_rad_s=SPIN * one,
    )  # fmt: skip


def with_tool(log, tool):
    quaternions = np.broadcast_to(tool.as_quat(scalar_first=True), (len(log), 4))
    return RunLog({**log.columns, "tcp_quaternion_wxyz": quaternions})


def motion_of(every):
    trace = pass_over_plane()
    return removal.pad_motion(with_tool(log_of(trace, every), DOWN), trace, part_at(plane()), R)


def exposed(motion):
    return removal.expose_nodes(level_nodes(FINE), motion, R, STIFFNESS)


def test_the_face_lies_above_the_tool_point_by_what_the_head_gave_way_however_seldom_it_is_logged():
    removed, motion = exposed(motion_of(every=1)), motion_of(every=4)
    assert removed.carried == pytest.approx(20.0, rel=0.01)
    assert removed.gained.sum() == pytest.approx(2.0 / 3.0 * 20.0 * SPIN * R * 1.5, rel=0.01)
    np.testing.assert_allclose(exposed(motion_of(every=500)).exposure, removed.exposure, rtol=1e-12)
    # The spindle turns about the tool's axis, which points into the part.
    np.testing.assert_allclose(motion.turning, np.tile([0.0, 0.0, -SPIN], (len(motion.times), 1)), atol=1e-9)
    assert motion.times.sum() == pytest.approx(1.5)


def test_a_part_carried_and_turned_with_the_tool_is_polished_as_one_at_rest_and_none_by_a_pad_in_the_air():
    trace = pass_over_plane()
    lifted = trace._replace(normal_force_n=np.zeros(len(trace.time_s)))
    assert exposed(removal.pad_motion(log_of(trace), lifted, part_at(plane()), R)).exposure.max() == 0.0
    log, still, t = log_of(trace, every=4), exposed(motion_of(every=4)).exposure, trace.time_s
    turn, turns = (Rotation.from_rotvec(np.outer(at, [0.2, -0.1, 0.25])) for at in (t, log["time_s"]))
    shift = np.outer(t, [0.05, 0.1, -0.07])
    moved = trace._replace(
        tcp_position_m=turn.apply(trace.tcp_position_m) + shift, part_shift_m=shift,
        tool_on_part_m=trace.tcp_position_m, tcp_speed_m_s=np.full(len(t), 0.15),
    )  # fmt: skip
    motion = removal.pad_motion(with_tool(log, turns * DOWN), moved, part_at(plane()), R, turns.as_matrix())
    np.testing.assert_allclose(exposed(motion).exposure, still, rtol=1e-5, atol=1e-5 * still.max())


def pressed_at(x, lean=0.0):
    axis = np.array([[math.sin(lean), 0.0, math.cos(lean)]])
    return PadPoses(np.array([[x, 0.0, 0.0]]), axis, np.zeros((1, 3)), -SPIN * axis, np.array([FORCE]))


def test_rates_times_dwell_are_the_removal_of_a_run_and_half_over_an_edge_the_pad_sinks_twice_as_deep():
    nodes = level_nodes(0.0004)
    nodes = removal.PressedNodes(*(column[nodes.positions[:, 0] < 0.0] for column in nodes))
    found = exposure_rates(nodes, pressed_at(0.0), R, STIFFNESS)
    assert found.depths[0] == pytest.approx(2.0 * FORCE / STIFFNESS, rel=0.02)
    assert (found.rates @ nodes.areas)[0] == pytest.approx(FORCE * SPIN * 2.0 / 3.0 * R, rel=5e-3)
    assert exposure_rates(nodes, pressed_at(1.1 * R), R, STIFFNESS).rates.sum() == 0.0
    nodes, dwell, pose = level_nodes(0.001), 0.7, pressed_at(0.004, lean=0.01)
    found = exposure_rates(nodes, pose, R, STIFFNESS)
    sunk = np.array([[0.004, 0.0, 0.0]]) - found.depths[0] * pose.axes
    run = steps(sunk, np.zeros(3), dwell)._replace(axes=pose.axes, turning=-SPIN * pose.axes)
    exposure = removal.expose_nodes(nodes, run, R, STIFFNESS).exposure
    np.testing.assert_allclose(dwell * found.rates.toarray()[0], exposure, rtol=1e-9, atol=1e-6)


class Polished(NamedTuple):
    """A part with its top at z = 0, and what of it is to be polished along a track."""

    surface: Surface
    region: Region
    touch: Touch

    def place(self, config, edge=removal.EDGE):
        fields, rng = build_part_fields(self.surface, self.touch), np.random.default_rng(3)
        part = build_real_part(fields, config, np.eye(4), self.region.surface, UP, rng)
        return part, removal.place_nodes(self.surface, self.region, part, self.touch, edge)


def polished(solid, choice, track, radius):
    """Of a solid 20 mm high about the origin."""
    vertices, faces = np.array(solid.vertices) - [0.0, 0.0, 0.01], np.array(solid.faces, dtype=np.int32)
    surface, mesh = fit_triangles(vertices, faces), part_from_arrays(vertices, faces)
    touch = Touch(track, np.tile(UP, (len(track), 1)), radius)
    return Polished(surface, select_region(surface, mesh, choice), touch)


@pytest.fixture(scope="module")
def block():
    """100 x 100 mm, of which 80 x 30 mm in the middle are to be polished."""
    track = np.column_stack([np.linspace(-0.03, 0.03, 61), np.zeros((61, 2))])
    return polished(trimesh.creation.box((0.1, 0.1, 0.02)), "box:-40,-15,-5,40,15,5", track, R_NODES)


def test_areas_sum_to_the_region_on_its_bent_surface_and_beside_it_lies_all_that_the_pad_comes_to(block):
    coarse, fine = (block.place(PartConfig(), edge)[1] for edge in (2.0 * removal.EDGE, removal.EDGE))
    assert len(fine.mesh.vertices) > 2 * len(coarse.mesh.vertices)
    for nodes in (coarse, fine):
        assert nodes.pressed.areas[: len(nodes.mesh.vertices)].sum() == pytest.approx(0.08 * 0.03, rel=1e-6)
    part, nodes = block.place(PartConfig(displacement_m=0.0, rotation_rad=0.0, form_error_m=0.002))
    places, normals = nodes.pressed.positions, nodes.pressed.normals
    assert np.ptp(places[:, 2]) > 0.001
    distances = [field_distance(part.field, *place) for place in places[::7]]
    assert np.median(np.abs(distances)) < 1e-9
    assert np.abs(distances).max() < 1e-4
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert (normals[:, 2] > 0.9).all()
    beside = removal.surroundings(*block, removal.EDGE * R_NODES)
    x, y = beside.positions[:, 0], beside.positions[:, 1]
    assert np.abs(beside.positions[:, 2]).max() == pytest.approx(0.0, abs=1e-12)
    assert not ((np.abs(x) < 0.04) & (np.abs(y) < 0.015)).any()
    # The pad's way: 60 x 40 mm with half discs at its ends, less what of the region it covers.
    grid = np.stack(np.meshgrid(np.arange(-0.05, 0.05, 1e-4), np.arange(-0.02, 0.02, 1e-4)), axis=-1)
    way = np.hypot(np.maximum(np.abs(grid[..., 0]) - 0.03, 0.0), grid[..., 1]) < R_NODES
    outside = (np.abs(grid[..., 0]) >= 0.04) | (np.abs(grid[..., 1]) >= 0.015)
    under = np.hypot(np.maximum(np.abs(x) - 0.03, 0.0), y) < R_NODES
    assert beside.areas[under].sum() == pytest.approx((way & outside).sum() * 1e-8, rel=0.03)


@pytest.mark.parametrize("form_error", [0.0, 3e-4])
def test_nodes_on_a_rings_sharp_edges_lie_as_the_part_does_beside_them(form_error):
    """There the field's slope is the wall's at some nodes, and its edge lies up to 0.6 mm lower."""
    around = np.linspace(0.0, math.tau, 100)
    track = 0.0675 * np.stack([np.cos(around), np.sin(around), 0.0 * around], axis=1)
    ring = trimesh.creation.annulus(r_min=0.045, r_max=0.09, height=0.02, sections=128)
    config = PartConfig(displacement_m=0.0, rotation_rad=0.0, form_error_m=form_error)
    _, nodes = polished(ring, "top", track, 0.025).place(config)
    own = slice(len(nodes.mesh.vertices))
    assert (nodes.pressed.normals[own, 2] > 0.9).all()
    moved, radii = nodes.pressed.positions[own, 2], np.hypot(*nodes.mesh.vertices[:, :2].T)
    edge = np.minimum(radii - 0.045, 0.09 - radii) < 1e-4
    inside = np.flatnonzero(~edge & (np.minimum(radii - 0.045, 0.09 - radii) > 2e-3))
    next_to = inside[cKDTree(nodes.mesh.vertices[inside]).query(nodes.mesh.vertices[edge])[1]]
    assert edge.sum() > 200
    assert np.abs(moved[edge] - moved[next_to]).max() < 1e-4


def test_all_nodes_of_a_plate_as_thin_as_the_fields_cells_are_found_beside_its_edges_and_a_slot():
    slot = shapely.LineString([(-0.006, -0.006), (0.0, 0.004), (0.006, -0.006)]).buffer(0.0007, cap_style=2)
    plate = trimesh.creation.extrude_polygon(shapely.box(-0.03, -0.02, 0.03, 0.02) - slot, 0.001)
    track = np.linspace([-0.02, 0.0, 0.0005], [0.02, 0.0, 0.0005], 41)
    _, nodes = polished(plate, "top", track, 0.025).place(PartConfig())
    assert nodes.pressed.normals[: len(nodes.mesh.vertices)].any(axis=1).all()
