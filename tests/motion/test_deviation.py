"""Chains of way points, their smoothed motions by closed forms (paper 4), torques of a serial chain."""

import math
from fractions import Fraction
from itertools import combinations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.errors import SmoothingError
from polish_sim.identification.arm import ARM_JOINTS
from polish_sim.identification.regressor import TorqueModel, random_states
from polish_sim.identification.robot_model import read_chain
from polish_sim.models import robot_model_path
from polish_sim.motion.rules import fir
from polish_sim.motion.rules.chain import build_chain, chain_from_axes, repeated_points
from polish_sim.motion.rules.deviation import measure_deviation, vertex_distances
from polish_sim.motion.rules.fir import corner_overlap, corner_speed, fir_schedule
from polish_sim.motion.rules.schedule import Smoothed
from polish_sim.motion.serial_chain import chain_model, chain_torque
from tests.planning.shapes import circle, to_polyline

TRIPLE = np.array([0.1, 0.05, 0.02])
SUBSETS = [subset for k in range(4) for subset in combinations(range(3), k)]
TIPS = np.array([[0.0, 0, 0], [0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]])
NAN_TIPS, STRAIGHT = np.where(np.arange(4)[:, None] == 1, np.nan, TIPS), np.tile([0.0, 0, 1], (4, 1))
HALF_TURN, NO_AXIS = STRAIGHT * [[1], [1], [1], [-1]], STRAIGHT * [[1], [0], [1], [1]]
FRAMES = np.tile(np.eye(3), (4, 1, 1))
STRETCHED = np.array([1.0, 2.0, 1.0, 1.0])[:, None, None] * FRAMES


def straight(tips):
    return build_chain(tips, np.tile(np.eye(3), (len(tips), 1, 1)))


def overlapped(chain, overlap):
    n = len(chain.lengths)
    return fir_schedule(np.arange(n) * (TRIPLE.sum() - overlap), np.tile(TRIPLE, (n, 1)))


def vertex_error(overlap, t2, t3, change):
    """Distance from the vertex of two segments with the same filters (paper 4, eq. 12)."""
    if overlap <= 2.0 * t3:
        return overlap**3 * change / (48.0 * t2 * t3)
    return (4.0 * t3**2 - 6.0 * t3 * overlap + 3.0 * overlap**2) * change / (24.0 * t2)


def test_corners_use_their_tolerance_to_1e_12_mm_and_unlike_ones_stay_within_it():
    """At the vertex half way through the overlap, which is at most as long as the filters."""
    rng, limited = np.random.default_rng(0), 0
    for k in range(2000):
        a, b, c = -np.sort(-(10.0 ** rng.uniform(-3.0, 0.5, 3)))
        c = {0: b, 1: 0.0}.get(k % 10, c)
        length, tolerance = 10.0 ** rng.uniform([-1.7, -4.0], [1.7, 0.0])  # [mm]
        turn = rng.uniform(0.0, np.pi)
        change = corner_speed(length / a, length / a, np.cos(turn))
        overlap = corner_overlap(tolerance, change, b, c, b, c)
        most = vertex_error(b + c, b, c, change)
        way = progress(np.array([a, b, c]), 0.5 * overlap)[0]
        measured = length * way * 2.0 * np.sin(0.5 * turn)
        assert vertex_error(overlap, b, c, change) == pytest.approx(min(tolerance, most), abs=1e-12)
        assert measured == pytest.approx(min(tolerance, most), abs=1e-12)
        limited += most < tolerance
    assert 200 < limited < 1800  # both branches
    rng, used = np.random.default_rng(1), []
    for _ in range(60):
        triples = -np.sort(-(10.0 ** rng.uniform(-2.0, 0.0, (2, 3))), axis=1)
        lengths, turn, tolerance = rng.uniform(0.001, 0.020, 2), rng.uniform(0.05, 3.1), 2e-5
        end = lengths[1] * np.array([np.cos(turn), np.sin(turn), 0.0])
        chain = straight(np.array([[-lengths[0], 0, 0], [0, 0, 0], end]))
        change = corner_speed(*(lengths / triples[:, 0]), np.cos(turn))
        overlap = corner_overlap(tolerance, change, *triples[0, 1:], *triples[1, 1:])
        schedule = fir_schedule(np.array([0.0, triples[0].sum() - overlap]), triples)
        found = measure_deviation(Smoothed(chain, schedule), chain)
        assert found.vertex.value <= tolerance * (1.0 + 1e-9)
        assert found.contour.value <= tolerance * (1.0 + 1e-9)
        used.append(found.vertex.value / tolerance)
    assert max(used) > 0.95


