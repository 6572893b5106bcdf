"""The part as it really lies: displaced, turned and bent from the seed alone; where it carries the pad."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from polish_sim.cell import Touch, build_real_part
from polish_sim.cell.dwell import would_sink
from polish_sim.cell.real_part import bend_of, build_part_fields, displacement_of, spread_over
from polish_sim.config import PadConfig, PartConfig
from polish_sim.geometry import field_distance
from polish_sim.spatial import apply, transform
from tests.cell.cells import DOWN, PAD, press
from tests.geometry.shapes import fit

UP = np.array([0.0, 0.0, 1.0])
TRUE = PartConfig(displacement_m=0.0, rotation_rad=0.0, form_error_m=0.0)
THICKNESS = 0.003
SMALL_PAD = PadConfig(radius_m=0.01)
HALF, DEEPEST = 0.05, 0.008
T_BASE_WORK = transform(Rotation.from_rotvec([0.2, -0.1, 0.7]).as_matrix(), np.array([0.1, -0.5, 0.2]))


@pytest.fixture(scope="module")
def sheet():
    """A sheet 100 x 100 x 3 mm, its top in the plane z = 0."""
    return fit(trimesh.creation.box((0.1, 0.1, THICKNESS)).subdivide().subdivide(), sunk=THICKNESS / 2)


def real(sheet, config, seed=0):
    touch = Touch(np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]]), np.array([UP, UP]), PAD.radius_m)
    fields, rng = build_part_fields(sheet, touch), np.random.default_rng(seed)
    return build_real_part(fields, config, T_BASE_WORK, top_of(sheet), UP, rng)


def top_of(sheet):
    heights = sheet.vertices[sheet.faces][:, :, 2]
    return sheet.restrict(np.flatnonzero(np.all(heights > -1e-9, axis=1)).astype(np.int32))


def test_displacement_and_form_error_have_their_size_direction_and_shortest_wave():
    normal, center, along = np.array([0.6, 0.0, 0.8]), np.array([0.05, -0.02, 0.1]), []
    for seed in range(200):
        T = displacement_of(PartConfig(), normal, center, np.random.default_rng(seed))
        shift = apply(T, center[None])[0] - center
        assert np.linalg.norm(shift) == pytest.approx(0.001)
        assert Rotation.from_matrix(T[:3, :3]).magnitude() == pytest.approx(PartConfig().rotation_rad)
        along.append(shift @ normal / 0.001)
    assert np.abs(along).min() >= 0.7
    assert np.abs(along).min() < 0.72
    assert 60 < np.sum(np.array(along) > 0.0) < 140
    rng, h = np.random.default_rng(1), 1e-4
    points = np.column_stack([rng.uniform(-0.1, 0.1, (3000, 2)), np.zeros(3000)])
    crossed = (points[:5, None] + points[5:9]).reshape(-1, 3)
    for seed in range(10):
        bend = bend_of(PartConfig(), points, np.random.default_rng(seed))
        values = bend(points)
        assert np.ptp(values) == pytest.approx(0.0003)
        assert values.max() == pytest.approx(-values.min())
        np.testing.assert_allclose(bend.on_grid(points[:5], points[5:9]).ravel(), bend(crossed), atol=1e-17)
        curvature = (bend(points + [h, 0, 0]) - 2.0 * values + bend(points - [h, 0, 0])) / h**2
        assert np.abs(curvature).max() < 0.00015 * 8 * (2.0 * np.pi / 0.04) ** 2


def test_a_part_lies_where_it_is_placed_as_drawn_or_bent_as_the_form_error_of_its_seed_says(sheet):
    part = real(sheet, TRUE)
    np.testing.assert_allclose(part.rotation, T_BASE_WORK[:3, :3], atol=1e-15)
    np.testing.assert_allclose(part.position, T_BASE_WORK[:3, 3], atol=1e-15)
    R = T_BASE_WORK[:3, :3] @ DOWN
    # Deeper than half a thin sheet the pad is pushed out the way it came; half over the edge it feels half.
    for x, depth, force, off in (
        (0.01, -0.0005, 0.0, 0.0),
        (0.01, 0.002, 40.0, 1e-3),
        (0.0, 0.9 * THICKNESS, 54.0, 0.01),
        (0.05, 0.001, 10.0, 0.5),
    ):
        center = apply(T_BASE_WORK, np.array([[x, 0.005, -depth]]))[0]
        pushed = T_BASE_WORK[:3, :3].T @ press(part, center, R).force
        np.testing.assert_allclose(pushed, [0.0, 0.0, force], atol=off)
    # Not just where the pad goes; to half a cell: inside a sheet thinner than a cell no node is negative.
    places, coarse = np.random.default_rng(0).uniform(-0.05, 0.05, (500, 2)), part.coarse
    levels = -THICKNESS / 2 + np.array([0.0, 0.008])
    inside, beside = ([field_distance(coarse, *place, z) for place in places] for z in levels)
    assert max(inside) < 0.5 * coarse.spacing < min(beside)
    config = PartConfig(displacement_m=0.0, rotation_rad=0.0, form_error_m=0.0003)
    part, top = real(sheet, config, seed=3), top_of(sheet)
    bend = bend_of(config, spread_over(top), np.random.default_rng(3))
    points = np.column_stack([np.random.default_rng(0).uniform(-0.03, 0.03, (200, 2)), np.zeros(200)])
    found = [field_distance(part.field, *point) for point in points]
    np.testing.assert_allclose(found, -bend(points), atol=1e-6)
    assert np.ptp(found) > 0.0001
    shifts = [real(sheet, PartConfig(), seed).position for seed in (5, 5, 6)]
    np.testing.assert_array_equal(shifts[0], shifts[1])
    assert not np.array_equal(shifts[0], shifts[2])


@pytest.fixture(scope="module")
def block():
    """A block with an edge at x = 50 mm, as the pad meets it near there."""
    surface = fit(trimesh.creation.box((2.0 * HALF, 0.06, 0.02)), sunk=0.01)
    near_it = np.array([[0.03, 0.0, 0.0], [0.06, 0.0, 0.0]])
    return build_part_fields(surface, Touch(near_it, np.array([UP, UP]), SMALL_PAD.radius_m))


def sinks(block, x, force, aside):
    """Whether the pad sinks with its middle at ``x`` (n,) [m]."""
    places = np.column_stack([x, np.zeros((len(x), 2))])
    ups, forces = np.tile(UP, (len(x), 1)), np.full(len(x), force)
    return would_sink(block, SMALL_PAD, places, ups, forces, aside, DEEPEST)


def test_near_an_edge_the_hold_is_lost_earlier_on_a_part_that_lies_aside(block):
    """Inside it lasts up to the force of the pad's springs at the depth there is."""
    most, inside = SMALL_PAD.stiffness_n_m * DEEPEST, np.array([0.03])
    assert not sinks(block, inside, 0.99 * most, 0.001).any()
    assert sinks(block, inside, 1.01 * most, 0.0).all()
    x = np.arange(0.03, 0.06, 0.00025)
    lost = [sinks(block, x, 20.0, aside) for aside in (0.0, 0.003, 0.005)]
    for found in lost:
        assert 0 < np.count_nonzero(found) < len(x)
    straight, shifted, further = (x[found.argmax()] for found in lost)
    assert straight > HALF  # with its middle on the edge a half of the pad is left, and enough
    assert straight - shifted > 0.001
    assert shifted - further > 0.001