def test_the_axis_strays_by_its_formula_on_a_flat_sphere_and_less_on_a_round_one():
    for size, exact in ((1e-3, 1e-6), (1.0, 0.2)):
        half = 0.7
        axes = np.array([[0.0, 0, 1], [np.sin(size), 0, np.cos(size)]])
        on = np.array([np.cos(2 * half) * np.sin(size), np.sin(2 * half) * np.sin(size), np.cos(size)])
        chain = chain_from_axes(np.zeros((3, 3)), np.stack([axes[1] * [-1, 1, 1], axes[0], on]))
        found = measure_deviation(Smoothed(chain, overlapped(chain, 0.06)), chain).axis.value
        change = corner_speed(size / 0.1, size / 0.1, np.cos(2 * half))
        bound = vertex_error(0.06, 0.05, 0.02, change) * np.cos(half)
        assert bound * (1.0 - exact) <= found <= bound * (1.0 + 1e-9)


def test_stops_stray_nowhere_and_overlaps_and_crossings_are_measured_on_their_own_strand_as_by_sampling():
    chain = straight(np.random.default_rng(0).normal(size=(30, 3)))
    found = measure_deviation(Smoothed(chain, overlapped(chain, 0.0)), chain)
    assert found.contour.value < 1e-14  # rounding of places some metres from the origin
    assert found.vertex.value < 1e-15
    assert found.axis.value == 0.0
    # The corner at (1, 0) is cut; another strand runs through just there.
    chain = straight(np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 1, 0], [0.97, 1, 0], [1.0, -1.0, 0]]))
    motion = Smoothed(chain, overlapped(chain, 0.07))
    wanted = vertex_error(0.07, 0.05, 0.02, 10.0 * np.sqrt(2.0))
    assert vertex_distances(motion, chain)[0][1] == pytest.approx(wanted, rel=1e-12)
    assert measure_deviation(motion, chain).contour.value >= wanted / np.sqrt(2.0) * (1.0 - 1e-9)
    rng = np.random.default_rng(3)
    tips = np.cumsum(rng.normal(size=(12, 3)), axis=0) * 1e-3
    chain = chain_from_axes(tips, np.column_stack([0.05 * rng.normal(size=(12, 2)), -np.ones(12)]))
    schedule = overlapped(chain, 0.12)
    found = measure_deviation(Smoothed(chain, schedule), chain)
    samples = Smoothed(chain, schedule).sample(np.linspace(0.0, schedule.end, 40_001))
    to_vertex = np.linalg.norm(samples.tips[:, 0, None] - tips, axis=2).min(axis=0).max()
    assert found.vertex.value == pytest.approx(to_vertex, rel=1e-5)
    apart = to_polyline(samples.tips[:, 0], tips).max()
    assert found.contour.value >= apart * (1.0 - 1e-9)  # the whole polyline is nearer than a stretch
    assert found.contour.value == pytest.approx(apart, rel=1e-4)


def test_a_circle_in_full_overlap_shrinks_by_two_sincs():
    """Chords follow one another every T1: a polygon, R sinc(w T1/2)^2, by sinc(w T2/2) sinc(w T3/2)."""
    radius, count = 0.05, 720
    chain = straight(circle(radius, count=count)[[*range(count), 0]])
    step, filters = 0.002, np.array([0.11, 0.06])
    schedule = fir_schedule(np.arange(count) * step, np.tile([step, *filters], (count, 1)))
    samples = Smoothed(chain, schedule).sample(np.linspace(0.3, 1.2, 200))
    turning = 2.0 * np.pi / count / step
    polygon = radius * np.sinc(1.0 / count) ** 2
    wanted = polygon * np.prod(np.sinc(turning * filters / (2.0 * np.pi)))
    np.testing.assert_allclose(np.linalg.norm(samples.tips[:, 0], axis=1), wanted, rtol=1e-8)


def exact(triple, time, derivative):
    """The sum over the subsets, with fractions."""
    times, total = [Fraction(value) for value in triple], Fraction(0)
    for subset in SUBSETS:
        late = Fraction(time) - sum((times[i] for i in subset), Fraction(0))
        if late > 0:
            total += (-1) ** len(subset) * late ** (3 - derivative)
    return total / (math.factorial(3 - derivative) * times[0] * times[1] * times[2])


def triples(count, seed):
    """Times that differ by up to five orders, some equal."""
    drawn = 10.0 ** np.random.default_rng(seed).uniform(-4.0, 1.0, (count, 3))
    drawn[::5, 1] = drawn[::5, 0]
    drawn[::10, 2] = drawn[::10, 0]
    return drawn


def progress(triple, time):
    """Of the pieces, with three derivatives."""
    starts, coefficients = fir.rest_to_rest(np.array(triple))
    if not 0.0 <= time <= starts[-1]:
        return np.array([time > 0.0, 0.0, 0.0, 0.0])
    k = min(np.searchsorted(starts, time, side="right") - 1, len(coefficients) - 1)
    return np.array([np.polynomial.Polynomial(coefficients[k]).deriv(d)(time - starts[k]) for d in range(4)])


def test_progress_and_derivatives_are_the_sum_over_subsets_to_1e_12_from_nought_to_one():
    """The third derivative away from its steps; times of nought leave fewer filters."""
    rng = np.random.default_rng(1)
    for triple in triples(200, 0):
        steps = np.array([triple[list(subset)].sum() for subset in SUBSETS])
        size = 1.0 / np.cumprod(np.concatenate([[1.0], np.sort(triple)[::-1]]))
        for time in rng.uniform(0.0, triple.sum(), 6):
            found = progress(triple, time)
            for derivative in range(3):
                true = exact(list(triple), time, derivative)
                assert abs(Fraction(found[derivative]) - true) <= 1e-12 * size[derivative]
            if np.abs(steps - time).min() > 1e-9:
                true = float(exact(list(triple), time, 3))
                assert found[3] == pytest.approx(true, rel=1e-12, abs=1e-12 / triple.prod())
        np.testing.assert_array_equal(progress(triple, 0.0)[:3], [0.0, 0.0, 0.0])
        np.testing.assert_array_equal(progress(triple, -1.0), [0.0, 0.0, 0.0, 0.0])
        np.testing.assert_array_equal(progress(triple, triple.sum() + 1.0), [1.0, 0.0, 0.0, 0.0])
    assert progress(np.array([2.0, 0.0, 0.0]), 0.5)[0] == 0.25
    np.testing.assert_allclose(progress(np.array([0.0, 2.0, 1.0]), 0.5)[:3], [1 / 16, 0.25, 0.5])


def test_no_profile_within_the_limits_is_shorter():
    """Limits are kept and one is used; no symmetric profile on a grid of plateau times is shorter."""
    rng, grid = np.random.default_rng(7), np.geomspace(1e-4, 1.0, 60)
    for length, v, a, j in 10.0 ** rng.uniform(-3.0, 3.0, (500, 4)):
        times = np.array(fir.stop_times(length, v, a, j))
        # peaks of a box of length 1 whose longest time is at least b + c
        plateau = 1.0 / (times[0] * times[1])
        ratios = [length / times[0] / v, length * plateau / a, length * plateau / times[2] / j]
        assert max(ratios) <= 1.0 + 1e-9
        assert times[0] >= (times[1] + times[2]) * (1.0 - 1e-12)
        assert ratios[2] == pytest.approx(1.0) or ratios[0] == pytest.approx(1.0)
        ramp = grid * min(a / j, np.sqrt(v / j), np.cbrt(0.5 * length / j))
        hold = np.concatenate([[0.0], grid])[:, None] * v / a
        top = j * ramp * (ramp + hold)
        way = top * (2.0 * ramp + hold)
        time = 2.0 * (2.0 * ramp + hold) + (length - way) / top
        assert sum(times) <= time[(top <= v) & (way <= length)].min() * (1.0 + 1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 3.0, np.pi - 1e-5])
def test_angles_are_exact_from_nothing_to_nearly_half_a_turn(angle):
    axes = np.array([[1.0, 0.0, 0.0], [np.cos(angle), np.sin(angle), 0.0]])
    chain = chain_from_axes(np.zeros((2, 3)) + [[0.0], [0.01]], axes)
    assert chain.angles[0] == pytest.approx(angle, rel=1e-13, abs=1e-16)
    np.testing.assert_allclose(chain.turn_axes[0], [0.0, 0.0, float(angle > 0.0)], atol=1e-12)


@pytest.mark.parametrize(
    ("build", "tips", "frames", "words"),
    [
        (chain_from_axes, TIPS, HALF_TURN, r"180 deg .*\(10, 0, 0\) mm .* 2 and 3"),
        (chain_from_axes, TIPS, NO_AXIS, r"way point 1 .* zero"),
        (build_chain, np.zeros((0, 3)), np.zeros((0, 3, 3)), "shape"),
        (build_chain, NAN_TIPS, FRAMES, "way point 1 .* not finite"),
        (build_chain, TIPS, STRETCHED, "way point 1 .* no rotation"),
    ],
)
def test_what_is_no_chain_is_refused_with_its_place(build, tips, frames, words):
    with pytest.raises(SmoothingError, match=words):
        build(tips, frames)


def test_segments_end_in_the_next_frame_and_points_that_repeat_tip_and_axis_are_left_out():
    tips = np.random.default_rng(0).normal(size=(40, 3))
    frames = Rotation.random(40, random_state=0).as_matrix()
    chain = build_chain(tips, frames)
    ends = chain.tips[:-1] + chain.lengths[:, None] * chain.directions
    np.testing.assert_allclose(ends, tips[1:], atol=1e-14)
    turns = Rotation.from_rotvec(chain.angles[:, None] * chain.turn_axes).as_matrix()
    rolls = Rotation.from_rotvec(chain.rolls[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    np.testing.assert_allclose(turns @ frames[:-1] @ rolls, frames[1:], atol=1e-13)
    for axes in (chain.axes[:-1], chain.axes[1:]):
        np.testing.assert_allclose(np.sum(axes * chain.turn_axes, axis=1), 0.0, atol=1e-14)
    tips = np.array([[0.0, 0, 0], [0.0, 0, 0], [0.0, 0, 0], [0.01, 0, 0], [0.01, 0, 0]])
    axes = np.array([[0.0, 0, -1], [0.0, 0, -1], [0.0, 0.6, -0.8], [0.0, 0.6, -0.8], [0.0, 0.6, -0.8]])
    chain = chain_from_axes(tips, axes)
    frames = np.stack([np.cross([0.0, 1.0, 0.0], axes), np.tile([0.0, 1.0, 0.0], (5, 1)), axes], axis=2)
    np.testing.assert_array_equal(repeated_points(tips, frames), [False, True, False, False, True])
    np.testing.assert_allclose(chain.lengths, [0.0, 0.01])
    np.testing.assert_allclose(chain.angles, [np.arctan2(0.6, 0.8), 0.0])
    np.testing.assert_array_equal(chain.directions[0], 0.0)
    np.testing.assert_array_equal(chain.turn_axes[1], 0.0)
    assert len(build_chain(tips[:1], frames[:1]).lengths) == 0


@pytest.mark.parametrize(("joints", "count"), [(ARM_JOINTS, 6), (None, 7)], ids=["arm", "arm and slide"])
def test_torques_are_those_of_the_regressor_and_without_gravity_scale_with_the_masses(joints, count):
    robot = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    chain = read_chain(robot, joints)
    rigid, states = TorqueModel(chain, ("armature",)), random_states(count, 100, np.random.default_rng(1))
    wanted, model, torque = rigid.torque(states, rigid.truth()), chain_model(chain), np.zeros(count)
    for row in range(100):
        chain_torque(model, states.q[row], states.qd[row], states.qdd[row], 1.0, torque)
        np.testing.assert_allclose(torque, wanted[row], atol=1e-11)
    chain, torque, more = read_chain(robot, ARM_JOINTS), np.zeros(6), np.zeros(6)
    q, qdd, still = np.linspace(-1.0, 1.0, 6), np.linspace(2.0, -3.0, 6), np.zeros(6)
    chain_torque(chain_model(chain), q, still, qdd, 0.0, torque)
    chain_torque(chain_model(chain, 1.2), q, still, qdd, 0.0, more)
    np.testing.assert_allclose(more, 1.2 * torque, rtol=1e-12)
    chain_torque(chain_model(chain), q, still, still, 0.0, torque)
    np.testing.assert_array_equal(torque, still)
